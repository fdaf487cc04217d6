"""The document of a sweep: what its points are, and everything that can be wrong with it."""

import json
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.schemas.problem.problem import check_problem, problem_digest
from service.schemas.sweep.reading import InvalidSweepError, read_sweep
from service.schemas.sweep.sweep import json_number
from tests.support.sweeps import AXES, BASE, SWEEP

A, B, LAMBDA = "/potential/parameters/a", "/potential/parameters/b", "/motion/lambda"
STATE = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "gravity", "a": 1},
    "motion": {"type": "state", "omega": [0, 0, 1], "gamma": ["3/5", 0, "4/5"]},
    "time": {"stop": 1, "samples": 2},
}


def sweep_of(*axes, base=BASE, **further):
    return {"base": base, "axes": list(axes), **further}


def faults_of(document, **limits):
    with pytest.raises(InvalidSweepError) as caught:
        read_sweep(document, **limits)
    return {(fault.pointer, fault.code): fault.message for fault in caught.value.faults}


def test_a_grid_has_every_value_with_every_other_the_last_axis_fastest():
    lists = [[-2, -1], [1, "1/2", 2], ["1/20", 1]]
    axes = [{"pointer": p, "values": values} for p, values in zip((A, LAMBDA, B), lists, strict=True)]
    sweep = read_sweep(sweep_of(*axes))
    assert sweep.points == 12
    assert [sweep.values(k) for k in range(12)] == [tuple(map(Fraction, point)) for point in product(*lists)]


def test_zip_puts_the_nth_values_together():
    axes = [
        {"pointer": A, "linspace": [-2, -1, 5]},
        {"pointer": LAMBDA, "logspace": ["1/16", 16, 5]},
    ]
    sweep = read_sweep(sweep_of(*axes, combine="zip"))
    assert sweep.points == 5
    assert [sweep.values(k) for k in range(5)] == [
        (Fraction(-8 + k, 4), Fraction(4) ** (k - 2)) for k in range(5)
    ]


def test_there_is_no_point_beyond_the_last():
    with pytest.raises(IndexError):
        read_sweep(SWEEP).values(100)


EVERY_KIND = sweep_of(
    {"pointer": A, "uniform": [-2, "-1/3", 7], "seed": 5},
    {"pointer": B, "logspace": ["1e-3", 0.04, 11]},
    {"pointer": LAMBDA, "linspace": ["1/3", 2, 13]},
    {"pointer": "/body/B", "values": [2, "7/5"]},
)
POINTS = 7 * 11 * 13 * 2


@given(index=st.integers(0, POINTS - 1))
def test_the_document_of_a_point_is_the_same_problem_to_the_last_bit(index):
    sweep = read_sweep(EVERY_KIND)
    values = dict(zip(sweep.pointers, sweep.values(index), strict=True))
    # Sent as JSON and read again, as a client would.
    alone = check_problem(json.loads(json.dumps(sweep.document(index)))).canonical
    exact = {
        **BASE,
        "body": {**BASE["body"], "B": str(values["/body/B"])},
        "potential": {**BASE["potential"], "parameters": {"a": str(values[A]), "b": str(values[B])}},
        "motion": {**BASE["motion"], "lambda": str(values[LAMBDA])},
    }
    assert problem_digest(alone) == problem_digest(check_problem(exact).canonical)
    columns = sweep.columns(index, 1)
    assert {name: float(value) for name, value in values.items()} == {
        name: column[0] for name, column in columns.items()
    }


@given(indices=st.lists(st.integers(0, POINTS - 1), max_size=10), first=st.integers(0, POINTS - 50))
def test_columns_are_the_values_of_their_points(indices, first):
    sweep = read_sweep(EVERY_KIND)
    for asked, columns in (
        (indices, sweep.columns_at(np.array(indices, dtype=np.int64))),
        (range(first, first + 50), sweep.columns(first, 50)),
    ):
        points = [sweep.values(index) for index in asked]
        for place, pointer in enumerate(sweep.pointers):
            assert columns[pointer].tolist() == [float(point[place]) for point in points]


def test_the_base_is_not_changed():
    before = json.dumps(BASE)
    assert read_sweep(SWEEP).document(7) != BASE
    assert json.dumps(BASE) == before


