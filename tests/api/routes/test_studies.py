"""Studies: asked by a POST, computed by a job, stored, listed, cancelled and deleted as other jobs."""

import json
from concurrent.futures import ThreadPoolExecutor

import pytest
from sqlalchemy import select

from service.jobs.keys import Role
from service.storage.inspection.inspect import inspect
from service.storage.keys import KeyStore
from service.storage.tables.jobs import ResultRow
from tests.support.keys import make
from workers.process.tasks import study

BASE = {
    "body": {"A": 2, "C": 1},
    "potential": {"type": "expression", "expression": "-g1 + 1/(20*g3^2)"},
    "motion": {"type": "planar"},
}
SEARCH = {
    "base": BASE,
    "unknowns": [{"pointer": "/motion/lambda", "interval": ["99/100", "101/100"]}],
    # h = λ²/2 − 1/(10 λ⁴) (theory 3.3), which is 2/5 at λ = 1.
    "wanted": [{"of": "energy", "equals": "2/5"}],
}
ASYNC = {"Prefer": "respond-async"}


def submit(client, document=SEARCH, **headers):
    answer = client.post("/v1/searches", json=document, headers={**ASYNC, **headers})
    assert answer.status_code == 202, answer.text
    job = answer.json()
    assert answer.headers["location"] == f"/v1/jobs/{job['id']}"
    assert (job["state"], job["result"], job["solution"]) == ("queued", None, None)
    assert job["problem"] == {"what": "numbers", **document}
    return job["id"]


def work(jobs):
    """Do a worker's work for the oldest job."""
    claim = jobs.claim("test", lease_seconds=60.0)
    assert jobs.finish(claim, study(json.dumps(claim.payload)))[0]
    return claim.job_id


def ask_and_wait(client, jobs, document):
    """Ask, let a worker answer meanwhile, and return what the waiting client is told, with the job's id."""
    with ThreadPoolExecutor(1) as pool:
        asking = pool.submit(client.post, "/v1/searches", json=document, headers={"Prefer": "wait=30"})
        while not client.get("/v1/jobs?kind=study").json()["items"]:
            pass
        its_id = work(jobs)
        client.app.state.resources.wake_up.announce(its_id)
        return asking.result(), its_id


@pytest.mark.any_database
def test_a_study_lives_as_a_job_with_its_result(client, jobs, database):
    its_id = submit(client)
    assert client.get(f"/v1/jobs/{its_id}/result").status_code == 404
    work(jobs)
    job = client.get(f"/v1/jobs/{its_id}").json()
    assert (job["state"], job["progress"], job["atlas"]) == ("succeeded", 1.0, None)
    (found,) = job["result"]["solutions"]
    assert found["proof"] == "proved"
    assert float(found["values"]["/motion/lambda"]["value"]) == pytest.approx(1.0, abs=1e-15)
    assert job["result"]["rest"] == "proved_empty"
    stored = client.get(f"/v1/jobs/{its_id}/result")
    assert stored.json() == job["result"]
    assert not stored.headers["etag"].startswith("W/")
    assert "immutable" in stored.headers["cache-control"]
    again = client.get(f"/v1/jobs/{its_id}/result", headers={"If-None-Match": stored.headers["etag"]})
    assert again.status_code == 304
    assert client.get(f"/v1/atlases/{its_id}").status_code == 404
    lines = client.get(f"/v1/jobs/{its_id}/events").text.splitlines()
    told = next(line for line in lines if line.startswith("data: {"))
    assert json.loads(told.removeprefix("data: ")) == job
    assert [finding.code for finding in inspect(database) if finding.broken] == []
    assert client.delete(f"/v1/jobs/{its_id}").status_code == 204
    assert client.get(f"/v1/jobs/{its_id}/result").status_code == 404
    with database.read() as session:
        assert session.scalars(select(ResultRow.job_id)).all() == []


