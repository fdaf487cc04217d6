"""Lists are asked by one language, and read page by page by cursor or by offset."""

from datetime import datetime
from urllib.parse import parse_qs, urljoin, urlsplit

import pytest

from service.api.queries import lists
from tests.support.api import PLANAR, STATE, SUMMARY, finish
from tests.support.sweeps import AXES, SWEEP, finish_sweep

LAMBDAS = ["4/5", 1, 1.5, 2, "17/10"]


# Equal meaning on both databases is tested with their stores.
pytestmark = pytest.mark.any_database


@pytest.fixture
def made(client, jobs):
    """Five planar jobs with solutions, of growing λ and falling energy, and a state job that waits."""
    for place, curve in enumerate(LAMBDAS):
        problem = {**PLANAR, "motion": {"type": "planar", "lambda": curve}}
        assert client.post("/v1/jobs", json=problem).status_code == 202
        tier = "draft" if place % 2 else "high"
        finish(jobs, summary={**SUMMARY, "tier": tier, "energy": {"value": -float(place), "error": 0.0}})
    assert client.post("/v1/jobs", json=STATE).status_code == 202


def energies(response):
    assert response.status_code == 200, response.json()
    return [item["energy"]["value"] for item in response.json()["items"]]


def test_solutions_are_found_by_facts_and_by_numbers_of_their_problems(client, made):
    def found(where, **further):
        query = {"where": where, "order": "-energy", **further}
        return energies(client.get("/v1/solutions", params=query))

    assert found("/motion/lambda>=1") == [-1.0, -2.0, -3.0, -4.0]
    assert found("/motion/lambda=17/10") == [-4.0]
    assert found("/motion/lambda in (0.8,1.5),tier=high") == [-0.0, -2.0]
    assert found(["tier!=high", "energy<-1"]) == [-3.0]
    assert found("stability.verdict is null", limit=2, offset=1) == [-1.0, -2.0]
    assert found("created_at>=2100-01-01") == []
    # The parameters of before mean what they meant, beside the new ones.
    assert found("/motion/lambda>=1", tier="high", energy_max=-3) == [-4.0]
    assert energies(client.get("/v1/solutions?sort=energy&limit=2")) == [-4.0, -3.0]


def test_jobs_are_found_by_their_facts_and_those_of_their_solutions(client, made):
    def states(where):
        items = client.get("/v1/jobs", params={"where": where}).json()["items"]
        return [item["state"] for item in items]

    assert states("state!=succeeded") == ["queued"]
    assert states("energy<=-3") == ["succeeded"] * 2
    assert states("tier=draft,/motion/lambda>1,attempt=1,reused=false") == ["succeeded"]
    assert states("family=gravity") == ["queued"]
    assert states("error.code is not null") == []


def test_items_may_hold_chosen_columns_only(client, made):
    columns = "energy,tier,/motion/lambda,trace,created_at"
    page = client.get("/v1/solutions", params={"columns": columns, "order": "energy", "limit": 2}).json()
    assert [list(item) for item in page["items"]] == [columns.split(",")] * 2
    assert [item["/motion/lambda"] for item in page["items"]] == [1.7, 2.0]
    assert [(item["tier"], item["trace"]) for item in page["items"]] == [("high", None), ("draft", None)]
    assert all(datetime.fromisoformat(item["created_at"]).tzinfo for item in page["items"])
    page = client.get("/v1/jobs", params={"columns": "id,state,reused"}).json()
    assert len(page["items"]) == 6
    assert {type(item["reused"]) for item in page["items"]} == {bool}


def follow(client, path, **query):
    """Read all pages; return their items."""
    items, response = [], client.get(path, params=query)
    while True:
        assert response.status_code == 200, response.json()
        page = response.json()
        items += page["items"]
        assert (page["next"] is None) == ("link" not in response.headers)
        if page["next"] is None:
            return items
        assert len(page["items"]) == page["limit"]
        assert response.headers["link"] == f'<{page["next"]}>; rel="next"'
        response = client.get(urljoin(path, page["next"]))


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    "order", ["energy", "-tier,energy", "/motion/lambda", "-period,-created_at", "trace"]
)
def test_pages_by_cursor_are_the_whole(client, made, order):
    whole = client.get("/v1/solutions", params={"order": order}).json()
    assert len(whole["items"]) == whole["total"] == 5
    for limit in (1, 2, 5):
        assert follow(client, "/v1/solutions", order=order, limit=limit) == whole["items"]
    where = "/motion/lambda>=1"
    assert len(follow(client, "/v1/solutions", order=order, where=where, limit=1)) == 4


