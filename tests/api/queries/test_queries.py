"""Queries: every fault at once, each with what would have been accepted."""

from contextlib import contextmanager

import pytest
from starlette.datastructures import QueryParams

from service.api.queries.queries import read_query
from service.api.routes.jobs import SubmitQuery
from service.api.routes.solutions import SolutionsQuery
from service.api.routes.trajectory import TrajectoryQuery
from service.schemas.problem.potentials import MODELS
from service.storage.database.database import SEARCH_SECONDS, Database, SearchTimeError
from tests.support.api import PLANAR

pytestmark = pytest.mark.any_database


def faults(response):
    document = response.json()
    assert (response.status_code, document["type"]) == (422, "urn:polhode:problem:invalid_request")
    return by_name(document["errors"])


def faults_of(model, query):
    asked = read_query(QueryParams(query), model)
    return by_name([{"pointer": f.pointer, "code": f.code, "message": f.message} for f in asked.faults])


def by_name(errors):
    found = {fault["pointer"]: (fault["code"], fault["message"]) for fault in errors}
    assert len(found) == len(errors)
    return found


ROUTES = {
    "/v1/solutions": "limit",
    "/v1/jobs": "limit",
    "/v1/sweeps": "limit",
    "/v1/accuracy": "tier",
    "/v1/solutions/x/trajectory": "columns",
}


def test_a_parameter_that_is_given_twice_is_refused_with_the_other_faults(client):
    for path, name in ROUTES.items():
        found = faults(client.get(f"{path}?{name}=1&{name}=1&unknown=1&other=2"))
        code, message = found.pop(f"?{name}")
        assert (code, "once is accepted" in message) == ("repeated_parameter", True)
        assert {unknown: code for unknown, (code, _) in found.items()} == {
            "?unknown": "unknown_parameter",
            "?other": "unknown_parameter",
        }
        assert all(name in message for _, message in found.values())
    assert set(faults(client.get("/v1/families?a=1&a=2&b=3"))) == {"?a", "?b"}


def test_a_problem_is_not_queued_with_a_faulty_priority(client):
    found = faults(client.post("/v1/jobs?priority=1&priority=2&urgent=1", json=PLANAR))
    assert {name: code for name, (code, _) in found.items()} == {
        "?priority": "repeated_parameter",
        "?urgent": "unknown_parameter",
    }
    assert client.get("/v1/jobs").json()["total"] == 0
    assert "-100 to 100" in faults_of(SubmitQuery, "priority=101")["?priority"][1]


@pytest.mark.parametrize(
    ("name", "accepted"),
    [
        ("family", ", ".join(MODELS)),
        ("method", "quadrature, integration"),
        ("tier", "draft, standard, high, certified"),
        ("sort", "created_at, A, C, period, energy, error"),
    ],
)
def test_an_unknown_word_in_a_filter_is_refused_with_the_known_ones(name, accepted):
    code, message = faults_of(SolutionsQuery, f"{name}=foo")[f"?{name}"]
    assert code == "invalid_value"
    assert "'foo'" in message
    assert accepted in message


def test_all_filters_at_fault_are_told_at_once(client):
    query = "family=foo&tier=best&method=guess&limit=0&A_min=1e-400&period_max=x&sort=name"
    assert set(faults(client.get(f"/v1/solutions?{query}"))) == {
        "?family", "?tier", "?method", "?limit", "?A_min", "?period_max", "?sort",
    }  # fmt: skip


@pytest.mark.parametrize("number", ["1e-400", "-1e-400", "1e400", "1e-310", "nan", "inf", "1_0", "", "2/0"])
@pytest.mark.parametrize(("model", "name"), [(SolutionsQuery, "period_min"), (TrajectoryQuery, "start")])
def test_a_number_of_a_query_has_the_limits_of_numbers_in_documents(model, name, number):
    assert faults_of(model, f"{name}={number}")[f"?{name}"][0] == "invalid_number"


def test_a_number_of_a_query_may_be_a_ratio():
    asked = read_query(QueryParams("period_min=17/10&A_max=1e-12"), SolutionsQuery)
    assert (asked.parameters.period_min, asked.parameters.A_max, asked.faults) == (1.7, 1e-12, ())


def test_a_bound_is_told_with_both_its_ends():
    found = faults_of(TrajectoryQuery, "start=-2e15&stop=1&samples=0&columns=t&columns=p")
    assert "from -1e+15 to 1e+15" in found["?start"][1]
    assert "from 1 to 100000" in found["?samples"][1]
    assert found["?columns"][0] == "repeated_parameter"


def test_times_and_columns_of_a_trajectory_are_judged_together(client, stored):
    path = f"/v1/solutions/{stored.solution_id}/trajectory"
    found = faults(client.get(f"{path}?start=5&stop=1&columns=t,g4&samples=x"))
    assert {name: code for name, (code, _) in found.items()} == {
        "?samples": "invalid_value",
        "?stop": "out_of_range",
        "?columns": "unknown_column",
    }
    assert "t, p, q, r, g1, g2, g3" in found["?columns"][1]
    assert set(faults(client.get(f"{path}?stop=1"))) == {"?samples"}


def test_every_unknown_column_of_a_trajectory_is_told(client, stored):
    response = client.get(f"/v1/solutions/{stored.solution_id}/trajectory?columns=g4,t,g5")
    assert [fault["message"].split("'")[1] for fault in response.json()["errors"]] == ["g4", "g5"]


@pytest.mark.parametrize(
    ("path", "slow"),
    [
        ("solutions?where=period<5&order=-energy", set()),
        ("solutions?where=/potential/a<5,label.run=6&order=/potential/a", set()),
        ("solutions?where=/potential/a<5,label.run=6&order=/potential/b/0", {"?where"}),
        ("solutions?where=period!=5,attempt>1", {"?where"}),
        ("solutions?order=attempt", {"?order"}),
        ("solutions/facets?by=family,/potential/a", {"?by"}),
        ("solutions/statistics?of=period,/potential/a&by=tier", set()),
        ("solutions/statistics?of=period&by=/potential/a&where=/potential/b/0<5", {"?by"}),
        ("solutions/statistics?of=/potential/a&where=/potential/b/0<5", {"?where"}),
        ("jobs?where=period<5", {"?where"}),
        ("jobs/facets?by=state", {"?by"}),
        ("sweeps?order=points", {"?order"}),
    ],
)
def test_an_estimate_tells_what_takes_long_and_reads_nothing(client, monkeypatch, path, slow):
    monkeypatch.setattr(Database, "search", None)
    answer = client.get(f"/v1/{path}&estimate=true")
    assert answer.status_code == 200, answer.text
    document = answer.json()
    assert {part["pointer"] for part in document["slow"]} == slow
    assert document["seconds"] == SEARCH_SECONDS
    # Each part is named.
    assert all(part["why"] for part in document["slow"])


def test_a_query_that_takes_long_is_stopped_and_told(client, monkeypatch):
    @contextmanager
    def search(database):
        raise SearchTimeError(10.0)
        yield

    monkeypatch.setattr(Database, "search", search)
    for path in ("solutions", "jobs", "sweeps", "solutions/facets?by=family", "jobs/statistics?of=period"):
        answer = client.get(f"/v1/{path}")
        assert (answer.status_code, answer.json()["type"]) == (422, "urn:polhode:problem:query_time_limit")
        assert "estimate=true" in answer.json()["detail"]
