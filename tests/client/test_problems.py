"""Documents made from arguments: exact numbers stay exact, mistakes are told with the nearest right word."""

import json
import math
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

import polhode as ph
from polhode.documents.problems import sweep_document
from polhode.documents.quantities import written
from service.schemas.problem.problem import read_question
from service.verdicts.refusals import refusal_of_reading

WHOLE = {
    "body": {"A": 2, "C": 1},
    "potential": {
        "type": "expression",
        "expression": "a*g1 + b/g3^2",
        "parameters": {"a": -1, "b": "1/20"},
    },
    "motion": {"type": "planar", "lambda": 1},
    "time": {"stop": 10, "samples": 101},
    "accuracy": {"tolerance": 1e-12},
}


def test_arguments_make_the_document():
    made = ph.problem(body=(2, 1), potential="a*g1 + b/g3^2", a=-1, b=Fraction(1, 20), lam=1, tolerance=1e-12)
    assert made == WHOLE
    # The service reads it without a fault.
    assert refusal_of_reading(made, read_question) is None


def test_a_document_and_a_file_are_the_same(tmp_path):
    file = tmp_path / "problem.json"
    file.write_text(json.dumps(WHOLE))
    assert ph.problem(WHOLE) == ph.problem(file) == ph.problem(str(file)) == WHOLE
    changed = ph.problem(file, b="1/30", lam="3/2", tier="high", samples=7)
    assert changed["potential"]["parameters"] == {"a": -1, "b": "1/30"}
    assert changed["motion"] == {"type": "planar", "lambda": "3/2"}
    assert (changed["accuracy"], changed["time"]) == ({"tier": "high"}, {"stop": 10, "samples": 7})
    assert WHOLE["motion"]["lambda"] == 1  # what was given is not changed


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (Fraction(1, 3), '"1/3"'),
        (Decimal("0.1000"), '"0.1000"'),
        ("17/10", '"17/10"'),
        (np.float64(0.1), "0.1"),
        (np.int64(3), "3"),
        ((1, Fraction(1, 2)), '[1, "1/2"]'),
        (np.array([0.5, 1.0]), "[0.5, 1.0]"),
        (np.longdouble("0.1"), '"0.1"'),
        (np.array([1, "1/3", Fraction(1, 7)], dtype=object), '[1, "1/3", "1/7"]'),
        (pd.Series([0.5, 1.5], index=["x", "y"]), "[0.5, 1.5]"),
        (pd.Index([1, 2]), "[1, 2]"),
        (pa.array([1, 2]), "[1, 2]"),
        (np.array(7), "7"),
        (np.float32(0.5), "0.5"),
        (np.bool_(True), "true"),
        (range(3), "[0, 1, 2]"),
    ],
    ids=str,
)
def test_numbers_stay_exact(value, text):
    assert json.dumps(written(value)) == text


@pytest.mark.parametrize(
    "value",
    [
        *(math.nan, Decimal("NaN"), Decimal("Infinity"), np.longdouble("inf"), np.float32("nan")),
        *(b"12", 1j, np.complex128(1j), np.datetime64("now"), {1, 2}, object(), pd.Series([0.5, None])),
    ],
    ids=repr,
)
def test_what_is_no_number_is_refused_before_it_is_sent(value):
    with pytest.raises(ph.WrongArgumentError, match=r"accepted|can$"):
        written(value)


def test_counts_and_seeds_are_integers_of_any_type():
    span = ph.uniform(np.float64(0.5), np.longdouble("1.5"), np.int64(7), seed=np.uint8(3))
    assert json.loads(json.dumps(span.section)) == {"uniform": [0.5, "1.5", 7], "seed": 3}
    assert json.loads(json.dumps(ph.problem(WHOLE, samples=np.int32(7), stop=np.float64(3))))["time"] == {
        "stop": 3.0,
        "samples": 7,
    }
    with pytest.raises(ph.WrongArgumentError, match=r"count = 2.5; an integer"):
        ph.linspace(0, 1, 2.5)


def test_a_parameter_without_a_value_gets_one_later():
    template = ph.problem(body=(2, 1), potential="a*g1 + b/g3^2", a=-1, lam=1)
    assert ph.problem(template, b="1/20") == ph.problem(
        body=(2, 1), potential="a*g1 + b/g3^2", a=-1, b="1/20", lam=1
    )
    (axis,) = sweep_document(template, {"b": [1, 2]}, ["period"], "grid", series=False)["axes"]
    assert axis["pointer"] == "/potential/parameters/b"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"potential": "a*g1", "a": 1, "tolerence": 1e-9}, "did you mean 'tolerance'?"),
        ({"potential": "a*g1", "a": 1, "tol": 1e-9}, "did you mean 'tolerance'?"),
        ({"base": WHOLE, "tol": 3}, "did you mean 'tolerance'?"),
        ({"body": 2}, "(A, C), (A, B, C) or a dict"),
        ({"body": (1, 2, 3, 4)}, "(A, C), (A, B, C) or a dict"),
        ({"lam": 1, "nu": 2}, "both set motion"),
        ({"tier": "high", "tolerance": 1e-9}, "both set accuracy"),
        ({"stop": 3, "periods": 1}, "both set time"),
        ({"potential": "g1", "lam": float("nan")}, "a finite number is accepted"),
        ({"base": "no such file.json"}, "No such file"),
        ({"base": WHOLE, "bb": 3}, "did you mean 'b'?"),
        ({"base": WHOLE, "lamda": 3}, "did you mean 'lam'?"),
    ],
    ids=str,
)
def test_mistakes_are_told_before_anything_is_sent(arguments, told):
    with pytest.raises(ph.WrongArgumentError) as fault:
        ph.problem(**arguments)
    assert told in str(fault.value)
