"""GET /v1/accuracy: the shipped table first, then what was measured."""

from itertools import pairwise
from typing import get_args

import pytest

from service.dynamics.accuracy import TIER_TOLERANCES
from service.dynamics.numerics import NUMERICS
from service.schemas.replies.installation import Use, Way
from service.storage.solutions.accuracy_store import AccuracyStore
from service.storage.solutions.shipped_accuracy import shipped_comparison, shipped_costs, shipped_table
from tests.support.accuracy import row, table

pytestmark = pytest.mark.any_database


@pytest.fixture
def measured(database):
    store = AccuracyStore(database)
    store.add(table(version="old"))
    store.add(
        table(
            row("draft", "rest to rest", seconds=0.25),
            row("high", "rest to rest", seconds=0.5),
            row("high", "aperiodic", seconds=0.75),
            version="new",
        )
    )


def get(client, **query):
    response = client.get("/v1/accuracy", params=query)
    assert response.status_code == 200, response.text
    return response.json()


def seconds(answer):
    return [row["seconds"] for row in answer["rows"]]


def test_before_a_calibration_the_shipped_table_is_served_and_said_to_be_that(client):
    answer = get(client)
    shipped = shipped_table()
    assert (answer["source"], answer["date"]) == ("shipped", shipped.date)
    assert seconds(answer) == [row.seconds for row in shipped.rows]


def test_after_a_calibration_the_latest_one_is(client, measured):
    answer = get(client)
    assert (answer["source"], answer["version"]) == ("measured", "new")
    assert seconds(answer) == [0.25, 0.5, 0.75]
    assert answer["rows"][0] == {
        "tier": "draft",
        "kind": "rest to rest",
        "family": "three-term",
        "claimed_error": 2e-14,
        "error": 1e-15,
        "reference": "certified",
        "reference_error": 1e-32,
        "seconds": 0.25,
        "seconds_per_1000": 0.01,
    }
    assert answer["unavailable"] == [
        {
            "tier": "certified",
            "kind": "aperiodic",
            "family": "rational",
            "code": "no_way",
            "detail": "There is none.",
        }
    ]


def test_it_says_what_the_tiers_promise(client):
    assert get(client)["tolerances"] == dict(TIER_TOLERANCES)


@pytest.mark.parametrize(
    ("query", "expected", "lacking"),
    [
        ({"tier": "high"}, [0.5, 0.75], 0),
        ({"kind": "rest to rest"}, [0.25, 0.5], 0),
        ({"tier": "high", "kind": "aperiodic"}, [0.75], 0),
        ({"tier": "certified"}, [], 1),
    ],
)
def test_rows_are_chosen_by_tier_and_kind(client, measured, query, expected, lacking):
    answer = get(client, **query)
    assert seconds(answer) == expected
    assert len(answer["unavailable"]) == lacking


@pytest.mark.parametrize("query", [{"tier": "best"}, {"kind": "round"}, {"family": "rational"}])
def test_other_queries_are_refused(client, query):
    response = client.get("/v1/accuracy", params=query)
    assert response.status_code == 422
    assert [error["pointer"] for error in response.json()["errors"]] == [f"?{next(iter(query))}"]


def test_what_a_tier_costs_a_user_is_shown_with_where_and_when_it_was_measured(client, measured):
    costs = get(client)["costs"]
    assert costs == shipped_costs().model_dump()
    assert [row["what"] for row in costs["rows"]] == list(get_args(Use))
    assert costs["machine"]["cpus"] >= 1
    # Whatever is asked of the other table.
    assert get(client, tier="high")["costs"] == costs


def test_other_methods_and_the_cost_of_outputs_are_shown_whatever_is_asked(client, measured):
    comparison = get(client)["comparison"]
    assert comparison == shipped_comparison().model_dump()
    # Older digits may be shipped, of a version and a date that are told; never those of a later one.
    assert 0 < comparison["numerics"] <= NUMERICS
    assert list(dict.fromkeys(way["way"] for way in comparison["ways"])) == list(get_args(Way))
    assert all(way["seconds"] > 0.0 and way["error"] > 0.0 for way in comparison["ways"])
    # Each output adds what the jobs with and without it are apart; all are rounded to three digits.
    for before, after in pairwise(comparison["outputs"]):
        if after["added"] is None:
            continue
        apart = after["seconds"] - before["seconds"]
        assert after["added"] == pytest.approx(apart, abs=0.01 * max(after["seconds"], before["seconds"]))
    assert get(client, tier="high")["comparison"] == comparison
