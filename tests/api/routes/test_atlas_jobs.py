"""Atlases that take long: a job draws them, which lives as others, and its atlas is stored."""

import json
from concurrent.futures import ThreadPoolExecutor

import pytest
from sqlalchemy import select

from service.app import create_app
from service.jobs.keys import Role
from service.sandbox import SandboxTimeoutError
from service.settings import Settings
from service.storage.inspection.inspect import inspect
from service.storage.keys import KeyStore
from service.storage.tables.jobs import ResultRow
from service.verdicts.questions import examine_atlas
from tests.support.api import TestClient
from tests.support.keys import make
from workers.computation.atlases import with_stability
from workers.process.tasks import draw_atlas

ATLAS = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "expression", "expression": "-g1 + 1/(20*g3^2)"},
    # One part, of which one λ is followed as seldom as can be: each takes as long as a job.
    "lambda": ["3/5", "31/50"],
    "samples": 9,
}
STABILITY = {**ATLAS, "outputs": ["period", "stability"]}
ASYNC = {"Prefer": "respond-async"}
ARROW = "application/vnd.apache.arrow.stream"


def submit(client, document=ATLAS, **headers):
    answer = client.post("/v1/atlases", json=document, headers={**ASYNC, **headers})
    assert answer.status_code == 202, answer.text
    job = answer.json()
    assert answer.headers["location"] == f"/v1/jobs/{job['id']}"
    assert (job["state"], job["atlas"], job["solution"], job["problem"]) == ("queued", None, None, document)
    return job["id"]


def work(jobs):
    """Do a worker's work for the oldest job."""
    claim = jobs.claim("test", lease_seconds=60.0)
    assert jobs.finish(claim, draw_atlas(json.dumps(claim.payload)))[0]
    return claim.job_id


def in_order(database):
    assert [finding.code for finding in inspect(database) if finding.broken] == []


def test_stability_is_drawn_by_a_job_and_told_as_polhode_atlas_tells_it(client, jobs, database):
    answer = client.post("/v1/atlases", json=STABILITY)
    assert answer.status_code == 202
    assert work(jobs) == answer.json()["id"]
    job = client.get(answer.headers["location"]).json()
    assert (job["state"], job["atlas"], job["solution"]) == ("succeeded", job["id"], None)
    found = client.get(f"/v1/atlases/{job['atlas']}").json()
    text = json.dumps(STABILITY)
    assert found == json.loads(with_stability(text, examine_atlas(text)))["verdict"]
    (part,) = found["parts"]
    (window,) = part["samples"]["windows"]
    assert set(window["stability"]["verdict"]) == {"stable"}
    assert window["stability"]["reason"] == [None] * 9
    in_order(database)


@pytest.mark.any_database
def test_an_atlas_of_a_job_is_that_which_is_answered_at_once_in_every_format(client, jobs):
    its_id = submit(client)
    work(jobs)
    for accept in ("application/json", "text/csv", ARROW, "image/svg+xml"):
        headers = {"Accept": accept}
        stored = client.get(f"/v1/atlases/{its_id}", headers=headers)
        assert stored.headers["content-type"].startswith(accept)
        assert stored.content == client.post("/v1/atlases", json=ATLAS, headers=headers).content
        again = {**headers, "If-None-Match": stored.headers["etag"]}
        assert client.get(f"/v1/atlases/{its_id}", headers=again).status_code == 304
    assert client.get(f"/v1/atlases/{its_id}", headers={"Accept": "image/png"}).status_code == 406


class Hurried:
    """Stands for the children: draws here, with no time at all, or does not come to an end."""

    is_idle = True

    def __init__(self, *, is_stopped):
        self.is_stopped = is_stopped

    def run(self, examination, text="ping", *, seconds, crashes=1, submitted=None):
        if self.is_stopped and examination is examine_atlas:
            raise SandboxTimeoutError("the time limit passed")
        return examination(text)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("is_stopped", [False, True])
def test_what_is_not_drawn_in_time_becomes_a_job(url, jobs, monkeypatch, is_stopped):
    monkeypatch.setattr("service.verdicts.questions.ATLAS_PROCESSOR_SECONDS", 0.0)
    changing = {**ATLAS, "lambda": ["1/2", 1]}
    app = create_app(Settings(database_url=url), sandbox=Hurried(is_stopped=is_stopped))
    with TestClient(app) as client:
        answer = client.post("/v1/atlases", json=changing, headers={"Accept": "image/svg+xml"})
        assert (answer.status_code, answer.headers["content-type"]) == (202, "application/json")
        assert work(jobs) == answer.json()["id"]
        # A job has the time to enclose the change.
        found = client.get(f"/v1/atlases/{answer.json()['id']}").json()
        assert [change["kind"] for change in found["changes"]] == ["window_appears"]
        assert found["undecided"] == []


def test_no_time_leaves_something_undecided_and_says_that_it_was_the_time(monkeypatch):
    changing = json.dumps({**ATLAS, "lambda": ["1/2", 1]})
    in_time = json.loads(examine_atlas(changing))
    assert (in_time["is_late"], in_time["verdict"]["undecided"]) == (False, [])
    monkeypatch.setattr("service.verdicts.questions.ATLAS_PROCESSOR_SECONDS", 0.0)
    late = json.loads(examine_atlas(changing))
    assert late["is_late"]
    assert late["verdict"]["undecided"]