@pytest.mark.parametrize(
    ("value", "written"),
    [
        (Fraction(2), 2),
        (Fraction(1, 10), 0.1),
        (Fraction(1, 3), "1/3"),
        (Fraction(2**60 + 1), str(2**60 + 1)),
        (Fraction(10) ** 22, 1e22),
    ],
)
def test_a_number_is_written_as_json_can_say_it_exactly(value, written):
    assert json_number(value) == written
    assert type(json_number(value)) is type(written)


def test_what_is_left_out_has_defaults():
    sweep = read_sweep({"base": BASE, "axes": AXES})
    assert (sweep.combine, sweep.keep, sweep.series_columns) == ("grid", ("period", "energy", "error"), ())


def test_series_have_the_columns_of_the_outputs():
    base = {**BASE, "outputs": ["gamma", "orientation"]}
    sweep = read_sweep({**SWEEP, "base": base, "series": True, "keep": []})
    assert sweep.series_columns == ("t", "g1", "g2", "g3", "q0", "q1", "q2", "q3", "psi1", "psi3")
    assert sweep.samples == 3


GOOD = {"pointer": LAMBDA, "values": [1, 2]}
UNPERIODIC = {**BASE, "outputs": ["period"]}


@pytest.mark.parametrize(
    ("document", "pointer", "code"),
    [
        (7, "", "invalid_type"),
        ({"axes": [GOOD]}, "/base", "missing_field"),
        ({"base": BASE}, "/axes", "missing_field"),
        (sweep_of(), "/axes", "invalid_length"),
        (sweep_of(GOOD, extra=1), "/extra", "unknown_field"),
        (sweep_of(GOOD, combine="outer"), "/combine", "invalid_value"),
        (sweep_of(GOOD, series="yes"), "/series", "invalid_type"),
        (sweep_of(GOOD, priority=1000), "/priority", "out_of_range"),
        (sweep_of(GOOD, keep=["periods"]), "/keep/0", "invalid_value"),
        (sweep_of(GOOD, keep=["period", "period"]), "/keep/1", "invalid_value"),
        (sweep_of(GOOD, keep=[]), "/keep", "invalid_length"),
        (sweep_of(GOOD, keep=["energy", "stability.trace"]), "/keep/1", "output_needed"),
        (sweep_of(GOOD, keep=["precession.psi1"]), "/keep/0", "output_needed"),
        (sweep_of(GOOD, base=UNPERIODIC, series=True), "/series", "output_needed"),
        (sweep_of({"pointer": LAMBDA}), "/axes/0", "missing_field"),
        (sweep_of({"values": [1]}), "/axes/0/pointer", "missing_field"),
        (sweep_of({**GOOD, "linspace": [1, 2, 3]}), "/axes/0", "conflicting_fields"),
        (sweep_of({**GOOD, "seed": 1}), "/axes/0/seed", "unknown_field"),
        (sweep_of(3), "/axes/0", "invalid_type"),
        (sweep_of({"pointer": LAMBDA, "values": []}), "/axes/0/values", "invalid_length"),
        (sweep_of({"pointer": LAMBDA, "values": [1, "x"]}), "/axes/0/values/1", "invalid_number"),
        (sweep_of({"pointer": LAMBDA, "linspace": [1, 2]}), "/axes/0/linspace", "invalid_length"),
        (sweep_of({"pointer": LAMBDA, "linspace": [1, 2, 0]}), "/axes/0/linspace/2", "out_of_range"),
        (sweep_of({"pointer": LAMBDA, "linspace": [1, 2, 2.5]}), "/axes/0/linspace/2", "invalid_number"),
        (sweep_of({"pointer": LAMBDA, "linspace": [1, "inf", 3]}), "/axes/0/linspace/1", "invalid_number"),
        (
            sweep_of({"pointer": LAMBDA, "linspace": [1, float("nan"), 3]}),
            "/axes/0/linspace/1",
            "invalid_number",
        ),
        (sweep_of({"pointer": LAMBDA, "logspace": [0, 2, 3]}), "/axes/0/logspace/0", "out_of_range"),
        (sweep_of({"pointer": LAMBDA, "logspace": [1, -2, 3]}), "/axes/0/logspace/1", "out_of_range"),
        (sweep_of({"pointer": LAMBDA, "uniform": [1, 2, 3], "seed": -1}), "/axes/0/seed", "out_of_range"),
        (sweep_of({"pointer": "motion/lambda", "values": [1]}), "/axes/0/pointer", "unknown_pointer"),
        (sweep_of({"pointer": "/motion/lamda", "values": [1]}), "/axes/0/pointer", "unknown_pointer"),
        (sweep_of({"pointer": "/motion/g1_sign", "values": [1]}), "/axes/0/pointer", "unknown_pointer"),
        (sweep_of({"pointer": "/motion", "values": [1]}), "/axes/0/pointer", "not_a_number"),
        (sweep_of({"pointer": "", "values": [1]}), "/axes/0/pointer", "unknown_pointer"),
        (sweep_of({"pointer": "/potential/type", "values": [1]}), "/axes/0/pointer", "not_a_number"),
        (sweep_of(GOOD, GOOD), "/axes/1/pointer", "pointer_taken"),
        (
            sweep_of(GOOD, {"pointer": A, "values": [-1]}, combine="zip"),
            "/axes/1",
            "unequal_lengths",
        ),
        (
            sweep_of({"pointer": "/time/samples", "values": [2, 3]}, series=True),
            "/axes/0/pointer",
            "varying_samples",
        ),
        (
            sweep_of(
                {"pointer": LAMBDA, "linspace": [1, 2, 10_000]},
                base={**BASE, "time": {"stop": 1, "samples": 100_000}},
                series=True,
            ),
            "/series",
            "series_too_large",
        ),
        (
            sweep_of(GOOD, base={**BASE, "accuracy": {"budget_seconds": 1}}),
            "/base/accuracy/budget_seconds",
            "budget_in_sweep",
        ),
        (sweep_of(GOOD, base={**BASE, "body": {"A": 2}}), "/base/body/C", "missing_field"),
        (sweep_of(GOOD, base=3), "/base", "invalid_type"),
        (sweep_of({"pointer": "/body/A", "linspace": [0, 2, 3]}), "/base/body/A", "invalid_inertia"),
        (
            sweep_of({"pointer": "/motion/gamma/7", "values": [0]}, base=STATE),
            "/axes/0/pointer",
            "unknown_pointer",
        ),
    ],
)
def test_a_fault_is_told_with_its_place_and_what_is_accepted(document, pointer, code):
    faults = faults_of(document)
    assert (pointer, code) in faults, faults
    assert len(faults[pointer, code]) > 10
    assert len(faults) == 1, faults


