"""Audits: a stored solution is solved again, and what is stored is confirmed or contradicted."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from sqlalchemy import select, update

from service.jobs.keys import Role
from service.storage.codecs.packing import decode_arrays, decode_dense, encode_arrays, encode_dense
from service.storage.database.rows import new_id
from service.storage.inspection.inspect import inspect
from service.storage.keys import KeyStore
from service.storage.tables.jobs import AuditRow
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionRow
from tests.support.api import PLANAR, STATE, solve_job
from tests.support.keys import make
from workers.process.tasks import solve_problem

SHORT = {**PLANAR, "time": {"stop": 10, "samples": 5}}
RICH = {
    **PLANAR,
    "time": {"periods": 3, "samples": 7},
    "outputs": ["gamma", "omega", "invariants", "orientation", "stability"],
}


def work(jobs):
    """Do a worker's work for the oldest job."""
    claim = jobs.claim("test", lease_seconds=60.0)
    outcome = solve_problem(json.dumps(claim.payload), claim.windows, claim.audited)
    assert jobs.finish(claim, outcome)[0]
    return claim.job_id


def audit(client, jobs, solution, document=None, **headers):
    """Audit a solution, and return the audit when it has ended."""
    path = f"/v1/solutions/{solution['id']}/audits"
    answer = client.post(path, json=document, headers=headers)
    assert answer.status_code == 202, answer.text
    begun = answer.json()
    assert answer.headers["location"] == f"{path}/{begun['id']}"
    assert (begun["state"], begun["verdict"], begun["comparison"]) == ("queued", None, None)
    assert work(jobs) == begun["id"]
    return client.get(answer.headers["location"], headers=headers).json()


def in_order(database):
    assert [finding.code for finding in inspect(database) if finding.broken] == []


def test_the_same_again_has_the_same_bits(client, jobs, database):
    solution = solve_job(client, jobs, SHORT)
    # A document and no body at all say the same.
    for document in ({}, None, {"accuracy": {"tier": "standard"}}, {"method": None}):
        found = audit(client, jobs, solution, document)
        assert (found["verdict"], found["comparison"]["identical"]) == ("agrees", True)
        assert {each["share"] for each in found["comparison"]["differences"].values()} == {0.0}
        assert found["found"] not in (None, solution["id"])
        new = client.get(f"/v1/solutions/{found['found']}").json()
        assert new["provenance"] == solution["provenance"] == found["comparison"]["stored"]["provenance"]
    in_order(database)


@pytest.mark.one_in(3)
@pytest.mark.any_database
@pytest.mark.parametrize("tier", ["draft", "standard", "high", "certified"])
@pytest.mark.parametrize("problem", [SHORT, RICH], ids=["short", "rich"])
def test_an_honest_solution_agrees_with_every_tier(client, jobs, problem, tier):
    solution = solve_job(client, jobs, problem)
    found = audit(client, jobs, solution, {"accuracy": {"tier": tier}})
    compared = found["comparison"]
    assert (found["verdict"], compared["found"]["tier"]) == ("agrees", tier), found
    wanted = {"period", "energy", "function", "samples"} | (
        {"trace", "psi1", "psi3"} if problem is RICH else set()
    )
    assert set(compared["differences"]) == wanted
    assert all(each["difference"] <= each["allowed"] for each in compared["differences"].values())


@pytest.mark.any_database
@pytest.mark.parametrize("method", ["quadrature", "integration"])
def test_an_honest_solution_agrees_with_every_method(client, jobs, method):
    solution = solve_job(client, jobs, SHORT)
    found = audit(client, jobs, solution, {"method": method})
    assert (found["verdict"], found["comparison"]["found"]["method"]) == ("agrees", method), found
    assert found["comparison"]["differences"]["samples"]["share"] <= 1.0


def change(database, table, solution, **values):
    key = table.id if table is SolutionRow else table.solution_id
    with database.write() as session:
        session.execute(update(table).where(key == solution["id"]).values(**values))