def test_a_client_may_wait_for_the_job(client, jobs):
    """In the time of Prefer: wait; 200 is always the atlas itself, so that it is 202 nevertheless."""
    with ThreadPoolExecutor(1) as pool:
        headers = {"Prefer": "respond-async, wait=30"}
        asking = pool.submit(client.post, "/v1/atlases", json=ATLAS, headers=headers)
        while not client.get("/v1/atlases").json()["items"]:
            pass
        its_id = work(jobs)
        client.app.state.resources.wake_up.announce(its_id)
        answer = asking.result()
    assert (answer.status_code, answer.json()["atlas"]) == (202, its_id)
    assert answer.headers["preference-applied"] == "wait=30"


def test_what_has_no_atlas_is_refused_before_there_is_a_job(client, jobs):
    inadmissible = {**STABILITY, "potential": {"type": "gravity", "a": 1, "b": 1}}
    refused = client.post("/v1/atlases", json=inadmissible)
    assert (refused.status_code, refused.json()["type"]) == (
        422,
        "urn:polhode:problem:inadmissible_potential",
    )
    assert client.post("/v1/atlases", json=ATLAS, params={"priority": "x"}).status_code == 422
    assert jobs.claim("test", lease_seconds=60.0) is None


def test_it_is_a_job_that_lives_as_others(client, jobs, database):
    first = client.post("/v1/atlases", json=ATLAS, headers={**ASYNC, "Idempotency-Key": "a"})
    again = client.post("/v1/atlases", json=ATLAS, headers={**ASYNC, "Idempotency-Key": "a"})
    assert again.headers["idempotency-replayed"] == "true"
    assert again.content == first.content
    its_id = first.json()["id"]
    lost = jobs.claim("one", lease_seconds=60.0)
    assert jobs.lose(lost, "its child died", max_attempts=3, retry_seconds=0.0)
    assert not jobs.finish(lost, draw_atlas(json.dumps(ATLAS)))[0]
    missing = client.get(f"/v1/atlases/{its_id}")
    assert (missing.status_code, missing.json()["type"]) == (404, "urn:polhode:problem:not_found")
    assert client.delete(f"/v1/jobs/{its_id}").json()["type"] == "urn:polhode:problem:not_finished"
    work(jobs)
    attempts = client.get(f"/v1/jobs/{its_id}/attempts").json()["items"]
    assert [each["outcome"] for each in attempts] == ["lost", "succeeded"]
    with client.stream("GET", f"/v1/jobs/{its_id}/events") as events:
        told = "".join(events.iter_text())
    assert f'"atlas":"{its_id}"' in told.replace(" ", "")
    cancelled = submit(client)
    assert client.post(f"/v1/jobs/{cancelled}/cancel").json()["state"] == "cancelled"
    # They have a list of their own, asked as that of jobs.
    assert [each["id"] for each in client.get("/v1/atlases").json()["items"]] == [cancelled, its_id]
    assert client.get("/v1/jobs").json()["items"] == []
    page = client.get("/v1/atlases", params={"where": "/body/A > 1", "state": "succeeded"}).json()
    assert [each["atlas"] for each in page["items"]] == [its_id]
    in_order(database)
    assert client.delete(f"/v1/jobs/{its_id}").status_code == 204
    with database.read() as session:
        assert session.scalars(select(ResultRow.job_id)).all() == []
    in_order(database)


def test_one_that_cannot_be_drawn_has_failed_with_its_reason(client, jobs, database):
    its_id = submit(client)
    claim = jobs.claim("test", lease_seconds=60.0)
    # As if it had been accepted by a version that proves more.
    outcome = draw_atlas(json.dumps({**claim.payload, "potential": {"type": "gravity", "a": 1, "b": 1}}))
    assert jobs.finish(claim, outcome)[0]
    job = client.get(f"/v1/jobs/{its_id}").json()
    assert (job["state"], job["atlas"], job["error"]["code"]) == ("failed", None, "inadmissible_potential")
    assert client.get(f"/v1/atlases/{its_id}").status_code == 404
    in_order(database)


def test_it_needs_the_role_submit_and_is_charged_to_its_key(client, jobs, database):
    owner, reader = (make(database, role) for role in (Role.SUBMIT, Role.READ))
    assert client.post("/v1/atlases", json=ATLAS, headers={**ASYNC, **reader[1]}).status_code == 403
    its_id = submit(client, **owner[1])
    work(jobs)
    assert client.get(f"/v1/atlases/{its_id}", headers=reader[1]).status_code == 200
    assert client.get("/v1/atlases", headers=reader[1]).json()["total"] == 1

    def stored():
        return {key.id: key.stored_bytes for key in KeyStore(database).all().keys}[owner[0].id]

    assert stored() > 0
    in_order(database)
    assert client.delete(f"/v1/jobs/{its_id}", headers=owner[1]).status_code == 204
    assert stored() == 0
