"""/v1/sweeps/{id}/points: pages of JSON and streams, conditions, order, columns."""

import base64
import csv
import io
import json
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pyarrow as pa
import pytest

from service.api.queries.points import PointsQuery, read_wish
from service.api.queries.queries import Asked
from service.schemas.sweep.reading import read_sweep
from service.storage.sweeps.point_reader import PointReader
from tests.support.sweeps import POINTS, SWEEP, energy_of, finish_sweep, is_refused, period_of

pytestmark = pytest.mark.any_database

A, LAMBDA = "/potential/parameters/a", "/motion/lambda"
COLUMNS = ["index", A, LAMBDA, "period", "energy", "outcome"]
ARROW, NDJSON, CSV = "application/vnd.apache.arrow.stream", "application/x-ndjson", "text/csv"
NPZ = "application/x-npz"
SERIES = {
    "t": lambda indices: indices[:, None] + np.arange(3.0),
    "g1": lambda indices: -np.ones((len(indices), 3)),
}


def submit(client, **further):
    return client.post("/v1/sweeps", json={**SWEEP, **further}).json()["id"]


@pytest.fixture
def points(client, jobs):
    """Ask for the points of a sweep that is done."""
    sweep_id = submit(client)
    finish_sweep(jobs)
    return lambda accept=None, **query: client.get(
        f"/v1/sweeps/{sweep_id}/points", params=query, headers={"Accept": accept or "application/json"}
    )


def expected_rows(indices):
    sweep, refused = read_sweep(SWEEP), is_refused(np.asarray(indices))
    axes = sweep.columns_at(np.asarray(indices))
    rows = zip(
        indices,
        axes[A],
        axes[LAMBDA],
        period_of(np.asarray(indices)),
        energy_of(np.asarray(indices)),
        refused,
        strict=True,
    )
    return [
        {
            "index": index,
            A: a,
            LAMBDA: lambda_,
            "period": None if no_motion else period,
            "energy": None if no_motion else energy,
            "outcome": "no_motion" if no_motion else "solved",
        }
        for index, a, lambda_, period, energy, no_motion in rows
    ]


def arrow_rows(answer):
    return pa.ipc.open_stream(answer.content).read_all().to_pylist()


def indices_of(answer):
    assert answer.status_code == 200, answer.json()
    return [row["index"] for row in answer.json()["items"]]


def test_a_page_has_a_row_for_each_point(points):
    page = points(limit=20, offset=5).json()
    assert page["items"] == expected_rows(range(5, 25))
    assert {name: page[name] for name in ("total", "limit", "offset", "points", "done")} == {
        "total": POINTS,
        "limit": 20,
        "offset": 5,
        "points": POINTS,
        "done": POINTS,
    }


def test_every_format_has_the_same_rows(points):
    expected = expected_rows(range(POINTS))
    assert [json.loads(line) for line in points(NDJSON).text.splitlines()] == expected
    assert arrow_rows(points(ARROW)) == expected
    table = list(csv.DictReader(io.StringIO(points(CSV).text)))
    assert list(table[0]) == COLUMNS
    numbers = COLUMNS[1:-1]
    assert [{name: float(row[name]) if row[name] else None for name in numbers} for row in table] == [
        {name: row[name] for name in numbers} for row in expected
    ]
    assert [(int(row["index"]), row["outcome"]) for row in table] == [
        (row["index"], row["outcome"]) for row in expected
    ]


def test_a_stream_says_what_is_missing(client, jobs):
    place = f"/v1/sweeps/{submit(client)}/points"
    for done in (0, 16):
        for accept in (ARROW, NDJSON, CSV):
            answer = client.get(place, headers={"Accept": accept})
            told = answer.headers["Polhode-Points"], answer.headers["Polhode-Points-Done"]
            assert told == (str(POINTS), str(done))
            assert answer.headers["Content-Type"].startswith(accept)
        assert client.get(place).json()["done"] == done
        finish_sweep(jobs, chunks=1)


def test_an_empty_arrow_stream_has_its_schema(client):
    answer = client.get(f"/v1/sweeps/{submit(client)}/points", headers={"Accept": ARROW})
    table = pa.ipc.open_stream(answer.content).read_all()
    assert (table.num_rows, table.schema.names) == (0, COLUMNS)
    assert table.schema.metadata[b"Polhode-Points"] == str(POINTS).encode()


