"""/v1/sweeps/{id}/grid: the points of a grid as a matrix, whichever two axes it has."""

import io
import json
from itertools import product

import numpy as np
import pyarrow as pa
import pytest

from service.schemas.sweep.reading import read_sweep
from tests.support.sweeps import AXES, SWEEP, energy_of, finish_sweep, is_refused, period_of

pytestmark = pytest.mark.any_database

A, LAMBDA, TWO = "/potential/parameters/a", "/motion/lambda", "/potential/parameters/b"
ARROW, NPZ = "application/vnd.apache.arrow.stream", "application/x-npz"
CUBE = [{"pointer": TWO, "values": [1, 2, 3]}, AXES[0], {"pointer": LAMBDA, "linspace": [1, 2, 7]}]


def submit(client, **further):
    return client.post("/v1/sweeps", json={**SWEEP, **further}).json()["id"]


def ask(client, sweep_id, **query):
    return client.get(f"/v1/sweeps/{sweep_id}/grid", params={"of": "period", **query})


def doubles(sweep, axis):
    return [float(sweep.axes[axis].axis.value(k)) for k in range(sweep.axes[axis].axis.length)]


def cell(index, of=period_of):
    number = of(np.array([index]))[0]
    return None if np.isnan(number) else number


def faults_of(response):
    assert response.status_code == 422
    return [(each["pointer"], each["code"]) for each in response.json()["errors"]]


@pytest.mark.parametrize(("of", "known"), [("period", period_of), ("energy", energy_of)])
def test_rows_run_along_the_first_axis_and_columns_along_the_last(client, jobs, of, known):
    sweep_id, sweep = submit(client), read_sweep(SWEEP)
    finish_sweep(jobs)
    grid = ask(client, sweep_id, of=of).json()
    assert [axis["pointer"] for axis in grid["axes"]] == [A, LAMBDA]
    assert [axis["values"] for axis in grid["axes"]] == [doubles(sweep, 0), doubles(sweep, 1)]
    assert (grid["of"], grid["at"], grid["points"], grid["done"]) == (of, [], 100, 100)
    assert grid["indices"] == [0, 50, 1]
    for row, column in product(range(2), range(50)):
        index = 50 * row + column
        assert grid["rows"][row][column] == cell(index, known)
        refused = is_refused(np.array(index))
        assert grid["outcomes"][row][column] == ("no_motion" if refused else "solved")


@pytest.mark.one_in(3)
@pytest.mark.parametrize("held", [(0,), (1,), (2,), (0, 1), (0, 2), (1, 2)])
def test_any_axes_can_be_held(client, jobs, held):
    sweep = read_sweep({**SWEEP, "axes": CUBE})
    sweep_id = submit(client, axes=CUBE)
    finish_sweep(jobs)
    places = {axis: 1 + axis % 2 if axis != 1 else 1 for axis in held}
    at = [f"{sweep.pointers[axis]}={place}" for axis, place in places.items()]
    grid = ask(client, sweep_id, at=at).json()
    assert ask(client, sweep_id, at=",".join(at)).json() == grid
    free = [axis for axis in range(3) if axis not in held]
    assert [axis["pointer"] for axis in grid["axes"]] == [sweep.pointers[axis] for axis in free]
    assert grid["at"] == [
        {"pointer": sweep.pointers[axis], "index": place, "value": doubles(sweep, axis)[place]}
        for axis, place in places.items()
    ]
    first, by_row, by_column = grid["indices"]
    for row, numbers in enumerate(grid["rows"]):
        for column, number in enumerate(numbers):
            index = first + row * by_row + column * by_column
            assert number == cell(index)
            # The point has the values of the axes at its row and column.
            values = list(map(float, sweep.values(index)))
            wanted = {axis: doubles(sweep, axis)[place] for axis, place in places.items()}
            wanted |= {free[-1]: grid["axes"][-1]["values"][column]}
            wanted |= {free[0]: grid["axes"][0]["values"][row]} if len(free) == 2 else {}
            assert values == [wanted[axis] for axis in range(3)]


def test_points_that_are_not_computed_yet_have_no_outcome(client, jobs):
    sweep_id = submit(client)
    finish_sweep(jobs, chunks=1)
    answer = ask(client, sweep_id)
    grid, outcomes = answer.json(), np.array(answer.json()["outcomes"])
    done = client.get(f"/v1/sweeps/{sweep_id}").json()["done"]
    assert 0 < done < 100
    assert grid["done"] == done == np.count_nonzero(outcomes.ravel()[:done] != None)  # noqa: E711
    assert set(outcomes.ravel()[done:]) == {None}
    assert answer.headers["cache-control"] == "no-cache"
    finish_sweep(jobs)
    later = ask(client, sweep_id)
    assert later.headers["etag"] != answer.headers["etag"]
    assert later.json()["done"] == 100
    known = client.get(
        f"/v1/sweeps/{sweep_id}/grid",
        params={"of": "period"},
        headers={"If-None-Match": later.headers["etag"]},
    )
    assert (known.status_code, known.content) == (304, b"")
    assert later.headers["cache-control"] == "private, immutable, max-age=31536000"


