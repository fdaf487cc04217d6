"""What dashboards show: queue, workers, attempts with reasons, jobs of a sweep, solutions of a problem."""

import json
from dataclasses import asdict

import pytest
from sqlalchemy import update

from service.jobs.kernels import ClusterState, LeftOut
from service.local.workers import WorkerProcess
from service.storage.tables.base import DatabaseNow
from service.storage.tables.jobs import AttemptRow
from service.storage.tables.operations import WorkerRow
from service.storage.upkeep.presence import WorkerRegistry
from tests.support.api import STATE, finish
from tests.support.sweeps import POINTS, SWEEP, finish_sweep


def status(client):
    response = client.get("/v1/status")
    assert response.status_code == 200, response.json()
    return response.json()


def queue_of(client):
    return {(part["state"], part["kind"]): part["jobs"] for part in status(client)["queue"]}


def test_the_queue_is_told_by_state_and_age(client, jobs):
    assert queue_of(client) == {}
    for stop in (1, 2, 3):
        client.post("/v1/jobs", json={**STATE, "time": {"stop": stop, "samples": 3}})
    client.post("/v1/sweeps", json=SWEEP)
    assert queue_of(client) == {("queued", "solve"): 3, ("queued", "chunk"): 1}
    jobs.claim("w", lease_seconds=60.0)
    assert queue_of(client) == {("queued", "solve"): 2, ("running", "solve"): 1, ("queued", "chunk"): 1}
    # Submitted moments ago by the same clock; an hour would be another clock.
    assert all(0.0 <= part["oldest_seconds"] < 3600.0 for part in status(client)["queue"])


def test_workers_are_told_with_what_they_do(client, database, jobs):
    with database.write() as session:
        now = session.scalar(DatabaseNow().select())
        for name, seen in (("w", now - 2.0), ("gone", now - 3600.0)):
            row = {"name": name, "host": "h", "engine": "local", "slots": 2, "started_at": now - 9000.0}
            session.add(WorkerRow(**row, seen_at=seen))
    job_id = client.post("/v1/jobs", json=STATE).json()["id"]
    jobs.claim("w", lease_seconds=60.0)
    (worker,) = [each for each in status(client)["workers"] if each["engine"] == "local"]
    assert (worker["name"], worker["host"], worker["slots"]) == ("w", "h", 2)
    assert worker["silent_seconds"] >= 2.0
    (running,) = worker["running"]
    assert running.pop("seconds") >= 0.0
    assert running == {"id": job_id, "kind": "solve", "sweep": None, "attempt": 1}


def test_the_cluster_on_which_a_worker_computes_is_told_everywhere(client, database):
    assert "cluster" not in client.get("/readyz").json()
    state = ClusterState("tcp://s:8786", True, 3, 24, (LeftOut("tcp://w:1", "its numerics is 3"),), None)
    registry = WorkerRegistry(database, lease_seconds=60.0)
    registry.see(WorkerProcess("bridge", "h", "postgres", 1), is_warm=True, cluster=state)
    told = json.loads(json.dumps(asdict(state)))
    assert client.get("/readyz").json()["cluster"] == told
    (worker,) = [each for each in status(client)["workers"] if each["name"] == "bridge"]
    assert (worker["cluster"], worker["slots"]) == (told, 24)
    metrics = client.get("/metrics").text
    for name, value in (("workers", 3), ("threads", 24), ("left_out", 1)):
        assert f'polhode_cluster_{name}{{scheduler="tcp://s:8786"}} {value}.0' in metrics


def test_attempts_that_ended_lately_are_counted_by_outcome(client, jobs):
    client.post("/v1/jobs", json=STATE)
    claim = jobs.claim("w", lease_seconds=60.0)
    jobs.lose(claim, "the child died", max_attempts=3)
    finish(jobs)
    for rate in status(client)["rates"]:
        assert (rate["succeeded"], rate["lost"], rate["failed"]) == (1, 1, 0)
    assert [rate["minutes"] for rate in status(client)["rates"]] == [1, 5, 15]


def test_results_are_counted_minute_by_minute(client, jobs, database):
    for ago in (30.0, 90.0, 100.0, 890.0, 910.0):  # the last is older than 15 minutes
        client.post("/v1/jobs", json={**STATE, "time": {"stop": ago, "samples": 3}})
        attempt = finish(jobs).job.id
        with database.write() as session:
            change = update(AttemptRow).where(AttemptRow.job_id == attempt)
            session.execute(change.values(ended_at=AttemptRow.ended_at - ago))
    found = status(client)
    assert found["succeeded_by_minute"] == [1, *[0] * 12, 2, 1]
    assert [rate["succeeded"] for rate in found["rates"]] == [1, 3, 4]


def test_attempts_have_their_reasons(client, jobs):
    job_id = client.post("/v1/jobs", json=STATE).json()["id"]
    path = f"/v1/jobs/{job_id}/attempts"
    assert client.get(path).json() == {"items": []}
    jobs.lose(jobs.claim("first", lease_seconds=60.0), "the child died", max_attempts=3)
    jobs.claim("second", lease_seconds=60.0)
    lost, running = client.get(path).json()["items"]
    assert (lost["number"], lost["worker"], lost["outcome"], lost["detail"]) == (
        1, "first", "lost", "the child died",
    )  # fmt: skip
    assert (running["number"], running["worker"], running["outcome"], running["ended_at"]) == (
        2, "second", None, None,
    )  # fmt: skip
    assert client.get("/v1/jobs/x/attempts").status_code == 404


def test_a_sweep_has_its_jobs(client, jobs):
    first, other = (client.post("/v1/sweeps", json=SWEEP).json()["id"] for _ in range(2))
    finish_sweep(jobs)
    for sweep_id in (first, other):
        page = client.get(f"/v1/sweeps/{sweep_id}/jobs?order=id&limit=200").json()
        ranges = [(item["first"], item["count"]) for item in page["items"]]
        assert page["total"] == len(ranges) > 1
        # Together they are all points, each once.
        assert sorted(index for start, count in ranges for index in range(start, start + count)) == list(
            range(POINTS)
        )
        assert {item["state"] for item in page["items"]} == {"succeeded"}
    found = client.get(f"/v1/sweeps/{first}/jobs?where=state=queued&count=exact").json()
    assert (found["items"], found["total"]) == ([], 0)
    assert client.get("/v1/sweeps/x/jobs").status_code == 404


@pytest.mark.any_database
def test_a_problem_has_its_solutions(client, jobs):
    client.post("/v1/jobs", json=STATE)
    stored = finish(jobs)
    client.post("/v1/jobs", json={**STATE, "time": {"stop": 3, "samples": 3}})
    finish(jobs)
    page = client.get("/v1/jobs", params={"columns": "id,digest", "where": f"id={stored.job.id}"}).json()
    (row,) = page["items"]
    found = client.get(f"/v1/problems/{row['digest']}/solutions").json()
    assert [item["id"] for item in found["items"]] == [stored.solution_id]
    assert found["total"] == 1
    for digest in ("0" * 64, "x", "a%00"):
        assert client.get(f"/v1/problems/{digest}/solutions").json()["items"] == []