def test_a_stream_may_be_limited(points):
    assert [row["index"] for row in arrow_rows(points(ARROW, limit=7, offset=50))] == list(range(50, 57))


def test_conditions_choose_points(points):
    period, energy = period_of(np.arange(POINTS)), energy_of(np.arange(POINTS))
    assert (
        indices_of(points(where="period<0.5,energy>=-1/4"))
        == np.flatnonzero((period < 0.5) & (energy >= -0.25)).tolist()
    )
    assert indices_of(points(where=["period<0.5", " energy >= -0.25 "])) == indices_of(
        points(where="period<0.5,energy>=-1/4")
    )
    assert (
        indices_of(points(where="outcome=no_motion"))
        == np.flatnonzero(is_refused(np.arange(POINTS))).tolist()
    )
    assert indices_of(points(where=f"{LAMBDA}=2,{A}>-1")) == [99]
    assert indices_of(points(where="index>=98")) == [98, 99]
    page = points(where="energy=0", limit=3, offset=2).json()
    assert page["total"] == np.count_nonzero(energy == 0)
    assert len(page["items"]) == 3


def test_order_puts_points_without_the_number_last(points):
    refused = np.flatnonzero(is_refused(np.arange(POINTS))).tolist()
    period = period_of(np.arange(POINTS))
    for order, sign in (("period", 1), ("-period", -1)):
        indices = indices_of(points(order=order))
        assert indices[-len(refused) :] == refused
        assert (np.diff(sign * period[indices[: -len(refused)]]) > 0).all()
    assert indices_of(points(order="-index", limit=3)) == [99, 98, 97]
    assert indices_of(points(order=f"-{LAMBDA}", limit=4)) == [49, 99, 48, 98]


def test_columns_are_those_asked_for(points):
    page = points(columns=f"outcome,{LAMBDA},index", limit=1).json()
    assert list(page["items"][0]) == ["outcome", LAMBDA, "index"]
    assert points(CSV, columns="period").text.splitlines()[0] == "period"
    assert arrow_rows(points(ARROW, columns="energy", where="energy=0", limit=2)) == [{"energy": 0.0}] * 2


@pytest.mark.parametrize(
    ("query", "pointer", "code", "told"),
    [
        ({"where": ["periode<5"]}, "?where", "unknown_column", "period"),
        ({"where": ["period"]}, "?where", "invalid_condition", "period<5"),
        ({"where": ["period<"]}, "?where", "invalid_value", "17/10"),
        ({"where": ["period!5"]}, "?where", "invalid_condition", "!="),
        ({"where": ["period<five"]}, "?where", "invalid_number", "1.5"),
        ({"where": ["period<1e400"]}, "?where", "invalid_number", "1e300"),
        ({"where": ["period>1e-400"]}, "?where", "invalid_number", "1e-300"),
        ({"where": ["outcome>solved"]}, "?where", "invalid_condition", "outcome=solved"),
        ({"order": "periode"}, "?order", "unknown_column", "period"),
        ({"order": "outcome"}, "?order", "unknown_column", "period"),
        ({"columns": "index,periode"}, "?columns", "unknown_column", "period"),
        ({"columns": "index,index"}, "?columns", "invalid_value", "once"),
    ],
)
def test_a_faulty_question_is_refused_with_what_is_accepted(query, pointer, code, told):
    asked = Asked(PointsQuery.model_validate(query), frozenset(query), ())
    (fault,) = read_wish(asked, "sweep", read_sweep(SWEEP), has_lists=True).faults
    assert (fault.pointer, fault.code) == (pointer, code)
    assert told in fault.message


def test_all_faults_of_a_question_are_told_at_once(points):
    faults = points(where="periode<5,period<x", order="energie", columns="t").json()["errors"]
    assert [fault["pointer"] for fault in faults] == ["?columns", "?where", "?where", "?order"]
    for query, pointer in (
        ({"limit": 0}, "?limit"),
        ({"limit": 10_001}, "?limit"),
        ({"wehre": "x"}, "?wehre"),
    ):
        answer = points(**query)
        assert (answer.status_code, answer.json()["errors"][0]["pointer"]) == (422, pointer)


