"""POST /v1/sweeps and /v1/jobs with ?estimate=true: what it would cost, and nothing stored."""

import pytest

from service.jobs.kernels import Kernels
from service.local.workers import WorkerProcess
from service.storage.upkeep.presence import WorkerRegistry
from tests.support.api import PLANAR
from tests.support.sweeps import SWEEP

pytestmark = pytest.mark.any_database


def stored(client):
    return [client.get(f"/v1/{name}").json()["total"] for name in ("jobs", "sweeps", "solutions")]


@pytest.mark.parametrize("document", [PLANAR, [PLANAR, PLANAR]])
def test_the_estimate_of_problems_stores_nothing(client, document):
    answer = client.post("/v1/jobs?estimate=true", json=document)
    found = answer.json()
    assert answer.status_code == 200, found
    assert found["points"] == (len(document) if isinstance(document, list) else 1)
    assert found["tier"] in ("draft", "standard", "high", "certified")
    assert found["seconds"] > 0.0
    assert found["bytes"] > 0
    assert (found["ready_in"], found["refused"]) == (None, [])
    assert stored(client) == [0, 0, 0]


def test_the_estimate_of_a_sweep_stores_nothing(client):
    answer = client.post("/v1/sweeps?estimate=true", json=SWEEP)
    found = answer.json()
    assert answer.status_code == 200, found
    sent = client.post("/v1/sweeps", json=SWEEP).json()
    assert found["points"] == sent["points"]
    assert stored(client) == [0, 1, 0]


def test_an_estimate_uses_up_no_key_of_a_repetition(client):
    headers = {"Idempotency-Key": "once"}
    for _ in range(2):
        estimated = client.post("/v1/sweeps?estimate=true", json=SWEEP, headers=headers)
        assert "Idempotency-Replayed" not in estimated.headers
    assert client.post("/v1/sweeps", json=SWEEP, headers=headers).status_code == 202


@pytest.mark.parametrize(
    ("path", "document"),
    [
        ("/v1/jobs", {**PLANAR, "body": {"A": 0, "C": 1}}),
        ("/v1/jobs", {**PLANAR, "potential": {"type": "gravity", "a": -1, "b": 1}}),
        ("/v1/jobs", []),
        ("/v1/jobs", [{**PLANAR, "potential": {"type": "gravity", "a": -1, "b": 1}}]),
        ("/v1/sweeps", {**SWEEP, "axes": []}),
        ("/v1/sweeps", {**SWEEP, "priority": 3000}),
    ],
)
def test_refusals_are_those_of_the_post(client, path, document):
    estimated, posted = client.post(f"{path}?estimate=true", json=document), client.post(path, json=document)
    assert estimated.status_code == posted.status_code == 422
    ours, theirs = estimated.json(), posted.json()
    for each in (ours, theirs):
        each.pop("request_id")
        for item in each.get("items", []):
            item["problem"].pop("request_id", None)
    assert ours == theirs


def test_of_a_list_the_refused_problems_are_told_by_their_places(client):
    bad = {**PLANAR, "body": {"A": 0, "C": 1}}
    found = client.post("/v1/jobs?estimate=true", json=[PLANAR, bad, PLANAR]).json()
    assert found["points"] == 2
    assert [(item["index"], item["problem"]["errors"][0]["pointer"]) for item in found["refused"]] == [
        (1, "/body/A")
    ]


def test_kernels_that_are_still_compiled_are_told(client, database):
    registry = WorkerRegistry(database, lease_seconds=10)
    registry.see(WorkerProcess("cold", "here", "local", 1), is_warm=False, kernels=Kernels(1, 9, 30.0))
    assert client.post("/v1/sweeps?estimate=true", json=SWEEP).json()["ready_in"] == 30.0