def change_period(database, solution, by):
    summary = {name: value for name, value in solution.items() if name not in ("id", "job", "created_at")}
    period = {**summary["period"], "value": summary["period"]["value"] + by}
    change(database, SolutionRow, solution, summary={**summary, "period": period})


def change_sample(database, solution, by, place=3, column="g1"):
    with database.read() as session:
        statement = select(SamplesRow.data).where(SamplesRow.solution_id == solution["id"])
        columns = {name: values.copy() for name, values in decode_arrays(session.scalar(statement)).items()}
    columns[column][place] += by
    change(database, SamplesRow, solution, data=encode_arrays(columns))


def change_function(database, solution, by):
    with database.read() as session:
        statement = select(DenseOutputRow.data).where(DenseOutputRow.solution_id == solution["id"])
        dense = decode_dense(session.scalar(statement))
    coefficients = dense.coefficients.copy()
    coefficients[:, 0] += by
    change(database, DenseOutputRow, solution, data=encode_dense(replace(dense, coefficients=coefficients)))


def damage(database, solution, by):
    change(database, DenseOutputRow, solution, data=b"damaged")


CHANGES = {
    "period": change_period,
    "samples": change_sample,
    "a time": partial(change_sample, column="t"),
    "function": change_function,
    "no number": lambda database, solution, by: change_sample(database, solution, np.nan),
    "": damage,
}


@pytest.mark.one_in(3)
@pytest.mark.any_database
@pytest.mark.parametrize("changed", CHANGES)
@pytest.mark.parametrize("document", [{}, {"accuracy": {"tier": "high"}}], ids=["same", "higher"])
def test_what_was_changed_in_the_database_disagrees(client, jobs, database, changed, document):
    solution = solve_job(client, jobs, SHORT)
    # Of what is claimed, about 1e-14, it is a thousand times the sum.
    CHANGES[changed](database, solution, 1e-10)
    found = audit(client, jobs, solution, document)
    assert found["verdict"] == "disagrees", found
    assert not found["comparison"]["identical"]
    differences = found["comparison"]["differences"]
    part = {"a time": "samples", "no number": "samples"}.get(changed, changed)
    apart = {name for name, each in differences.items() if each["share"] is None or each["share"] > 1.0}
    assert apart == ({part} if part else set())


def test_one_that_cannot_be_solved_again_has_failed_with_its_reason(client, jobs, database):
    solution = solve_job(client, jobs, STATE)
    found = audit(client, jobs, solution, {"accuracy": {"tolerance": 1e-15}})
    assert (found["state"], found["verdict"], found["found"]) == ("failed", "failed", None)
    assert found["error"]["code"] == "accuracy_not_met"
    in_order(database)


def test_what_cannot_be_asked_for_is_refused_with_all_faults(client, jobs):
    solution = solve_job(client, jobs, SHORT)
    path = f"/v1/solutions/{solution['id']}/audits"
    document = {"accuracy": {"tier": "best"}, "method": "guessing", "motion": {}}
    answer = client.post(path, json=document)
    assert answer.status_code == 422
    faults = {fault["pointer"]: fault["code"] for fault in answer.json()["errors"]}
    assert faults == {
        "/accuracy/tier": "invalid_value",
        "/method": "invalid_value",
        "/motion": "unknown_field",
    }
    assert client.post(path, json=[]).status_code == 422
    assert client.post(path, content=b"{", headers={"Content-Type": "application/json"}).status_code == 400
    assert client.post(path, content=b"{}", headers={"Content-Type": "text/plain"}).status_code == 415


def test_what_there_is_not_is_not_audited(client, jobs, stored):
    for wrong in ("none", new_id()):
        for path in (f"{wrong}/audits", f"{wrong}/audits/{wrong}", f"{stored.solution_id}/audits/{wrong}"):
            assert client.get(f"/v1/solutions/{path}").status_code == 404
        assert client.post(f"/v1/solutions/{wrong}/audits").status_code == 404
    # The job that made a solution is no audit of it.
    assert client.get(f"/v1/solutions/{stored.solution_id}/audits/{stored.job.id}").status_code == 404