@pytest.mark.any_database
def test_studies_are_listed_by_their_kind_and_marked_with_labels(client, jobs):
    its_id = submit(client)
    assert client.get("/v1/jobs").json()["items"] == []
    (listed,) = client.get("/v1/jobs?kind=study&state=queued").json()["items"]
    assert listed["id"] == its_id
    patch = client.patch(
        f"/v1/jobs/{its_id}",
        content=json.dumps({"labels": {"project": "thesis"}}),
        headers={"Content-Type": "application/merge-patch+json"},
    )
    assert patch.status_code == 200
    assert client.get("/v1/jobs?kind=study&where=label.project=thesis").json()["items"][0]["id"] == its_id
    work(jobs)
    (listed,) = client.get("/v1/jobs?kind=study").json()["items"]
    assert listed["result"]["rest"] == "proved_empty"
    assert client.get("/v1/jobs?kind=chunk").status_code == 422


def test_a_waiting_client_gets_the_answer_itself(client, jobs):
    answer, its_id = ask_and_wait(client, jobs, SEARCH)
    assert answer.status_code == 200
    assert answer.json() == client.get(f"/v1/jobs/{its_id}").json()["result"]


def test_a_waiting_client_is_told_why_a_base_has_no_answer(client, jobs):
    inadmissible = {**SEARCH, "base": {**BASE, "potential": {"type": "gravity", "a": 1, "b": 1}}}
    answer, its_id = ask_and_wait(client, jobs, inadmissible)
    assert answer.status_code == 422
    assert answer.json()["type"] == "urn:polhode:problem:inadmissible_potential"
    assert answer.json()["errors"][0]["pointer"] == "/base/potential"
    assert client.get(f"/v1/jobs/{its_id}").json()["state"] == "failed"


def test_a_cancelled_study_never_succeeds(client, jobs):
    its_id = submit(client)
    claim = jobs.claim("test", lease_seconds=60.0)
    assert client.post(f"/v1/jobs/{its_id}/cancel").json()["state"] == "cancelled"
    assert not jobs.finish(claim, study(json.dumps(claim.payload)))[0]
    assert client.get(f"/v1/jobs/{its_id}/result").status_code == 404


def test_a_key_needs_the_role_and_pays_for_what_is_stored(client, jobs, database):
    (_, reading), (owner, owning) = make(database, Role.READ), make(database, Role.SUBMIT)
    assert client.post("/v1/searches", json=SEARCH, headers=reading).status_code == 403
    its_id = submit(client, **owning)
    work(jobs)
    assert stored_bytes(database, owner) > 0
    assert [finding.code for finding in inspect(database) if finding.broken] == []
    assert client.delete(f"/v1/jobs/{its_id}", headers=reading).status_code == 403
    assert client.delete(f"/v1/jobs/{its_id}", headers=owning).status_code == 204
    assert stored_bytes(database, owner) == 0


HEAVY = {"type": "expression", "expression": "k*g1", "parameters": {"k": None}}
KOVALEVSKAYA = {
    "body": {"A": "2*C", "B": "2*C"},
    "potential": HEAVY,
    "function": "(p^2 - q^2 - k*g1/C)^2 + (2*p*q - k*g2/C)^2",
}


LARGE = "(p + q + r + g1 + g2 + g3 + 1)^40"
LARGE_SEARCH = {
    "potential": {"type": "expression", "expression": "(g1 + g2 + g3 + 1)^200"},
    "degree": {"omega": 2, "gamma": 1},
}
SMALL_SEARCH = {"potential": HEAVY, "degree": {"omega": 2, "gamma": 1}}
POWERS = {
    **SMALL_SEARCH,
    "potential": {"type": "expression", "expression": "(k + 1)^300*g2", "parameters": {"k": None}},
}
TOO_HIGH = {"potential": HEAVY, "degree": {"omega": 99, "gamma": 2}}


def test_integrals_are_judged_at_once_and_by_a_job_with_one_answer(client, jobs):
    answer = client.post("/v1/integrals", json=KOVALEVSKAYA)
    assert answer.status_code == 200, answer.text
    found = answer.json()
    assert (found["verdict"], found["holds"], found["name"]) == ("integral", "always", "kovalevskaya")
    job = client.post("/v1/integrals", json=KOVALEVSKAYA, headers=ASYNC)
    assert job.status_code == 202
    assert work(jobs) == job.json()["id"]
    assert client.get(f"/v1/jobs/{job.json()['id']}/result").json() == found


