"""/v1/sweeps: submit, list, show and cancel sweeps."""

import io
import json
from itertools import product

import numpy as np
import pyarrow.parquet as pq
import pytest

from service.app import create_app
from service.settings import Settings
from tests.support.api import TestClient
from tests.support.sweeps import BASE, POINTS, SWEEP, finish_chunk, finish_sweep, is_refused
from tests.workers.chores import SOURCE

pytestmark = pytest.mark.any_database


@pytest.fixture
def sweep(client):
    answer = client.post("/v1/sweeps", json=SWEEP)
    assert answer.status_code == 202, answer.json()
    return answer.json()


def test_a_sweep_is_accepted_with_its_place(client):
    answer = client.post("/v1/sweeps", json=SWEEP)
    document = answer.json()
    assert answer.status_code == 202
    assert answer.headers["Location"] == f"/v1/sweeps/{document['id']}"
    assert [document[name] for name in ("state", "points", "done", "refused")] == ["queued", POINTS, 0, 0]
    assert document["document"] == SWEEP
    assert client.get(answer.headers["Location"]).json() == document
    assert client.get("/v1/jobs").json()["total"] == 0


def test_its_numbers_grow_until_it_has_succeeded(client, jobs, sweep):
    place = f"/v1/sweeps/{sweep['id']}"
    finish_sweep(jobs, chunks=1)
    running = client.get(place).json()
    assert running["state"] == "running"
    assert 0 < running["done"] < POINTS
    assert running["progress"] == running["done"] / POINTS
    assert running["remaining_seconds"] is None  # the first chunk shows how workers start
    # As the worker of this test says; multiplied and divided by the number of points.
    assert running["point_seconds"] == pytest.approx(0.05, rel=1e-15)
    finish_sweep(jobs)
    done = client.get(place).json()
    assert (done["state"], done["done"], done["progress"]) == ("succeeded", POINTS, 1.0)
    assert done["refused"] == np.count_nonzero(is_refused(np.arange(POINTS)))
    assert done["remaining_seconds"] is None
    assert done["finished_at"] is not None


def test_it_tells_what_computed_its_points(client, jobs, sweep):
    old, new = ({**SOURCE, "processor": name} for name in ("old", "new"))
    asked = [{**old, "host": "a"}, {**new, "host": "b"}, {**old, "host": "c"}, {**old, "host": "a"}, None]
    place, told = f"/v1/sweeps/{sweep['id']}", {}
    for source in asked:
        claim = jobs.claim("bridge", lease_seconds=60.0)
        finish_chunk(jobs, claim, source=source)
        told[claim.job_id] = source
    # Each provenance once, however many hosts have it.
    (first, second) = client.get(place).json()["provenances"]
    names = {name: None for name in SOURCE if name != "host"}
    assert first == {**{name: old[name] for name in names}, "hosts": ["a", "c"]}
    assert second == {**{name: new[name] for name in names}, "hosts": ["b"]}
    done = client.get(f"{place}/jobs", params={"where": "state=succeeded"}).json()["items"]
    assert {each["id"]: (each["host"], each["provenance"]) for each in done} == {
        job: (None, None) if source is None else (source["host"], int(source["processor"] == "new"))
        for job, source in told.items()
    }
    graph = client.get(f"{place}/provenance").json()
    agents = {each["prov:label"] for each in graph["agent"].values()}
    assert agents == {"a", "b", "c", f"polhode {SOURCE['version']}", SOURCE["libraries"]}
    assert [each["polhode:processor"] for each in graph["activity"].values()] == ["old", "new"]
    finish_sweep(jobs)
    file = client.get(f"{place}/points", params={"format": "parquet"}).content
    about = json.loads(pq.read_schema(io.BytesIO(file)).metadata[b"polhode.provenance"])
    assert about["computed_by"] == [first, second]


