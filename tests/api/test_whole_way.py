"""From a request to the trajectory of a solution that was really computed."""

import json

import numpy as np
import pytest

from tests.support.api import PLANAR, STATE
from workers.computation import solve_document


def solve(client, jobs, problem):
    assert client.post("/v1/jobs", json=problem).status_code == 202
    claim = jobs.claim("test", lease_seconds=60.0)
    outcome = solve_document(json.dumps(claim.problem))
    assert outcome.error is None
    assert jobs.finish_success(claim, outcome.summary, dense=outcome.dense, samples=outcome.samples)
    solution_id = client.get(f"/v1/jobs/{claim.job_id}").json()["solution"]
    response = client.get(f"/v1/solutions/{solution_id}")
    assert response.status_code == 200, response.json()
    return response.json()


def trajectory(client, solution, query=""):
    response = client.get(f"/v1/solutions/{solution['id']}/trajectory{query}")
    assert response.status_code == 200, response.json()
    document = response.json()
    return {name: np.array(values) for name, values in document["columns"].items()}, document["error"]


@pytest.mark.parametrize(
    "problem",
    [{**PLANAR, "method": "both", "outputs": ["gamma", "omega", "invariants"]}, STATE],
    ids=["quadrature", "integration"],
)
def test_samples_asked_for_later_are_those_that_were_stored(client, jobs, problem):
    solution = solve(client, jobs, problem)
    stored, _ = trajectory(client, solution)
    stop, samples = problem["time"]["stop"], problem["time"]["samples"]
    later, error = trajectory(client, solution, f"?stop={stop}&samples={samples}")
    assert stored.keys() == later.keys()
    for name, values in stored.items():
        # Both come from the same dense output; times may differ by a rounding.
        assert np.abs(values - later[name]).max() <= 2 * error + 1e-14
    # The geometric integral: three squares, each of twice the claimed error at most.
    assert np.abs(sum(later[g] ** 2 for g in ("g1", "g2", "g3")) - 1).max() <= 6 * error + 1e-15


def test_an_integrated_solution_ends_where_it_was_asked_to(client, jobs):
    solution = solve(client, jobs, STATE)
    response = client.get(f"/v1/solutions/{solution['id']}/trajectory?stop=21&samples=2")
    assert (response.status_code, response.json()["type"]) == (422, "urn:polhode:problem:outside_horizon")
