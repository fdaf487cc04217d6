"""The whole way from a request to the trajectory of a solution that was really computed."""

import numpy as np
import pytest

from tests.support.api import PLANAR, STATE, solve_job

pytestmark = pytest.mark.any_database


def trajectory(client, solution, query=""):
    response = client.get(f"/v1/solutions/{solution['id']}/trajectory{query}")
    assert response.status_code == 200, response.json()
    document = response.json()
    return {name: np.array(values) for name, values in document["columns"].items()}, document["error"]


@pytest.mark.parametrize(
    "problem",
    [
        {**PLANAR, "method": "both", "outputs": ["gamma", "omega", "invariants"]},
        {**PLANAR, "outputs": ["gamma", "omega", "orientation"]},
        STATE,
    ],
    ids=["quadrature", "orientation", "integration"],
)
def test_samples_asked_for_later_are_those_that_were_stored(client, jobs, problem):
    solution = solve_job(client, jobs, problem)
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
    solution = solve_job(client, jobs, STATE)
    response = client.get(f"/v1/solutions/{solution['id']}/trajectory?stop=21&samples=2")
    assert (response.status_code, response.json()["type"]) == (422, "urn:polhode:problem:outside_horizon")


@pytest.mark.parametrize("accuracy", [{"tier": "standard"}, {"tier": "high"}, {"tier": "certified"}])
def test_a_period_alone_brings_no_series(client, jobs, accuracy):
    alone = solve_job(client, jobs, {**PLANAR, "outputs": ["period"], "accuracy": accuracy})
    # a = −1, b = 1/20, nu = 1: twice the period of g1.
    period = alone["period"]
    # Half an ulp of the number on the right; a proven radius is far below.
    assert abs(float(period["value"]) - 6.340077937232814) <= float(period.get("error", 0)) + 4.5e-16
    assert float(period.get("error", 0)) <= (1e-11 if accuracy["tier"] == "standard" else 1e-15)
    assert "pieces" not in alone["evidence"] or alone["evidence"]["states"] == 0
    for query in ("", "?stop=1&samples=2"):
        response = client.get(f"/v1/solutions/{alone['id']}/trajectory{query}")
        assert (response.status_code, response.json()["type"]) == (404, "urn:polhode:problem:no_series")