@pytest.mark.parametrize("accept", ["application/json", CSV])
def test_faults_of_form_do_not_hide_those_of_columns_and_conditions(points, accept):
    answer = points(
        accept, limit=[0, 1], offset=-1, order="energie", columns="periode", where="period<x", wehre=1
    )
    found = {(fault["pointer"], fault["code"]) for fault in answer.json()["errors"]}
    assert answer.status_code == 422
    assert found == {
        ("?limit", "repeated_parameter"),
        ("?offset", "invalid_value"),
        ("?order", "unknown_column"),
        ("?columns", "unknown_column"),
        ("?where", "invalid_number"),
        ("?wehre", "unknown_parameter"),
    }


def test_a_page_that_is_too_long_is_told_with_the_other_faults(points):
    faults = points(limit=10_001, order="energie").json()["errors"]
    assert {fault["pointer"] for fault in faults} == {"?limit", "?order"}


def test_other_formats_are_not_acceptable(points):
    answer = points("image/png")
    assert answer.status_code == 406
    assert NDJSON in answer.json()["detail"]


@pytest.fixture
def with_series(client, jobs):
    sweep_id = submit(client, series=True, keep=[])
    finish_sweep(jobs, series=SERIES)
    return lambda accept="application/json", **query: client.get(
        f"/v1/sweeps/{sweep_id}/points", params=query, headers={"Accept": accept}
    )


def test_series_are_lists(with_series):
    row = with_series(limit=1, offset=3, columns="index,t,g1,p").json()["items"][0]
    assert row == {"index": 3, "t": [3.0, 4.0, 5.0], "g1": [-1.0] * 3, "p": None}
    assert json.loads(with_series(NDJSON, limit=1, offset=3, columns="t").text) == {"t": [3.0, 4.0, 5.0]}
    assert arrow_rows(with_series(ARROW, order="-index", limit=1, columns="t,p")) == [
        {"t": [99.0, 100.0, 101.0], "p": None}
    ]


def test_csv_has_no_series(with_series):
    assert with_series(CSV).text.splitlines()[0] == f"index,{A},{LAMBDA},outcome"
    assert with_series(CSV, columns="t").json()["errors"][0]["code"] == "unknown_column"


def test_long_series_are_neither_sorted_nor_put_on_a_page(with_series, monkeypatch):
    monkeypatch.setattr("service.api.routes.points.MOST_SORTED_NUMBERS", 1000)
    monkeypatch.setattr("service.api.routes.points.MOST_NUMBERS", 100)
    (fault,) = with_series(ARROW, order="-index").json()["errors"]
    assert (fault["pointer"], fault["code"]) == ("?order", "sort_too_large")
    assert with_series(ARROW, order="-index", columns="index").status_code == 200
    assert with_series(ARROW, order="-index", limit=10).status_code == 200
    (fault,) = with_series(limit=50).json()["errors"]
    assert (fault["pointer"], fault["code"]) == ("?limit", "out_of_range")
    assert 1 <= len(with_series().json()["items"]) <= 100 // 25


def test_a_fault_before_the_first_byte_is_told(points, monkeypatch):
    def broken(*_):
        raise RuntimeError("a fault of ours")

    monkeypatch.setattr(PointReader, "_read", broken)
    answer = points(ARROW)
    assert (answer.status_code, answer.json()["type"]) == (500, "urn:polhode:problem:internal_error")


@pytest.mark.one_in(2)
@pytest.mark.parametrize("accept", ["application/json", CSV, NDJSON, ARROW, NPZ])
def test_places_beyond_every_list_are_told_or_refused(points, accept):
    for name in ("offset", "limit"):
        answer = points(accept, **{name: 2**64})
        assert answer.status_code == 422
        (fault,) = answer.json()["errors"]
        assert (fault["pointer"], fault["code"]) == (f"?{name}", "invalid_value")
        assert "to 1000000000" in fault["message"]
    empty = points(accept, offset=10**9)
    assert empty.status_code == 200
    assert len(empty.content) < 2000


@pytest.mark.one_in(2)
@pytest.mark.parametrize("index", [-1e300, -1, 0.5, 2.0**63, 1e300])
def test_a_forged_cursor_leads_to_some_page(points, index):
    following = points(limit=2).json()["next"]
    cursor = parse_qs(urlsplit(following).query)["after"][0]
    content = json.loads(base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)))
    forged = base64.urlsafe_b64encode(json.dumps([content[0], index]).encode()).decode().rstrip("=")
    rows = indices_of(points(limit=2, after=forged))
    assert rows == [row for row in range(POINTS) if row > index][:2]