def test_jobs_and_sweeps_have_pages_by_cursor(client, made):
    whole = client.get("/v1/jobs").json()["items"]
    assert follow(client, "/v1/jobs", limit=2) == whole
    assert follow(client, "/v1/jobs", limit=1, state="succeeded") == whole[1:]
    for points in (2, 3, 4):
        axes = [AXES[0], {**AXES[1], "linspace": [0.6, 2, points]}]
        client.post("/v1/sweeps", json={**SWEEP, "axes": axes})
    whole = client.get("/v1/sweeps?order=-points").json()["items"]
    assert [item["points"] for item in whole] == [8, 6, 4]
    assert follow(client, "/v1/sweeps", order="-points", limit=1) == whole
    found = client.get("/v1/sweeps?where=points>4,/potential/parameters/b=0.05,family=expression").json()
    assert [item["points"] for item in found["items"]] == [8, 6]


@pytest.mark.one_in(2)
@pytest.mark.parametrize("order", [None, "period", "-energy,period", "energy", "-index"])
def test_points_have_pages_by_cursor(client, jobs, order):
    sweep_id = client.post("/v1/sweeps", json=SWEEP).json()["id"]
    finish_sweep(jobs)
    path, query = f"/v1/sweeps/{sweep_id}/points", {} if order is None else {"order": order}
    for where in (None, "energy<0", "period is null"):
        further = query if where is None else {**query, "where": where}
        whole = client.get(path, params={**further, "limit": 1000}).json()
        assert len(whole["items"]) == whole["total"]
        assert follow(client, path, **further, limit=17) == whole["items"]
    lists = client.get(path, params={"where": "outcome in (solved, other),energy!=0,/motion/lambda>1"}).json()
    assert lists["items"]
    assert all(item["energy"] and item["/motion/lambda"] > 1 for item in lists["items"])


def test_jobs_that_come_in_meanwhile_do_not_move_the_pages(client, made):
    first = client.get("/v1/jobs?limit=3").json()
    seen = [item["id"] for item in first["items"]]
    client.post("/v1/jobs", json={**STATE, "time": {"stop": 3, "samples": 3}})
    second = client.get("/v1/jobs" + first["next"]).json()
    seen += [item["id"] for item in second["items"]]
    assert len(set(seen)) == 6


def test_the_total_is_counted_where_it_is_asked_for(client, made):
    def total(query):
        return client.get(f"/v1/jobs?{query}").json()["total"]

    assert total("") == total("limit=1") == total("order=created_at") == 6
    assert total("state=queued") == 1
    assert total("where=state=queued") is None
    assert total("where=state=queued&count=exact") == 1
    cursor = client.get("/v1/jobs?limit=2").json()["next"].partition("?")[2]
    assert total(cursor) is None
    assert total(f"{cursor}&count=exact") == 6


def test_of_very_many_the_total_is_counted_only_if_it_is_asked_for(client, made, monkeypatch):
    for limit, told in ((6, 6), (5, None)):
        monkeypatch.setattr(lists, "COUNTED_AT_ONCE", limit)
        assert client.get("/v1/jobs").json()["total"] == told
        assert client.get("/v1/jobs?state=queued").json()["total"] == 1
        assert client.get("/v1/jobs?count=exact").json()["total"] == 6


def refused(response):
    assert response.status_code == 422, response.json()
    assert response.headers["content-type"] == "application/problem+json"
    return [(fault["pointer"], fault["code"]) for fault in response.json()["errors"]]


def test_all_faults_of_a_query_are_told_with_their_places(client):
    query = {"where": "perid<5,period<5,tier=best", "order": "-enrgy", "columns": "id,x", "limit": 0}
    response = client.get("/v1/solutions", params=query)
    assert refused(response) == [
        ("?limit", "invalid_value"),
        ("?where", "unknown_column"),
        ("?where", "invalid_value"),
        ("?order", "unknown_column"),
        ("?columns", "unknown_column"),
    ]
    places = [fault.get("position") for fault in response.json()["errors"]]
    assert places == [None, 0, 22, 0, 3]
    assert refused(client.get("/v1/solutions?sort=A&order=A")) == [("?sort", "conflicting_parameters")]


def test_a_cursor_belongs_to_its_query(client, made):
    target = client.get("/v1/solutions?order=energy&limit=1").json()["next"]
    cursor = parse_qs(urlsplit(target).query)["after"][0]
    assert client.get("/v1/solutions", params={"order": "energy", "after": cursor}).status_code == 200
    others = [
        {"order": "-energy"},
        {"order": "energy", "where": "period>0"},
        {"order": "energy", "tier": "high"},
        {},
    ]
    for query in others:
        response = client.get("/v1/solutions", params={**query, "after": cursor})
        assert refused(response) == [("?after", "invalid_cursor")], query
    for text in ("x", "", "!!!", cursor[:-4], cursor + "A", "W10", "é", "bnVsbA"):
        response = client.get("/v1/solutions", params={"order": "energy", "after": text})
        assert refused(response) == [("?after", "invalid_cursor")], text
    response = client.get("/v1/solutions", params={"order": "energy", "after": cursor, "offset": 1})
    assert refused(response) == [("?offset", "conflicting_parameters")]
    assert refused(client.get("/v1/jobs", params={"after": cursor})) == [("?after", "invalid_cursor")]
