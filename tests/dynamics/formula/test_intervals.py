"""Intervals contain what balls of many bits say at every point, powers of a scale included."""

import math
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx, fmpq
from hypothesis import example, given, reject, settings
from hypothesis import strategies as st

from service.dynamics.errors import FormulaError
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.intervals import IntervalAlgebra, outwards
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape, with_inputs
from tests.support.effort import examples
from tests.support.trees import VARIABLES, trees_of_variables

EXPONENTS = [Fraction(n, 6) for n in (-12, -6, -3, 0, 2, 3, 6, 12)]
TREES = trees_of_variables("+-*/")


def between(low: float, high: float, share: float) -> float:
    return min(max(low + share * (high - low), low), high)


@st.composite
def stretches(draw):
    """A scale between bounds, the lower of which may be 0, and coefficients beside powers of it."""
    low = draw(st.sampled_from([0.0, 1e-3, 0.2]))
    scale = (low, low + draw(st.floats(1e-3, 2.0)))
    inside = between(*scale, draw(st.floats(1e-6, 1.0)))
    elements = []
    for _ in VARIABLES:
        at, width = draw(st.floats(-3.0, 3.0)), draw(st.floats(0.0, 0.5))
        exponent = draw(st.sampled_from(EXPONENTS))
        elements.append((at, at + width, exponent, between(at, at + width, draw(st.floats(0.0, 1.0)))))
    return scale, inside, elements


def in_balls(tape, inside, elements):
    """The value at one point and its derivative along x."""
    jets = FirstOrderJets(BallAlgebra(), 1)
    with ctx.workprec(300):
        x, y = (arb(c) * arb(inside) ** fmpq(e.numerator, e.denominator) for _, _, e, c in elements)
        found = tape.evaluate(jets, [jets.seed(x, (arb(1),)), jets.seed(y, (None,))])
    return found.value, found.first[0]


def in_intervals(tape, scale, elements):
    algebra = IntervalAlgebra([tuple(np.array([end]) for end in scale)])
    jets = FirstOrderJets(algebra, 1)
    x, y = (algebra.interval(np.array([low]), np.array([high]), (e,)) for low, high, e, _ in elements)
    with np.errstate(all="ignore"):
        found = tape.evaluate(jets, [jets.seed(x, (algebra.constant(Fraction(1)),)), jets.seed(y, (None,))])
        return tuple(None if part is None else algebra.bounds(part) for part in (found.value, found.first[0]))


NEARLY_ZERO = ((0.0, 1.0), 1.0, [(2e-112, 2e-112, Fraction(0), 2e-112), (0.0, 0.0, Fraction(-2), 0.0)])


@given(TREES, stretches())
@example(parse("x^(-3)"), NEARLY_ZERO)  # 1e335: its lower bound was infinite
@example(parse("x^(-2)"), NEARLY_ZERO)
@settings(max_examples=examples(40, 120), deadline=None)
def test_value_and_slope_at_every_point_are_within_the_bounds(tree, stretch):
    scale, inside, elements = stretch
    try:
        tape = compile_tape(tree, VARIABLES)
    except FormulaError:
        reject()
    exact, bounds = in_balls(tape, inside, elements), in_intervals(tape, scale, elements)
    for ball, bound in zip(exact, bounds, strict=True):
        assert (ball is None) == (bound is None)
        if ball is None or not ball.is_finite() or np.isnan(bound).any():
            continue
        assert arb(float(bound[0].item())) <= ball.upper(), (tape, bound)
        assert arb(float(bound[1].item())) >= ball.lower(), (tape, bound)


@pytest.mark.parametrize(
    ("text", "low", "high", "tight"),
    [
        ("x^2", 0.0, 4.0, 1e-9),
        ("x^3", -1.0, 8.0, 1e-9),
        ("abs(x)", 0.0, 2.0, 1e-9),
        ("sin(x)", math.sin(-1.0), 1.0, 1e-9),
        ("cos(x)", math.cos(2.0), 1.0, 1e-9),
        ("exp(x)", math.exp(-1.0), math.exp(2.0), 1e-9),
        ("sin(2e7*x)", -1.0, 1.0, 1e-9),
        ("(x+2)^(1/2)", 1.0, 2.0, 1e-9),
        ("log(x+2)", 0.0, math.log(4.0), 1e-9),
    ],
)
def test_a_single_operation_has_its_very_range(text, low, high, tight):
    tape = compile_tape(parse(text), VARIABLES)
    (found, _) = in_intervals(tape, (1.0, 1.0), [(-1.0, 2.0, Fraction(0), 0.0), (1.0, 1.0, Fraction(0), 1.0)])
    assert low - tight <= found[0].item() <= low
    assert high <= found[1].item() <= high + tight


@pytest.mark.parametrize("text", ["1/x", "log(x)", "sqrt(x)", "tan(2*x)", "x^(1/3)", "x^(-2)"])
def test_where_a_value_may_be_undefined_nothing_is_claimed(text):
    tape = compile_tape(parse(text), VARIABLES)
    found, slope = in_intervals(
        tape, (1.0, 1.0), [(-1.0, 2.0, Fraction(0), 0.0), (1.0, 1.0, Fraction(0), 1.0)]
    )
    assert np.isnan(found).any()
    assert np.isnan(slope).any()


def test_near_0_a_sum_is_known_by_its_leading_power():
    """x − x³ on 0 < x ≤ 1/2 lies between 3/4 x and x, although both ends are 0."""
    tape = compile_tape(parse("x - x^3"), VARIABLES)
    algebra = IntervalAlgebra([(np.array([0.0]), np.array([0.5]))])
    one = np.array([1.0])
    with np.errstate(all="ignore"):
        x = algebra.interval(one, one, (Fraction(1),))
        found = tape.evaluate(algebra, (x, x))
    assert found.exponents == (1,)
    assert 0.75 - 1e-12 < found.lo.item() <= 0.75
    assert 1.0 <= found.hi.item() < 1.0 + 1e-12


def test_constants_of_a_tape_become_inputs():
    tape = compile_tape(parse("3*x + y/7 - 3"), VARIABLES)
    places = [k for k, at in enumerate(tape.instructions) if at.number is not None]
    lifted = with_inputs(tape, places)
    numbers = [tape.instructions[k].number for k in places]
    inputs = [Fraction(2, 3), Fraction(5)]
    balls = BallAlgebra()
    values = [balls.constant(value) for value in (*inputs, *numbers)]
    assert lifted.evaluate(balls, values).overlaps(tape.evaluate(balls, values[:2]))
    assert not any(at.number is not None for at in lifted.instructions)


@given(st.floats(allow_nan=False), st.floats(allow_nan=False))
def test_outwards_encloses_exact_sums_and_products(x, y):
    """One unit in the last place is more than IEEE 754 rounds by, also next to 0 and beyond all doubles."""
    with np.errstate(all="ignore"):
        rounded = [np.asarray(x) + np.asarray(y), np.asarray(x) * np.asarray(y)]
    exact = (
        [Fraction(x) + Fraction(y), Fraction(x) * Fraction(y)] if np.isfinite([x, y]).all() else [None, None]
    )
    for value, true in zip(rounded, exact, strict=True):
        with np.errstate(all="ignore"):
            low, high = (float(end) for end in outwards(value, value))
        if np.isnan(value):
            assert np.isnan([low, high]).all()
        elif true is not None:
            assert low == -np.inf or Fraction(low) <= true
            assert high == np.inf or true <= Fraction(high)