def test_integrals_and_potentials_are_searched(client):
    body = {"A": 2, "B": 2, "C": 1}
    asked = {"body": body, "potential": {**HEAVY, "parameters": {"k": 1}}, "degree": {"omega": 2, "gamma": 1}}
    found = client.post("/v1/integrals/searches", json=asked).json()
    # Kovalevskaya's integral has the degree 4 in the velocities.
    assert (found["integrals"], found["complete"]) == ([], True)
    found = client.post("/v1/potentials/searches", json={"body": {"A": 2, "C": 1}, "degree": 1}).json()
    # The constant, and g1 of Bobylev and Steklov's case (theory 1.4).
    assert [each["expression"] for each in found["potentials"]] == ["1", "g1"]


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("path", "document", "pointer", "code"),
    [
        ("integrals", {**KOVALEVSKAYA, "areas": 1}, "/areas", "out_of_range"),
        ("integrals", {**KOVALEVSKAYA, "body": {"A": -1}}, "/body/A", "invalid_inertia"),
        ("integrals", {**KOVALEVSKAYA, "function": "p^2 + x"}, "/function", "formula"),
        ("integrals/searches", TOO_HIGH, "/degree/omega", "out_of_range"),
        ("potentials/searches", {"body": {"A": 2}, "degree": 2}, "/body/C", "missing_field"),
        ("integrals", {**KOVALEVSKAYA, "relations": ["q", LARGE]}, "/relations/1", "too_many_terms"),
        ("integrals/searches", LARGE_SEARCH, "/potential/expression", "too_many_terms"),
        ("integrals/searches", {**SMALL_SEARCH, "body": {"A": "(B + C)^300"}}, "/body/A", "too_many_terms"),
        ("integrals/searches", {**SMALL_SEARCH, "body": {"B": "(C^1000)^20"}}, "/body/B", "too_many_terms"),
        ("integrals/searches", POWERS, "/potential/expression", "too_many_terms"),
    ],
)  # fmt: skip
def test_faults_of_questions_have_their_pointers(client, path, document, pointer, code):
    answer = client.post(f"/v1/{path}", json=document)
    assert answer.status_code == 422
    assert [(each["pointer"], each["code"]) for each in answer.json()["errors"]] == [(pointer, code)]


def stored_bytes(database, owner):
    return next(key.stored_bytes for key in KeyStore(database).all().keys if key.id == owner.id)


def faults(client, **changes):
    answer = client.post("/v1/searches", json={**SEARCH, **changes}, headers=ASYNC)
    assert answer.status_code == 422, answer.text
    return {fault["pointer"]: fault["code"] for fault in answer.json()["errors"]}


def test_every_fault_has_its_pointer(client):
    unknown = SEARCH["unknowns"][0]
    backwards = {**unknown, "interval": [2, 1]}
    assert faults(client, unknowns=[backwards]) == {"/unknowns/0/interval/1": "out_of_range"}
    assert faults(client, unknowns=[unknown] * 2) == {
        "/wanted": "unequal_lengths",
        "/unknowns/1/pointer": "pointer_taken",
    }
    elsewhere = {**unknown, "pointer": "/potential/parameters/b"}
    assert faults(client, unknowns=[elsewhere]) == {"/unknowns/0/pointer": "unknown_pointer"}
    of_time = {**unknown, "pointer": "/time/samples"}
    assert faults(client, unknowns=[of_time]) == {"/unknowns/0/pointer": "unknown_pointer"}
    assert faults(client, wanted=[{"of": "mass", "equals": 1}]) == {"/wanted/0/of": "invalid_value"}
    assert faults(client, wanted=[{"of": "period", "equals": "2*g1"}]) == {"/wanted/0/equals": "formula"}
    endless = [{"of": "period", "equals": "exp(exp(exp(10)))"}]
    assert faults(client, wanted=endless) == {"/wanted/0/equals": "out_of_range"}
    assert faults(client, base={**BASE, "body": {"A": 2, "C": 2}}) == {"/base/body": "equal_moments"}
    negative = {**unknown, "interval": [-1, 2]}
    assert faults(client, unknowns=[negative]) == {"/unknowns/0/interval/0": "out_of_range"}
    assert faults(client, unknowns=[{**unknown, "interval": [1, 1e300]}]) == {
        "/unknowns/0/interval/1": "out_of_range"
    }
    assert faults(client, wanted=[{"of": "trace", "equals": 2}]) == {"/base/body/B": "missing_moment"}
