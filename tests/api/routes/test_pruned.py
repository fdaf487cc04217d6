"""Solutions whose samples were deleted, over HTTP."""

import numpy as np
import pytest

from service.storage.upkeep.retention import prune_samples
from tests.support.api import PLANAR, STATE, solve_job

pytestmark = pytest.mark.any_database


def prune(database):
    """Delete all samples that may be deleted, the youngest too."""
    return prune_samples(database, older_than_seconds=-86400.0, pause=lambda _: None).solutions


def url_of_trajectory(solution):
    return f"/v1/solutions/{solution['id']}/trajectory"


TIMES = {
    "span": {"start": "-1/3", "stop": 7, "samples": 50},
    "periods": {"periods": "5/2", "samples": 41},
    "list": {"times": [0, "1/7", 3.3, 100]},
}


@pytest.mark.parametrize(
    ("time", "outputs"),
    [
        ("span", ["gamma", "omega"]),
        ("periods", ["gamma"]),
        ("list", ["omega", "orientation"]),
        ("list", ["invariants"]),
    ],
)
def test_deleted_samples_are_made_again_at_the_same_times(client, jobs, database, time, outputs):
    solution = solve_job(client, jobs, {**PLANAR, "time": TIMES[time], "outputs": outputs})
    before = client.get(url_of_trajectory(solution))
    assert before.headers["polhode-samples"] == "stored"
    assert prune(database) == 1
    after = client.get(url_of_trajectory(solution))
    assert after.status_code == 200
    assert after.headers["polhode-samples"] == "evaluated"
    assert_agree(before.json(), after.json())


def assert_agree(stored, remade):
    assert list(stored["columns"]) == list(remade["columns"])
    assert stored["columns"]["t"] == remade["columns"]["t"]
    error = stored["error"] + remade["error"]
    for name, values in stored["columns"].items():
        apart = np.abs(np.subtract(values, remade["columns"][name])).max()
        # Both are within their claimed errors of the truth.
        assert apart <= error, name


def test_an_integrated_motion_is_made_again_where_it_was_computed(client, jobs, database):
    solution = solve_job(client, jobs, STATE)
    before = client.get(url_of_trajectory(solution)).json()
    prune(database)
    assert_agree(before, client.get(url_of_trajectory(solution)).json())
    chosen = client.get(url_of_trajectory(solution), params={"columns": "t,g3"}).json()
    assert list(chosen["columns"]) == ["t", "g3"]


@pytest.mark.parametrize("outputs", [["period"], ["period", "stability"]])
def test_what_had_no_samples_has_none_afterwards(client, jobs, database, outputs):
    solution = solve_job(client, jobs, {**PLANAR, "outputs": outputs})
    before = client.get(url_of_trajectory(solution))
    prune(database)
    after = client.get(url_of_trajectory(solution))
    assert before.status_code == after.status_code == 404
    assert before.json()["type"] == after.json()["type"] == "urn:polhode:problem:no_series"


def test_enclosures_are_served_after_pruning_as_before(client, jobs, database):
    document = {**PLANAR, "accuracy": {"tier": "certified"}, "time": {"stop": 1, "samples": 3}}
    solution = solve_job(client, jobs, document)
    before = client.get(f"/v1/solutions/{solution['id']}/enclosures").json()
    prune(database)
    assert client.get(f"/v1/solutions/{solution['id']}/enclosures").json() == before
