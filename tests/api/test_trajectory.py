import csv
import io
import json
import math

import numpy as np
import pyarrow as pa
import pytest

from tests.support.api import COLUMNS, ERROR, STATE, STORED_TIMES, SUMMARY, finish, values_at

FORMATS = ["application/json", "text/csv", "application/x-npz", "application/vnd.apache.arrow.stream"]


def get(client, stored, query="", accept=None):
    headers = {} if accept is None else {"Accept": accept}
    return client.get(f"/v1/solutions/{stored.solution_id}/trajectory{query}", headers=headers)


def read(response):
    """Return the columns and the error, whatever the format."""
    assert response.status_code == 200, response.text
    kind = response.headers["content-type"].partition(";")[0]
    error = float(response.headers["polhode-error"])
    if kind == "application/json":
        document = response.json()
        assert document["error"] == error
        columns = document["columns"]
    elif kind == "text/csv":
        head, *rows = csv.reader(io.StringIO(response.text, newline=""))
        columns = dict(zip(head, np.array(rows, dtype=float).T, strict=True))
    elif kind == "application/x-npz":
        with np.load(io.BytesIO(response.content), allow_pickle=False) as arrays:
            columns = dict(arrays)
    else:
        with pa.ipc.open_stream(response.content) as reader:
            assert float(reader.schema.metadata[b"Polhode-Error"]) == error
            columns = reader.read_all().to_pydict()
    return {name: np.asarray(values) for name, values in columns.items()}, error


@pytest.mark.parametrize("accept", FORMATS)
def test_stored_samples_come_bit_by_bit_in_every_format(client, stored, accept):
    response = get(client, stored, accept=accept)
    assert response.headers["content-type"].startswith(accept)
    columns, error = read(response)
    assert list(columns) == ["t", *COLUMNS]
    assert np.array_equal(columns["t"], STORED_TIMES)
    assert np.array_equal(np.stack([columns[name] for name in COLUMNS], axis=1), values_at(STORED_TIMES))
    assert error == SUMMARY["error"]


@pytest.mark.parametrize("accept", FORMATS)
def test_any_other_times_are_within_the_error_that_comes_with_them(client, stored, accept):
    columns, error = read(get(client, stored, "?start=-3&stop=1000.5&samples=777", accept))
    times = np.linspace(-3, 1000.5, 777)
    assert np.array_equal(columns["t"], times)
    distance = np.abs(np.stack([columns[name] for name in COLUMNS], axis=1) - values_at(times)).max()
    # Beside the claimed error: the reference's own phase 3·2π·t/T, rounded at t = 1000.
    assert distance <= error + 3 * 2 * math.pi * 1000 / 2 * 2.3e-16
    assert ERROR <= error < 1e-10


def test_the_start_is_zero_if_left_out_and_one_sample_is_one_time(client, stored):
    assert read(get(client, stored, "?stop=1&samples=3"))[0]["t"].tolist() == [0.0, 0.5, 1.0]
    assert read(get(client, stored, "?start=1&stop=1&samples=1"))[0]["t"].tolist() == [1.0]


@pytest.mark.parametrize("query", ["?columns=t,g1,g3", "?stop=1&samples=5&columns=t,%20g1,g3"])
def test_only_the_columns_asked_for_are_sent(client, stored, query):
    assert list(read(get(client, stored, query))[0]) == ["t", "g1", "g3"]


@pytest.mark.parametrize(
    ("accept", "chosen"),
    [
        (None, FORMATS[0]),
        ("*/*", FORMATS[0]),
        ("text/*", "text/csv"),
        ("application/*;q=0.5, text/csv", "text/csv"),
        ("application/json;q=0.1, application/x-npz;q=0.9", "application/x-npz"),
        ("application/json;q=0, */*;q=0.1", "text/csv"),
        ("TEXT/CSV; header=present", "text/csv"),
    ],
)
def test_the_format_is_what_the_client_likes_best(client, stored, accept, chosen):
    assert get(client, stored, accept=accept).headers["content-type"].partition(";")[0] == chosen


@pytest.mark.parametrize("accept", ["image/png", "application/json;q=0", "text/html, text/plain"])
def test_other_formats_are_not_acceptable(client, stored, accept):
    response = get(client, stored, accept=accept)
    assert (response.status_code, response.json()["type"]) == (406, "urn:polhode:problem:not_acceptable")
    assert "text/csv" in response.json()["detail"]


@pytest.mark.parametrize(
    ("query", "pointer"),
    [
        ("?start=1", "?stop"),
        ("?stop=1", "?samples"),
        ("?samples=5", "?stop"),
        ("?start=2&stop=1&samples=5", "?stop"),
        ("?columns=t,g4", "?columns"),
        ("?columns=", "?columns"),
        ("?samples=100001&stop=1", "?samples"),
    ],
)
def test_a_request_for_samples_that_cannot_be_is_refused(client, stored, query, pointer):
    response = get(client, stored, query)
    assert response.status_code == 422
    assert pointer in [fault["pointer"] for fault in response.json()["errors"]]


def test_the_latest_time_has_finite_values(client, stored):
    columns, error = read(get(client, stored, "?start=1e15&stop=1e15&samples=1"))
    assert all(np.isfinite(values).all() for values in columns.values())
    assert math.isfinite(error)


@pytest.mark.parametrize("accept", FORMATS)
def test_what_is_not_finite_is_never_sent(client, jobs, accept):
    assert client.post("/v1/jobs", json=STATE).status_code == 202
    spoiled = finish(jobs, spoil=True)
    response = get(client, spoiled, accept=accept)
    assert (response.status_code, response.json()["type"]) == (500, "urn:polhode:problem:not_finite")
    assert "values of p" in response.json()["detail"]
    # What is sound of it can still be had.
    assert get(client, spoiled, "?columns=t,g1", accept).status_code == 200


def test_json_is_read_back_without_constants(client, stored):
    def refuse(word):
        raise AssertionError(word)

    json.loads(get(client, stored).text, parse_constant=refuse)