def test_arrow_has_the_same_cells(client, jobs):
    sweep_id = submit(client)
    finish_sweep(jobs)
    grid = ask(client, sweep_id).json()
    answer = ask(client, sweep_id, format="arrow")
    assert answer.headers["content-type"] == ARROW
    by_accept = client.get(f"/v1/sweeps/{sweep_id}/grid?of=period", headers={"Accept": ARROW})
    assert by_accept.content == answer.content
    table = pa.ipc.open_stream(answer.content).read_all()
    assert table.column_names == [A, "period", "outcome"]
    assert table[A].to_pylist() == grid["axes"][0]["values"]
    assert table["period"].to_pylist() == grid["rows"]
    assert table["outcome"].to_pylist() == grid["outcomes"]
    about = json.loads(table.schema.metadata[b"polhode.grid"])
    assert about == {name: value for name, value in grid.items() if name not in ("rows", "outcomes")}


def test_npz_has_the_same_cells_with_outcomes_as_places_in_a_list(client, jobs):
    sweep_id = submit(client)
    finish_sweep(jobs, chunks=1)
    grid = ask(client, sweep_id).json()
    answer = ask(client, sweep_id, format="npz")
    assert answer.headers["content-type"] == NPZ
    by_accept = client.get(f"/v1/sweeps/{sweep_id}/grid?of=period", headers={"Accept": NPZ})
    assert by_accept.content == answer.content
    file = np.load(io.BytesIO(answer.content))
    assert [file[pointer.strip("/")].tolist() for pointer in (A, LAMBDA)] == [
        axis["values"] for axis in grid["axes"]
    ]
    numbers = np.array(grid["rows"], dtype=float)  # None is NaN
    assert file["period"].shape == numbers.shape == (2, 50)
    assert np.array_equal(file["period"], numbers, equal_nan=True)
    words = [*file["outcomes"].tolist(), None]  # the place -1 is the last of a list
    assert [[words[place] for place in row] for row in file["outcome"].tolist()] == grid["outcomes"]
    assert -1 in file["outcome"]
    assert file["indices"].tolist() == grid["indices"]


@pytest.mark.parametrize(
    ("query", "faults"),
    [
        ({"of": "trace"}, [("?of", "unknown_column"), ("?at", "missing_parameter")]),
        ({}, [("?at", "missing_parameter")]),
        ({"at": f"{A}=2"}, [("?at", "out_of_range")]),
        ({"at": f"{A}=-1"}, [("?at", "out_of_range")]),
        ({"at": f"{A}=x,/body/A=1"}, [("?at", "out_of_range"), ("?at", "unknown_column")]),
        ({"at": f"{A}=1,{A}=1"}, [("?at", "invalid_value")]),
        ({"at": f"{A}=1,{LAMBDA}=0,{TWO}=0"}, [("?at", "out_of_range")]),
        ({"format": "csv"}, [("?format", "invalid_value"), ("?at", "missing_parameter")]),
    ],
)
def test_faults_are_told_with_what_would_be_accepted(client, query, faults):
    sweep_id = submit(client, axes=CUBE)
    answer = ask(client, sweep_id, **query)
    assert sorted(faults_of(answer)) == sorted(faults)
    assert all("accepted" in each["message"] for each in answer.json()["errors"])
    assert faults_of(client.get(f"/v1/sweeps/{sweep_id}/grid?at={A}=0")) == [("?of", "missing_parameter")]


def test_a_zip_has_no_matrix(client):
    axes = [{"pointer": A, "values": [-2, -1]}, {"pointer": LAMBDA, "values": [1, 2]}]
    answer = ask(client, submit(client, axes=axes, combine="zip"))
    assert faults_of(answer) == [("", "not_a_grid")]
    assert client.get("/v1/sweeps/none/grid?of=period").status_code == 404


def test_a_matrix_is_limited(client):
    axes = [{"pointer": A, "linspace": [-2, -1, 1001]}, {"pointer": LAMBDA, "linspace": [1, 2, 1000]}]
    sweep_id = submit(client, axes=axes)
    assert faults_of(ask(client, sweep_id)) == [("?at", "out_of_range")]
    assert ask(client, sweep_id, at=f"{A}=1000").json()["points"] == 1000
