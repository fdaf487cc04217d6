"""Documents made from arguments: exact numbers stay exact, mistakes are told with the nearest right word."""

import json
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

import polhode as ph
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
    ],
    ids=str,
)
def test_numbers_stay_exact(value, text):
    assert json.dumps(written(value)) == text


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"potential": "a*g1", "a": 1, "tolerence": 1e-9}, "did you mean 'tolerance'?"),
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
