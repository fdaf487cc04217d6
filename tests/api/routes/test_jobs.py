import threading

import pytest

from service.api.queries.queries import wait_seconds
from service.jobs.records import JobState
from service.storage.solutions.accuracy_store import AccuracyStore
from tests.support.accuracy import row, table
from tests.support.api import PLANAR, STATE, finish
from tests.support.lists import list_jobs

pytestmark = pytest.mark.any_database


def submit(client, problem=STATE, **headers):
    return client.post("/v1/jobs", json=problem, headers=headers)


def test_a_submitted_job_is_queued_and_found_at_its_location(client):
    response = submit(client)
    assert response.status_code == 202
    job = response.json()
    assert response.headers["location"] == f"/v1/jobs/{job['id']}"
    assert client.get(response.headers["location"]).json() == job
    assert (job["state"], job["attempt"], job["reused"], job["solution"]) == ("queued", 0, False, None)


def test_the_document_is_kept_as_it_was_sent(client):
    # An integer beyond 64 bits, and a decimal that a double prints otherwise.
    problem = {**STATE, "body": {"A": 2 * 10**30, "B": "1500000000000000000e12", "C": 10**30}}
    job = submit(client, problem).json()
    assert job["problem"] == problem
    assert client.get(f"/v1/jobs/{job['id']}").json()["problem"] == problem


def test_jobs_are_listed_newest_first_by_state_and_page(client, jobs):
    ids = [submit(client).json()["id"] for _ in range(3)]
    client.post(f"/v1/jobs/{ids[1]}/cancel")
    page = client.get("/v1/jobs", params={"limit": 2}).json()
    assert [job["id"] for job in page["items"]] == [ids[2], ids[1]]
    assert (page["total"], page["limit"], page["offset"]) == (3, 2, 0)
    rest = client.get("/v1/jobs", params={"limit": 2, "offset": 2}).json()
    assert [job["id"] for job in rest["items"]] == [ids[0]]
    cancelled = client.get("/v1/jobs", params={"state": "cancelled"}).json()
    assert [job["id"] for job in cancelled["items"]] == [ids[1]]


def test_an_equal_problem_brings_the_solution_of_the_earlier_one(client, stored):
    # The same numbers, written differently.
    again = {**STATE, "body": {"A": 2.0, "B": 1.5, "C": "1/1"}, "method": "auto"}
    job = submit(client, again).json()
    assert (job["state"], job["reused"], job["solution"]) == ("succeeded", True, stored.solution_id)
    assert submit(client, again, Prefer="wait=5").status_code == 200


def test_another_problem_is_not_mistaken_for_it(client, stored):
    assert submit(client, {**STATE, "time": {"stop": 21, "samples": 201}}).json()["reused"] is False


def test_waiting_ends_with_the_job(client, app, jobs):
    def work():
        finish(jobs)
        app.state.resources.wake_up.announce(list_jobs(jobs).jobs[0].id)

    def ring():
        worker.start()

    # The wake-up socket is notified when the job is stored: then a worker takes it.
    worker = threading.Thread(target=work)
    app.state.resources.wake_up.notify = ring
    response = submit(client, Prefer="respond-async, wait=30")
    worker.join()
    assert response.status_code == 200
    assert response.headers["preference-applied"] == "wait=30"
    assert response.json()["state"] == "succeeded"


def test_a_wait_that_is_too_short_returns_the_job_as_it_is(client):
    response = submit(client, Prefer="wait=0")
    assert (response.status_code, response.json()["state"]) == (202, "queued")
    assert response.headers["preference-applied"] == "wait=0"


def test_without_a_free_place_nobody_waits(client, app):
    waiting = app.state.resources.waiting
    while waiting.acquire(blocking=False):
        pass
    response = submit(client, Prefer="wait=30")
    assert response.status_code == 202
    assert "preference-applied" not in response.headers


@pytest.mark.parametrize(
    ("header", "seconds"),
    [
        (None, None),
        ("", None),
        ("respond-async", None),
        ("wait=5", 5),
        ("Wait = 5", 5),
        ('wait="7"; x=1', 7),
        ("respond-async, wait=5", 5),
        ("wait=100000", 60),
        ("wait=-1", None),
        ("wait=soon", None),
        ("nowait=3", None),
        ("wait=1.5", None),
    ],
)
def test_the_prefer_header_is_read_as_the_rfc_says(header, seconds):
    assert wait_seconds(header) == seconds


def test_live_jobs_can_be_cancelled_and_cancelled_again(client, jobs):
    first, second = (submit(client).json()["id"] for _ in range(2))
    assert jobs.claim("test", lease_seconds=60.0).job_id == first
    for job_id in (first, second, first):
        response = client.post(f"/v1/jobs/{job_id}/cancel")
        assert (response.status_code, response.json()["state"]) == (200, "cancelled")


@pytest.mark.parametrize("end", [JobState.SUCCEEDED, JobState.FAILED])
def test_finished_jobs_cannot_be_cancelled(client, jobs, end):
    job_id = submit(client).json()["id"]
    if end is JobState.SUCCEEDED:
        finish(jobs)
    else:
        claim = jobs.claim("test", lease_seconds=60.0)
        jobs.finish_failure(claim, {"code": "accuracy_not_met", "detail": "why"})
    response = client.post(f"/v1/jobs/{job_id}/cancel")
    assert response.status_code == 409
    assert response.json()["type"].endswith(":job_finished")
    assert end.value in response.json()["detail"]


def test_a_failed_job_says_why(client, jobs):
    job_id = submit(client).json()["id"]
    error = {"code": "accuracy_not_met", "detail": "reached 1e-9", "pointer": "/accuracy"}
    jobs.finish_failure(jobs.claim("test", lease_seconds=60.0), error)
    job = client.get(f"/v1/jobs/{job_id}").json()
    assert (job["state"], job["error"]) == ("failed", error)


def test_a_planar_problem_with_a_motion_is_accepted(client):
    assert submit(client, PLANAR).status_code == 202


@pytest.fixture
def measured(database):
    """A table in which another family of the same kind of motion costs a hundred times as much."""
    costs = {"draft": 0.006, "standard": 0.008, "high": 0.014, "certified": 0.06}
    rows = [
        row(tier, "rest to equator", family, seconds=factor * cost, seconds_per_1000=0.0)
        for tier, cost in costs.items()
        for family, factor in (("three-term", 1), ("integral", 100))
    ]
    AccuracyStore(database).add(table(*rows))


@pytest.mark.parametrize(
    ("seconds", "tier"), [(3600, "certified"), (0.05, "high"), (0.01, "standard"), (0.006, "draft")]
)
def test_a_budget_becomes_the_best_tier_that_is_expected_to_keep_it(client, measured, seconds, tier):
    response = client.post("/v1/jobs", json={**PLANAR, "accuracy": {"budget_seconds": seconds}})
    assert (response.status_code, response.json()["problem"]["accuracy"]) == (202, {"tier": tier})


def test_a_budget_that_nothing_is_expected_to_keep_is_refused_with_the_figure(client, measured):
    problem = {**PLANAR, "accuracy": {"budget_seconds": 0.001}}
    response = client.post("/v1/jobs", json=problem)
    assert response.status_code == 422
    (error,) = response.json()["errors"]
    assert (error["pointer"], error["code"]) == ("/accuracy/budget_seconds", "budget_too_small")
    assert "draft, is expected to take 0.006 s" in error["message"]
    # In a list it refuses only itself.
    items = client.post("/v1/jobs", json=[problem, PLANAR]).json()["items"]
    assert [item["status"] for item in items] == [422, 202]
