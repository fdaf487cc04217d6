"""DELETE: what has ended and nobody refers to is gone with everything that belongs to it."""

import threading

import pytest
from sqlalchemy import func, select

from service.jobs.keys import Role
from service.storage.database.rows import new_id
from service.storage.inspection.inspect import inspect
from service.storage.jobs.job_store import JobStore
from service.storage.keys import KeyStore
from service.storage.tables.operations import TABLES, ApiKeyRow
from service.storage.upkeep.retention import delete_solution
from tests.support.api import STATE, finish
from tests.support.keys import make
from tests.support.lists import list_jobs
from tests.support.sweeps import SWEEP, finish_chunk, finish_sweep

OTHER = {**STATE, "time": {"stop": 21, "samples": 3}}


def census(database):
    """Count the rows of every table, but those of keys and of services."""
    with database.read() as session:
        return {
            table.__tablename__: count
            for table in TABLES
            if table.__tablename__ not in ("api_keys", "workers")
            and (count := session.scalar(select(func.count()).select_from(table)))
        }


def submit(client, document=STATE, path="/v1/jobs", **headers):
    answer = client.post(path, json=document, headers=headers)
    assert answer.status_code == 202
    return f"{path}/{answer.json()['id']}"


def refused(answer, code):
    assert (answer.status_code, answer.json()["type"]) == (409, f"urn:polhode:problem:{code}"), answer.text
    return answer.json()


def gone(client, path, **headers):
    answer = client.delete(path, headers=headers)
    assert (answer.status_code, answer.content) == (204, b""), answer.text
    assert client.get(path, headers=headers).status_code == 404
    assert client.delete(path, headers=headers).status_code == 404


def in_order(database):
    assert [finding.code for finding in inspect(database) if finding.broken] == []


def test_a_solution_goes_with_its_arrays_and_its_job(client, stored, database):
    path = f"/v1/solutions/{stored.solution_id}"
    assert refused(client.delete(f"/v1/jobs/{stored.job.id}"), "in_use")["referrers"] == [path]
    known = client.get(f"{path}/trajectory").headers["etag"]
    gone(client, path)
    assert client.get(f"{path}/trajectory", headers={"If-None-Match": known}).status_code == 404
    assert client.get(f"/v1/jobs/{stored.job.id}").status_code == 404
    assert census(database) == {}
    in_order(database)


def test_what_others_have_reused_stays_until_they_are_gone(client, stored, database):
    path, again = f"/v1/solutions/{stored.solution_id}", [submit(client) for _ in range(2)]
    assert refused(client.delete(path), "in_use")["referrers"] == again
    assert client.get(path).status_code == 200
    for job in again:
        gone(client, job)
    gone(client, path)
    assert census(database) == {}
    # The same problem is computed anew.
    assert client.get(submit(client)).json()["state"] == "queued"
    in_order(database)


def test_a_live_job_is_cancelled_first(client, jobs, database):
    queued, running = submit(client), submit(client, OTHER)
    assert jobs.claim("test", lease_seconds=60.0)
    for job in (queued, running):
        refused(client.delete(job), "not_finished")
        assert client.post(f"{job}/cancel").status_code == 200
        gone(client, job)
    failed = submit(client)
    jobs.finish_failure(jobs.claim("test", lease_seconds=60.0), {"code": "no_motion", "detail": "none"})
    gone(client, failed)
    assert census(database) == {}
    in_order(database)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("is_cancelled", [False, True])
def test_a_finished_sweep_goes_with_its_points_and_chunks(client, jobs, database, is_cancelled):
    sweep, kept = submit(client, SWEEP, "/v1/sweeps"), submit(client, OTHER)
    jobs.cancel(kept.rpartition("/")[2])
    before = census(database)
    refused(client.delete(sweep), "not_finished")
    finish_sweep(jobs, chunks=1 if is_cancelled else None)
    late = jobs.claim("test", lease_seconds=60.0) if is_cancelled else None
    if is_cancelled:
        client.post(f"{sweep}/cancel")
    gone(client, sweep)
    assert client.get(f"{sweep}/points").status_code == 404
    if late is not None:
        with pytest.raises(AssertionError):  # whoever computes a chunk of it stores nothing
            finish_chunk(jobs, late)
    assert census(database) == {"jobs": 1}
    assert before["sweeps"] == 1
    in_order(database)


def test_bytes_are_charged_as_long_as_they_are_stored(client, jobs, database):
    key, header = make(database, Role.SUBMIT)
    job, sweep = submit(client, **header), submit(client, SWEEP, "/v1/sweeps", **header)
    stored = finish(jobs)
    finish_sweep(jobs)
    assert KeyStore(database).all().keys[0].stored_bytes > 0
    assert client.get(job, headers=header).json()["solution"] == stored.solution_id
    gone(client, f"/v1/solutions/{stored.solution_id}", **header)
    in_order(database)
    gone(client, sweep, **header)
    in_order(database)
    with database.read() as session:
        assert session.scalar(select(ApiKeyRow.stored_bytes).where(ApiKeyRow.id == key.id)) == 0


def test_others_may_be_deleted_by_operators_only(client, jobs, database):
    owner, other, operator = (make(database, role)[1] for role in (Role.SUBMIT, Role.SUBMIT, Role.OPERATE))
    for holder in (owner, operator):
        submit(client, **owner)
        solution = f"/v1/solutions/{finish(jobs).solution_id}"
        job, sweep = submit(client, OTHER, **owner), submit(client, SWEEP, "/v1/sweeps", **owner)
        for path in (job, sweep):
            client.post(f"{path}/cancel", headers=owner)
        for path in (job, sweep, solution):
            answer = client.delete(path, headers=other)
            assert (answer.status_code, answer.json()["needed_role"]) == (403, "operate")
            gone(client, path, **holder)
    assert census(database) == {}


@pytest.mark.one_in(3)
@pytest.mark.parametrize("kind", ["jobs", "solutions", "sweeps"])
@pytest.mark.parametrize("its_id", ["none", None])
def test_what_is_not_there_cannot_be_deleted(client, kind, its_id):
    assert client.delete(f"/v1/{kind}/{its_id or new_id()}").status_code == 404


def test_a_chunk_is_deleted_with_its_sweep_only(client, jobs):
    submit(client, SWEEP, "/v1/sweeps")
    chunk = jobs.claim("test", lease_seconds=60.0)
    assert client.delete(f"/v1/jobs/{chunk.job_id}").status_code == 404


def test_who_reuses_a_solution_while_it_is_deleted_computes_it_or_keeps_it(client, jobs, database):
    """At each attempt one of them is first: there is never a job with a solution that is not there."""
    for _ in range(10):
        submit(client)
        solution_id = finish(jobs).solution_id
        digest = list_jobs(jobs).jobs[0].digest
        others, ready = JobStore(database), threading.Barrier(2)
        made = []

        def reuse(others=others, ready=ready, made=made, digest=digest):
            ready.wait()
            made.append(others.submit(STATE, digest))

        thread = threading.Thread(target=reuse)
        thread.start()
        ready.wait()
        answer = client.delete(f"/v1/solutions/{solution_id}")
        thread.join()
        assert answer.status_code == (409 if made[0].reused else 204)
        in_order(database)
        if made[0].reused:
            gone(client, f"/v1/jobs/{made[0].id}")
            delete_solution(database, solution_id)
        else:
            jobs.cancel(made[0].id)
            gone(client, f"/v1/jobs/{made[0].id}")
