import copy

import pytest

from tests.support.api import STATE, SUMMARY, finish

pytestmark = pytest.mark.any_database


def test_a_solution_is_found_from_its_job_and_names_it(client, stored):
    solution = client.get(f"/v1/solutions/{stored.solution_id}").json()
    assert solution["id"] == stored.solution_id
    assert solution["job"] == stored.job.id
    assert solution["problem"] == STATE
    # What it was stored without is null.
    later = {"cost": {"examination_seconds": None}, "provenance": {"threads": None, "way": None}}
    for name, value in SUMMARY.items():
        assert solution[name] == (value | later[name] if name in later else value)
    assert client.get(f"/v1/jobs/{stored.job.id}").json()["solution"] == stored.solution_id


def test_a_solution_from_before_processors_were_told_says_none(client, jobs):
    assert client.post("/v1/jobs", json=STATE).status_code == 202
    found = finish(jobs, summary={**SUMMARY, "provenance": {"version": "0.1.0", "numerics": 1}})
    shown = client.get(f"/v1/solutions/{found.solution_id}").json()["provenance"]
    assert shown == {"version": "0.1.0", "numerics": 1} | dict.fromkeys(
        ("processor", "libraries", "threads", "way")
    )


@pytest.fixture
def several(client, jobs):
    found = []
    for k, period in enumerate([3.0, None, 1.0, 2.0]):
        problem = copy.deepcopy(STATE)
        problem["time"]["stop"] = 20 + k
        assert client.post("/v1/jobs", json=problem).status_code == 202
        summary = {**SUMMARY, "period": None if period is None else {"value": period, "error": 0.0}}
        summary["method"] = "integration" if period is None else "quadrature"
        found.append(finish(jobs, summary=summary).solution_id)
    return found


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("query", "order"),
    [
        ("", [3, 2, 1, 0]),
        ("sort=created_at", [0, 1, 2, 3]),
        ("sort=period", [2, 3, 0, 1]),
        ("sort=-period", [0, 3, 2, 1]),
        ("sort=period&limit=2&offset=1", [3, 0]),
        ("sort=period&period_min=2", [3, 0]),
        ("sort=period&period_min=1.5&period_max=2.5", [3]),
        ("method=integration", [1]),
        ("family=gravity&tier=standard&sort=created_at", [0, 1, 2, 3]),
        ("family=rational", []),
        ("job=unknown", []),
        ("A_min=3", []),
    ],
)
def test_solutions_are_filtered_sorted_and_paged(client, several, query, order):
    page = client.get(f"/v1/solutions?{query}").json()
    assert [solution["id"] for solution in page["items"]] == [several[k] for k in order]


def test_the_total_counts_what_matches_beyond_the_page(client, several):
    page = client.get("/v1/solutions?limit=1&method=quadrature").json()
    assert (len(page["items"]), page["total"], page["limit"], page["offset"]) == (1, 3, 1, 0)