def test_sweeps_are_listed_newest_first_without_their_documents(client, sweep):
    newest = client.post("/v1/sweeps", json=SWEEP).json()
    client.post(f"/v1/sweeps/{sweep['id']}/cancel")
    page = client.get("/v1/sweeps", params={"limit": 1}).json()
    assert [item["id"] for item in page["items"]] == [newest["id"]]
    assert (page["total"], page["limit"], page["offset"]) == (2, 1, 0)
    assert "document" not in page["items"][0]
    cancelled = client.get("/v1/sweeps", params={"state": "cancelled"}).json()
    assert [item["id"] for item in cancelled["items"]] == [sweep["id"]]


def test_a_cancelled_sweep_keeps_its_points(client, jobs, sweep):
    finish_sweep(jobs, chunks=1)
    held = jobs.claim("worker", lease_seconds=60.0)
    place = f"/v1/sweeps/{sweep['id']}"
    cancelled = client.post(f"{place}/cancel").json()
    assert (cancelled["state"], cancelled["done"]) == ("cancelled", 16)
    assert client.post(f"{place}/cancel").json() == cancelled
    with pytest.raises(AssertionError):
        finish_chunk(jobs, held)
    assert client.get(f"{place}/points").json()["total"] == 16


def test_what_has_succeeded_cannot_be_cancelled(client, jobs, sweep):
    finish_sweep(jobs)
    answer = client.post(f"/v1/sweeps/{sweep['id']}/cancel")
    assert (answer.status_code, answer.json()["type"]) == (409, "urn:polhode:problem:sweep_finished")


def test_what_is_not_there_is_not_found(client):
    ids = ("nonsense", "01890000-0000-7000-8000-000000000000")
    for sweep_id, path in product(ids, ("", "/cancel", "/points")):
        method = client.post if path == "/cancel" else client.get
        answer = method(f"/v1/sweeps/{sweep_id}{path}")
        assert (answer.status_code, answer.json()["type"]) == (404, "urn:polhode:problem:not_found")


def test_a_faulty_sweep_is_refused_with_every_place(client):
    document = {"base": {**BASE, "body": {"A": 2}}, "axes": [{"pointer": "/motion/lamda", "values": [1]}]}
    answer = client.post("/v1/sweeps", json=document)
    refusal = answer.json()
    assert (answer.status_code, refusal["type"]) == (422, "urn:polhode:problem:invalid_sweep")
    assert {(fault["pointer"], fault["code"]) for fault in refusal["errors"]} == {
        ("/base/body/C", "missing_field"),
        ("/axes/0/pointer", "unknown_pointer"),
    }
    assert client.get("/v1/sweeps").json()["total"] == 0


def test_a_first_point_without_a_motion_is_accepted(client):
    # With a > 0 there is no motion on this curve, and A g2 is not admissible at all.
    potential = {"type": "expression", "expression": "g1 + g2/10"}
    for base in (
        {**BASE, "potential": {**BASE["potential"], "parameters": {"a": 1, "b": 5}}},
        {**BASE, "potential": potential},
    ):
        axes = [{"pointer": "/motion/lambda", "values": [1, 2]}]
        assert client.post("/v1/sweeps", json={"base": base, "axes": axes}).status_code == 202


def test_priority_is_taken_over(client, jobs, sweep):
    urgent = client.post("/v1/sweeps", json={**SWEEP, "priority": 7.0}).json()
    assert urgent["priority"] == 7
    assert jobs.claim("worker", lease_seconds=60.0).sweep_id == urgent["id"]


def test_the_installation_limits_points_and_samples(url):
    settings = Settings(database_url=url, max_sweep_points=99, max_samples=2)
    with TestClient(create_app(settings)) as client:
        answer = client.post("/v1/sweeps", json=SWEEP)
        assert [fault["code"] for fault in answer.json()["errors"]] == ["too_many_points"]
        few = [{"pointer": "/motion/lambda", "values": [1]}]
        answer = client.post("/v1/sweeps", json={**SWEEP, "axes": few, "series": True})
        assert [fault["pointer"] for fault in answer.json()["errors"]] == ["/base/time"]
        assert client.post("/v1/sweeps", json={**SWEEP, "axes": few}).status_code == 202
