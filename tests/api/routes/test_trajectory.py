import csv
import io
import json
import math
from fractions import Fraction

import numpy as np
import pyarrow as pa
import pytest

from service.dynamics.equations.orientation import LOCAL_QUATERNION, QUATERNION, trajectory_columns
from service.dynamics.solution.dense_output import (
    Advance,
    DenseOutput,
    Period,
    chebyshev_coefficients,
    chebyshev_points,
)
from service.storage.codecs.packing import encode_arrays, encode_dense
from tests.support.api import COLUMNS, ERROR, STATE, STORED_TIMES, SUMMARY, Stored, finish, values_at
from tests.support.finishing import finish_success

pytestmark = pytest.mark.any_database

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
    times = np.array([float(-3 + Fraction(2007, 2) * k / 776) for k in range(777)])
    assert np.array_equal(columns["t"], times)
    distance = np.abs(np.stack([columns[name] for name in COLUMNS], axis=1) - values_at(times)).max()
    # Beside the claimed error: the reference's own phase 3·2π·t/T, rounded at t = 1000.
    assert distance <= error + 3 * 2 * math.pi * 1000 / 2 * 2.3e-16
    assert ERROR <= error < 1e-10


def test_the_start_is_zero_if_left_out_and_one_sample_is_one_time(client, stored):
    assert read(get(client, stored, "?stop=1&samples=3"))[0]["t"].tolist() == [0.0, 0.5, 1.0]
    assert read(get(client, stored, "?start=1&stop=1&samples=1"))[0]["t"].tolist() == [1.0]


