"""Every format of trajectories and points has the same numbers, by Accept or by name."""

import csv
import io
import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from service.api.formats.negotiation import MEDIA_TYPES
from service.api.routes import points as points_route
from tests.support.api import ERROR, STATE, SUMMARY
from tests.support.sweeps import POINTS, SWEEP, finish_sweep

pytestmark = pytest.mark.any_database

ENDINGS = {**{name: name for name in MEDIA_TYPES}, "arrow": "arrows"}
SERIES = {
    "t": lambda indices: indices[:, None] + np.arange(3.0),
    "g1": lambda indices: -np.ones((len(indices), 3)),
}


def columns_of(name, answer):
    """Return the columns of an answer in some format."""
    content = answer.content
    match name:
        case "json":
            document = json.loads(content)
            if "columns" in document:
                return document["columns"]
            rows = document["items"]
        case "ndjson":
            rows = [json.loads(line) for line in content.splitlines()]
        case "csv":
            rows = list(csv.DictReader(io.StringIO(content.decode())))
        case "npz":
            with np.load(io.BytesIO(content)) as arrays:
                return {each: arrays[each].tolist() for each in arrays.files}
        case "arrow":
            return pa.ipc.open_stream(content).read_all().to_pydict()
        case "parquet":
            return pq.read_table(io.BytesIO(content)).to_pydict()
    return {each: [row[each] for row in rows] for each in rows[0]}


def numbers(values):
    return [float(value) if value not in (None, "") else np.nan for value in values]


def metadata_of(answer):
    found = pq.read_schema(io.BytesIO(answer.content)).metadata
    return {
        key.decode().removeprefix("polhode."): json.loads(value)
        for key, value in found.items()
        if key.startswith(b"polhode.")
    }


@pytest.fixture
def trajectory(client, stored):
    path = f"/v1/solutions/{stored.solution_id}/trajectory"
    return lambda accept="*/*", **query: client.get(path, params=query, headers={"Accept": accept})


@pytest.fixture
def points(client, jobs):
    def ask(sweep=SWEEP, accept="*/*", **query):
        if json.dumps(sweep) not in made:
            made[json.dumps(sweep)] = client.post("/v1/sweeps", json=sweep).json()["id"]
            finish_sweep(jobs, series=SERIES if sweep.get("series") else {})
        path = f"/v1/sweeps/{made[json.dumps(sweep)]}/points"
        return client.get(path, params=query, headers={"Accept": accept})

    made = {}
    return ask


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", MEDIA_TYPES)
def test_a_trajectory_is_the_same_in_every_format(trajectory, name):
    expected = trajectory().json()["columns"]
    for answer in (
        trajectory(format=name),
        trajectory(MEDIA_TYPES[name]),
        trajectory("image/png", format=name),
    ):
        assert answer.status_code == 200
        assert answer.headers["content-type"].partition(";")[0] == MEDIA_TYPES[name]
        found = columns_of(name, answer)
        assert list(found) == list(expected)
        assert {each: numbers(values) for each, values in found.items()} == expected
        assert float(answer.headers["polhode-error"]) == SUMMARY["error"]
    evaluated = trajectory(format=name, stop=1, samples=3, columns="t,g1")
    assert list(columns_of(name, evaluated)) == ["t", "g1"]
    # The dense output claims less than the stored samples do.
    assert float(evaluated.headers["polhode-error"]) >= ERROR


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", MEDIA_TYPES)
def test_points_are_the_same_in_every_format(points, name):
    expected = points(limit=POINTS, columns="index,/motion/lambda,period,outcome").json()["items"]
    answer = points(format=name, columns="index,/motion/lambda,period,outcome")
    assert answer.headers["content-type"].partition(";")[0] == MEDIA_TYPES[name]
    found = columns_of(name, answer)
    # A name in a zip file has no slash in front.
    column = {each.lstrip("/"): values for each, values in found.items()}
    for each in ("index", "/motion/lambda", "period"):
        np.testing.assert_array_equal(
            numbers(column[each.lstrip("/")]), numbers([row[each] for row in expected])
        )
    assert column["outcome"] == [row["outcome"] for row in expected]


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", MEDIA_TYPES)
def test_the_file_has_a_name(trajectory, points, stored, name):
    for answer, stem in (
        (trajectory(format=name), f"trajectory-{stored.solution_id}"),
        (points(format=name), "points-"),
    ):
        how, _, given = answer.headers["content-disposition"].partition("; filename=")
        assert how == ("inline" if name == "json" else "attachment")
        assert given.startswith(f'"{stem}')
        assert given.endswith(f'.{ENDINGS[name]}"')


def test_parquet_says_where_a_trajectory_comes_from(trajectory, stored):
    about = metadata_of(trajectory(format="parquet", columns="t,p,g1"))
    assert about["problem"] == STATE
    assert about["provenance"] == SUMMARY["provenance"]
    assert about["solution"] == stored.solution_id
    assert about["errors"] == {"t": 0.0, "p": SUMMARY["error"], "g1": SUMMARY["error"]}
    assert set(about["units"]) == {"t", "p", "g1"}


def test_parquet_says_where_points_come_from(points):
    about = metadata_of(points(format="parquet"))
    assert about["document"] == SWEEP
    assert (about["provenance"]["points"], about["provenance"]["done"]) == (POINTS, POINTS)
    assert about["units"]["period"] == "the unit of time of the problem"
    assert about["errors"] == {}
    kept = {**SWEEP, "keep": ["period", "period.error", "error"], "series": True}
    known = metadata_of(points(kept, format="parquet", columns="period,period.error,error,g1"))["errors"]
    assert known == {"period": "period.error", "g1": "error"}


def test_parquet_has_series_in_lists(points):
    table = pq.read_table(io.BytesIO(points({**SWEEP, "series": True}, format="parquet").content))
    arrow = pa.ipc.open_stream(points({**SWEEP, "series": True}, format="arrow").content).read_all()
    assert table.num_rows == POINTS
    assert table.to_pydict() == arrow.to_pydict()


def test_empty_answers_have_their_columns(points):
    for name in ("npz", "arrow", "parquet"):
        found = columns_of(name, points(format=name, where="period>2"))
        assert [len(values) for values in found.values()] == [0] * 6


def test_arrays_that_are_too_large_are_refused_with_what_would_be_accepted(points, monkeypatch):
    monkeypatch.setattr(points_route, "MOST_ARRAY_NUMBERS", 60)
    refused = points(format="npz")
    assert refused.status_code == 422
    assert "at most 10 are accepted" in refused.json()["errors"][0]["message"]
    assert points(format="npz", limit=10).status_code == 200


def test_an_unknown_format_is_refused_with_those_that_there_are(trajectory, points):
    for answer in (trajectory(format="xlsx"), points(format="xlsx")):
        assert answer.status_code == 422
        assert answer.json()["errors"][0]["pointer"] == "?format"
        assert "parquet" in answer.json()["errors"][0]["message"]
