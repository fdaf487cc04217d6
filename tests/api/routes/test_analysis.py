"""Facets and statistics over HTTP: of jobs, solutions and points, under the conditions of lists."""

from collections import Counter

import numpy as np
import pytest

from tests.api.routes.test_lists import made  # noqa: F401 - a fixture
from tests.support.sweeps import POINTS, SWEEP, energy_of, finish_sweep, is_refused, period_of

# Equal meaning on both databases is tested with their stores.
pytestmark = pytest.mark.any_database
INDICES = np.arange(POINTS)


def facets(response):
    assert response.status_code == 200, response.json()
    return {
        each["by"]: {value["value"]: value["count"] for value in each["values"]}
        for each in response.json()["facets"]
    }


def test_values_are_counted(client, made):  # noqa: F811
    found = facets(client.get("/v1/solutions/facets?by=family,tier,stability.verdict,/body/A"))
    assert found == {
        "family": {"expression": 5},
        "tier": {"high": 3, "draft": 2},
        "stability.verdict": {None: 5},
        "/body/A": {2.0: 5},
    }
    found = facets(client.get("/v1/jobs/facets", params={"by": "state,reused", "where": "family!=gravity"}))
    assert found == {"state": {"succeeded": 5}, "reused": {False: 5}}
    (facet,) = client.get("/v1/solutions/facets?by=tier&limit=1").json()["facets"]
    assert facet == {"by": "tier", "values": [{"value": "high", "count": 3}], "others": 2}


def test_numbers_are_summed_up(client, made):  # noqa: F811
    (found,) = client.get("/v1/solutions/statistics?of=energy&bins=2").json()["items"]
    assert found == {
        "of": "energy", "group": None, "rows": 5, "count": 5, "min": -4.0, "quartiles": [-3.0, -2.0, -1.0],
        "max": 0.0, "histogram": {"edges": [-4.0, -2.0, 0.0], "counts": [2, 3]},
    }  # fmt: skip
    query = {"of": "energy,/motion/lambda", "by": "tier", "where": "energy<0"}
    found = client.get("/v1/solutions/statistics", params=query).json()["items"]
    assert [(each["of"], each["group"], each["min"], each["max"]) for each in found] == [
        ("energy", "draft", -3.0, -1.0),
        ("energy", "high", -4.0, -2.0),
        ("/motion/lambda", "draft", 1.0, 2.0),
        ("/motion/lambda", "high", 1.5, 1.7),
    ]
    (found,) = client.get("/v1/jobs/statistics?of=attempt&where=state=queued").json()["items"]
    assert (found["rows"], found["count"], found["max"]) == (1, 1, 0.0)


def test_points_are_counted_and_summed_up(client, jobs):
    sweep_id = client.post("/v1/sweeps", json=SWEEP).json()["id"]
    finish_sweep(jobs)
    path = f"/v1/sweeps/{sweep_id}/points"
    refused = int(is_refused(INDICES).sum())
    found = facets(client.get(f"{path}/facets?by=outcome,energy,/potential/parameters/a"))
    energies = Counter(energy_of(INDICES)[~is_refused(INDICES)].tolist())
    assert found == {
        "outcome": {"solved": POINTS - refused, "no_motion": refused},
        "energy": {**energies, None: refused},
        "/potential/parameters/a": {-2.0: 50, -1 / 3: 50},
    }
    query = {"of": "period", "by": "/potential/parameters/a", "bins": 4, "where": "index>=10"}
    found = client.get(f"{path}/statistics", params=query).json()["items"]
    for each, (first, last) in zip(found, ((50, 100), (10, 50)), strict=True):
        periods = period_of(np.arange(first, last))
        known = np.sort(periods[np.isfinite(periods)])
        assert (each["rows"], each["count"]) == (last - first, len(known))
        assert (each["min"], each["max"]) == (known[0], known[-1])
        assert each["quartiles"] == [known[-(-len(known) * k // 4) - 1] for k in (1, 2, 3)]
        assert sum(each["histogram"]["counts"]) == len(known)


@pytest.mark.parametrize(
    ("path", "pointers"),
    [
        ("/v1/solutions/facets", ["?by"]),
        ("/v1/solutions/statistics", ["?of"]),
        ("/v1/solutions/facets?by=id,created_at,nothing&where=x", ["?where", "?by", "?by", "?by"]),
        ("/v1/jobs/statistics?of=tier&by=family,tier&bins=999", ["?bins", "?of", "?by"]),
        ("/v1/jobs/facets?by=" + "tier," * 20, ["?by"]),
    ],
)
def test_faults_are_told_at_once(client, path, pointers):
    response = client.get(path)
    assert response.status_code == 422
    assert sorted(fault["pointer"] for fault in response.json()["errors"]) == sorted(pointers)