def test_an_audit_is_a_job_that_lives_as_others(client, jobs):
    solution = solve_job(client, jobs, SHORT)
    path = f"/v1/solutions/{solution['id']}/audits"
    first = client.post(path, headers={"Idempotency-Key": "a"})
    again = client.post(path, headers={"Idempotency-Key": "a"})
    assert again.headers["idempotency-replayed"] == "true"
    assert again.content == first.content
    lost = jobs.claim("one", lease_seconds=60.0)
    assert jobs.lose(lost, "its child died", max_attempts=3, retry_seconds=0.0)
    work(jobs)
    its_id = first.json()["id"]
    assert client.get(f"{path}/{its_id}").json()["verdict"] == "agrees"
    assert [each["outcome"] for each in client.get(f"/v1/jobs/{its_id}/attempts").json()["items"]] == [
        "lost",
        "succeeded",
    ]
    cancelled = client.post(path).json()["id"]
    assert client.post(f"/v1/jobs/{cancelled}/cancel").status_code == 200
    assert [client.get(f"{path}/{cancelled}").json()[name] for name in ("state", "verdict")] == [
        "cancelled",
        None,
    ]
    # Asked as jobs are.
    assert [each["id"] for each in client.get(path).json()["items"]] == [cancelled, its_id]
    page = client.get(path, params={"limit": 1, "where": "state=succeeded", "columns": "id,period"}).json()
    assert page["items"] == [{"id": its_id, "period": solution["period"]["value"]}]
    assert (
        client.get(path + client.get(path, params={"limit": 1}).json()["next"]).json()["items"][0]["id"]
        == its_id
    )


def test_an_equal_problem_still_reuses_the_first_solution(client, jobs):
    solution = solve_job(client, jobs, SHORT)
    audit(client, jobs, solution)
    job = client.post("/v1/jobs", json=SHORT).json()
    assert (job["reused"], job["solution"]) == (True, solution["id"])


def test_it_goes_with_either_of_the_two_solutions(client, jobs, database):
    one, two = solve_job(client, jobs, SHORT), solve_job(client, jobs, STATE)
    kept, found = audit(client, jobs, one), audit(client, jobs, two)
    live = client.post(f"/v1/solutions/{one['id']}/audits").json()["id"]
    refused = client.delete(f"/v1/solutions/{one['id']}")
    assert (refused.status_code, refused.json()["referrers"]) == (409, [f"/v1/jobs/{live}"])
    client.post(f"/v1/jobs/{live}/cancel")
    assert client.delete(f"/v1/solutions/{one['id']}").status_code == 204
    assert client.get(f"/v1/solutions/{kept['found']}").status_code == 200
    assert client.delete(f"/v1/solutions/{found['found']}").status_code == 204
    assert client.get(f"/v1/solutions/{two['id']}/audits").json()["items"] == []
    with database.read() as session:
        assert session.scalars(select(AuditRow.job_id)).all() == []
    in_order(database)


def test_it_needs_the_role_submit_and_is_charged_to_its_key(client, jobs, database):
    owner, auditor, reader = (make(database, role) for role in (Role.SUBMIT, Role.SUBMIT, Role.READ))
    assert client.post("/v1/jobs", json=SHORT, headers=owner[1]).status_code == 202
    work(jobs)
    (solution,) = client.get("/v1/solutions", headers=reader[1]).json()["items"]
    path = f"/v1/solutions/{solution['id']}/audits"
    assert client.post(path, headers=reader[1]).status_code == 403
    assert audit(client, jobs, solution, **auditor[1])["verdict"] == "agrees"
    assert client.get(path, headers=reader[1]).status_code == 200
    stored = {key.id: key.stored_bytes for key in KeyStore(database).all().keys}
    assert stored[auditor[0].id] == stored[owner[0].id] > 0
    in_order(database)
