"""No key keeps the others from having anything computed: by priorities, by sweeps, by numbers."""

import pytest

from service.jobs.keys import Role
from service.jobs.queue import Lane
from service.jobs.records import POINTS_PER_JOB
from service.settings import Settings
from tests.support.api import PLANAR, STATE, TestClient, create_app
from tests.support.keys import make
from tests.support.lists import list_jobs

AXIS = {"pointer": "/motion/lambda", "linspace": [1, 2, 1000]}
SWEEP = {"base": PLANAR, "axes": [AXIS], "keep": ["period"]}


def problem(number):
    """A problem like no other."""
    return {**STATE, "time": {"stop": 20, "samples": 200 + number}}


def sweep_of(points, **further):
    return {**SWEEP, "axes": [{**AXIS, "linspace": [1, 2, points]}], **further}


def code(response):
    return response.json()["type"].removeprefix("urn:polhode:problem:")


SENT = {
    "?priority": lambda client, priority, sent: client.post(
        "/v1/jobs", json=problem(priority), params={"priority": priority}, headers=sent
    ),
    "?priority of a list": lambda client, priority, sent: client.post(
        "/v1/jobs", json=[problem(priority)], params={"priority": priority}, headers=sent
    ),
    "/priority": lambda client, priority, sent: client.post(
        "/v1/sweeps", json={**SWEEP, "priority": priority}, headers=sent
    ),
}


@pytest.mark.any_database
@pytest.mark.parametrize("place", SENT)
def test_only_operators_step_before_all_others(client, database, jobs, place):
    send, (key, submitter) = SENT[place], make(database, Role.SUBMIT)
    operators = [make(database, role)[1] for role in (Role.OPERATE, Role.ADMIN)]
    for priority in (1, 100):
        response = send(client, priority, submitter)
        assert (response.status_code, code(response)) == (403, "role_insufficient")
        document = response.json()
        assert document["needed_role"] == "operate"
        (fault,) = document["errors"]
        assert fault["pointer"] == place.split()[0]
        assert "-100 to 0 are accepted" in fault["message"]
    for priority in (0, -1, -100):
        assert send(client, priority, submitter).status_code == 202
    for operator in operators:
        assert send(client, 100, operator).status_code == 202
    assert {job.priority for job in list_jobs(jobs).jobs if job.key_id == key.id} <= {0, -1, -100}


def test_without_keys_whoever_is_on_this_machine_chooses(client):
    assert all(send(client, 100, {}).status_code == 202 for send in SENT.values())


@pytest.mark.any_database
@pytest.mark.parametrize("priority", ["100", 1.5, True, None, 101])
def test_a_priority_of_a_sweep_is_an_integer(client, database, priority):
    sent = make(database, Role.SUBMIT)[1]
    response = client.post("/v1/sweeps", json={**SWEEP, "priority": priority}, headers=sent)
    assert response.status_code == 422
    assert [fault["pointer"] for fault in response.json()["errors"]] == ["/priority"]


def test_a_list_waits_behind_single_problems_and_before_sweeps(client, jobs):
    sweep = client.post("/v1/sweeps", json=SWEEP).json()
    listed = client.post("/v1/jobs", json=[problem(1), problem(2)]).json()["items"]
    alone = client.post("/v1/jobs", json=[problem(3)]).json()["items"][0]["job"]["id"]
    single = client.post("/v1/jobs", json=problem(4)).json()["id"]
    claims = jobs.take("worker", 5, lease_seconds=60.0).claims
    assert [claim.job_id for claim in claims[:4]] == [alone, single, *(each["job"]["id"] for each in listed)]
    assert claims[4].sweep_id == sweep["id"]
    assert [claim.lane for claim in claims] == [Lane.SINGLE] * 2 + [Lane.LIST] * 2 + [Lane.SWEEP]


def test_the_points_of_sweeps_count_as_queued_work(client, database):
    sent, other = make(database, Role.SUBMIT, queued_jobs=10)[1], make(database, Role.SUBMIT)[1]
    assert client.post("/v1/jobs", json=problem(0), headers=sent).status_code == 202
    assert client.post("/v1/sweeps", json=sweep_of(5 * POINTS_PER_JOB), headers=sent).status_code == 202
    refused = client.post("/v1/sweeps", json=sweep_of(4 * POINTS_PER_JOB + 1), headers=sent)
    assert (refused.status_code, code(refused)) == (429, "too_many_queued_jobs")
    assert refused.headers["retry-after"] == "10"
    detail = refused.json()["detail"]
    assert "6 jobs are queued or running" in detail
    assert f"a sweep of {4 * POINTS_PER_JOB} points would be accepted now" in detail
    assert client.post("/v1/sweeps", json=sweep_of(4 * POINTS_PER_JOB), headers=sent).status_code == 202
    assert client.post("/v1/jobs", json=problem(1), headers=sent).status_code == 429
    assert client.post("/v1/jobs", json=problem(2), headers=other).status_code == 202


def test_without_keys_the_limit_of_the_installation_holds_for_points_too(sqlite_url):
    with TestClient(create_app(Settings(database_url=sqlite_url, max_queued_jobs=2))) as client:
        assert client.post("/v1/sweeps", json=sweep_of(2 * POINTS_PER_JOB + 1)).status_code == 429
        sweep = client.post("/v1/sweeps", json=sweep_of(2 * POINTS_PER_JOB))
        assert sweep.status_code == 202
        assert client.post("/v1/jobs", json=problem(0)).status_code == 429
        assert client.post(f"/v1/sweeps/{sweep.json()['id']}/cancel").status_code == 200
        assert client.post("/v1/jobs", json=problem(0)).status_code == 202