def test_times_of_a_query_are_exact(client, stored):
    late = read(get(client, stored, "?start=12345678.9&stop=12345678.9&samples=1"))[0]
    third = read(get(client, stored, "?start=100000000/3&stop=100000000/3&samples=1"))[0]
    period = 2 * Fraction(1)
    for columns, exact in ((late, Fraction("12345678.9")), (third, Fraction(10**8, 3))):
        assert columns["t"].tolist() == [float(exact)]
        reduced = float(exact - exact // period * period)
        within = read(get(client, stored, f"?start={reduced!r}&stop={reduced!r}&samples=1"))[0]
        assert max(abs(columns[name][0] - within[name][0]) for name in COLUMNS) <= 1e-13


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


SPIN = 0.7
"""The body turns about the vertical by this angle in each period."""
TURNING = Period(2.0, 0.0, 0.0)
ORIENTED = [*COLUMNS, *QUATERNION, "psi1"]


def turning(times):
    """A body with its third axis vertical, hence without ψ3, that turns evenly."""
    angle = SPIN / TURNING.hi * np.asarray(times)
    zero = np.zeros_like(angle)
    quaternion = np.stack([np.cos(angle / 2), zero, zero, np.sin(angle / 2)], axis=-1)
    still = np.tile([0.0, 0.0, SPIN / TURNING.hi, 0.0, 0.0, 1.0], (len(angle), 1))
    return np.column_stack([still, quaternion, angle])


@pytest.fixture
def oriented(client, jobs):
    """A stored solution that knows the attitude, as a worker would have written it."""
    assert client.post("/v1/jobs", json=STATE).status_code == 202
    series = chebyshev_coefficients(turning(1.0 + chebyshev_points(20)))
    dense = DenseOutput(
        (*COLUMNS, *LOCAL_QUATERNION, "psi1"),
        np.array([0.0, 2.0]),
        series[None],
        TURNING,
        ERROR,
        {**dict.fromkeys(LOCAL_QUATERNION, 4e-13), "psi1": 2e-13},
        {"psi1": Advance(SPIN, 0.0, 0.0)},
    )
    claim = jobs.claim("test", lease_seconds=60.0)
    samples = {"t": STORED_TIMES, **trajectory_columns(dense, STORED_TIMES)}
    assert finish_success(jobs, claim, SUMMARY, dense=encode_dense(dense), samples=encode_arrays(samples))
    job = jobs.get(claim.job_id)
    return Stored(job, job.solution_id)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("accept", FORMATS)
@pytest.mark.parametrize("query", ["", "?start=-3&stop=1000.5&samples=77"])
def test_the_attitude_comes_in_every_format_at_any_time(client, oriented, accept, query):
    columns, error = read(get(client, oriented, query, accept))
    assert list(columns) == ["t", *ORIENTED]
    found = np.stack([columns[name] for name in ORIENTED], axis=1)
    # The error claimed is the largest of any column: that of the quaternion.
    assert np.abs(found - turning(columns["t"])).max() <= error
    assert 4e-13 <= error < 1e-12


@pytest.mark.parametrize("times", ["", "&stop=10&samples=11"])
def test_the_error_is_that_of_the_columns_asked_for(client, oriented, times):
    def error(names):
        return read(get(client, oriented, f"?columns={names}{times}"))[1]

    assert 4e-13 <= error("psi1,q0") < 5e-13
    assert 2e-13 <= error("t,psi1") < 3e-13
    # Of the six variables: as the summary or the dense output has it.
    assert ERROR <= error("g3") <= SUMMARY["error"]


@pytest.mark.parametrize("name", ["psi3", "local_q0"])
@pytest.mark.parametrize("times", ["", "&stop=10&samples=11"])
def test_an_azimuth_that_is_left_out_cannot_be_asked_for(client, oriented, name, times):
    response = get(client, oriented, f"?columns=t,{name}{times}")
    assert response.status_code == 422
    (fault,) = response.json()["errors"]
    assert (fault["pointer"], fault["code"]) == ("?columns", "unknown_column")
    assert fault["message"].endswith("accepted are " + ", ".join(["t", *ORIENTED]))


@pytest.mark.parametrize("times", ["", "&stop=10&samples=11"])
def test_a_solution_without_attitude_says_so(client, stored, times):
    response = get(client, stored, f"?columns=psi1,q0{times}")
    assert response.status_code == 422
    assert response.json()["errors"][0]["code"] == "unknown_column"


def test_a_preview_is_drawn_within_a_pixel(client, stored):
    answer = get(client, stored, "?preview=200&start=0&stop=2")
    columns, _ = read(answer)
    assert len(columns["t"]) == 200
    assert (columns["t"][0], columns["t"][-1]) == (0.0, 2.0)
    fine = np.linspace(0.0, 2.0, 20_001)
    told = float(answer.headers["polhode-deviation"])
    for k, name in enumerate(COLUMNS):
        # Cosines and sines: their range is 2.
        off = np.abs(np.interp(fine, columns["t"], columns[name]) - values_at(fine)[:, k]).max() / 2
        assert off <= told + 1e-12
    assert told < 1e-3
    assert answer.headers["polhode-samples"] == "evaluated"


def test_a_preview_follows_the_times_of_the_problem_and_the_columns_that_are_asked_for(client, stored):
    whole, _ = read(get(client, stored, "?preview=50"))
    assert (whole["t"][0], whole["t"][-1]) == (0.0, 20.0)
    one = get(client, stored, "?preview=500&columns=t,p")
    columns, _ = read(one)
    assert list(columns) == ["t", "p"]
    # The slowest of the columns alone is drawn better than all together.
    all_of_them = get(client, stored, "?preview=500")
    assert float(one.headers["polhode-deviation"]) < float(all_of_them.headers["polhode-deviation"]) / 4


def test_a_preview_is_the_same_in_every_format_and_never_changes(client, stored):
    answers = [get(client, stored, "?preview=30", accept=kind) for kind in FORMATS]
    found = [read(answer)[0] for answer in answers]
    for columns in found[1:]:
        assert {name: list(values) for name, values in columns.items()} == {
            name: list(values) for name, values in found[0].items()
        }
    assert len({answer.headers["polhode-deviation"] for answer in answers}) == 1
    tag = answers[0].headers["etag"]
    path = f"/v1/solutions/{stored.solution_id}/trajectory?preview=30"
    known = client.get(path, headers={"If-None-Match": tag})
    assert (known.status_code, known.content) == (304, b"")
    assert client.get(f"{path[:-2]}31").headers["etag"] != tag


@pytest.mark.parametrize(
    ("query", "faults"),
    [
        ("?preview=1", {("?preview", "invalid_value")}),
        ("?preview=10001", {("?preview", "invalid_value")}),
        ("?preview=20&samples=3", {("?preview", "conflicting_parameters")}),
        ("?preview=20&start=1", {("?stop", "missing_parameter")}),
        ("?preview=20&start=3&stop=1", {("?stop", "out_of_range")}),
        ("?preview=20&columns=x", {("?columns", "unknown_column")}),
    ],
)
def test_faults_of_previews_are_told(client, stored, query, faults):
    answer = get(client, stored, query)
    assert answer.status_code == 422
    assert {(each["pointer"], each["code"]) for each in answer.json()["errors"]} == faults