def test_all_faults_are_told_at_once():
    document = {
        "base": {**BASE, "body": {"A": -2, "C": 1}, "method": "magic"},
        "axes": [
            {"pointer": "/motion/lamda", "linspace": [1, 2]},
            {"pointer": LAMBDA, "logspace": [-1, 2, "x"]},
            {"pointer": LAMBDA, "values": [1]},
        ],
        "keep": ["periode"],
        "combine": "zip",
    }
    assert set(faults_of(document)) == {
        ("/base/body/A", "invalid_inertia"),
        ("/base/method", "invalid_value"),
        ("/axes/0/linspace", "invalid_length"),
        ("/axes/0/pointer", "unknown_pointer"),
        ("/axes/1/logspace/0", "out_of_range"),
        ("/axes/1/logspace/2", "invalid_number"),
        ("/axes/2/pointer", "pointer_taken"),
        ("/keep/0", "invalid_value"),
    }


def test_the_number_of_points_is_limited_by_the_installation():
    axes = [{"pointer": p, "linspace": [-2, -1, 1000]} for p in (A, B)]
    document = sweep_of(*axes)
    assert read_sweep(document, max_points=10**6).points == 10**6
    assert set(faults_of(document, max_points=10**6 - 1)) == {("/axes", "too_many_points")}


def test_only_the_first_point_must_be_a_problem():
    # A = 1 = C has no planar motions: that is told by the point, later.
    sweep = read_sweep(sweep_of({"pointer": "/body/A", "values": [2, 1]}))
    assert sweep.document(1)["body"]["A"] == 1


def test_elements_of_lists_vary_too():
    sweep = read_sweep(sweep_of({"pointer": "/motion/omega/2", "linspace": [1, 2, 3]}, base=STATE))
    assert [sweep.document(k)["motion"]["omega"] for k in range(3)] == [[0, 0, 1], [0, 0, 1.5], [0, 0, 2]]
