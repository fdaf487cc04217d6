"""Real arrays, floats, balls and SymPy agree on every formula."""

import math
from fractions import Fraction

import numpy as np
import pytest
import sympy
from flint import arb, ctx, fmpq
from hypothesis import given
from hypothesis import strategies as st

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.real import RealAlgebra, ScalarAlgebra
from service.dynamics.formula.algebras.symbolic import sympy_expression
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from tests.support.formulas import POTENTIALS

POSITIVE = st.fractions(min_value=Fraction(1, 50), max_value=1, max_denominator=200)
SIGNED = st.fractions(min_value=-1, max_value=1, max_denominator=200)


def _ball(value: Fraction) -> arb:
    return arb(fmpq(value.numerator, value.denominator))


@pytest.mark.one_in(3)
@pytest.mark.parametrize("text", POTENTIALS)
@given(g1=POSITIVE, g2=SIGNED, g3=POSITIVE)
def test_doubles_lie_in_the_balls_of_their_arguments(
    text: str, g1: Fraction, g2: Fraction, g3: Fraction
) -> None:
    tape = compile_tape(parse(text))
    point = (float(g1), float(g2), float(g3))
    scalar = tape.evaluate(ScalarAlgebra(), point)
    array = tape.evaluate(RealAlgebra(), [np.array([x, x]) for x in point])
    with ctx.workprec(53):
        rounded = tape.evaluate(BallAlgebra(), [arb(x) for x in point])
    with ctx.workprec(200):
        exact = tape.evaluate(BallAlgebra(), [arb(x) for x in point])
    # A 53-bit ball bounds the rounding errors of its own evaluation; those in doubles are as
    # large, term by term, so that three radii bound the difference (and an ulp for printing).
    bound = 3 * float(rounded.rad()) + 4e-16 * abs(scalar)
    assert abs(float(arb(scalar) - exact)) <= bound
    assert abs(float(arb(array[0]) - exact)) <= bound
    assert array[0] == array[1]
    assert rounded.overlaps(exact)


@pytest.mark.parametrize("text", POTENTIALS)
def test_sympy_gives_the_same_number(text: str) -> None:
    tape = compile_tape(parse(text))
    point = (Fraction(3, 10), Fraction(-1, 7), Fraction(2, 3))
    symbols = sympy.symbols("g1 g2 g3", real=True)
    values = {s: sympy.Rational(x.numerator, x.denominator) for s, x in zip(symbols, point, strict=True)}
    number = sympy_expression(tape).subs(values).evalf(60)
    with ctx.workprec(200):
        ball = tape.evaluate(BallAlgebra(), [_ball(x) for x in point])
        assert abs(ball - arb(str(number))) < arb("1e-55")


@given(SIGNED, st.fractions(min_value=0, max_value=Fraction(1, 4), max_denominator=64), SIGNED)
def test_a_ball_holds_the_values_of_its_points(mid: Fraction, rad: Fraction, place: Fraction) -> None:
    tape = compile_tape(parse("(1 + g1)^2*sin(g1) - abs(g1)/(3 - g1) + g1^3 + exp(g1)^(1/2) + g1^4/2"))
    algebra = BallAlgebra()
    wide = arb(_ball(mid), _ball(rad))
    inside = _ball(mid + place * rad)
    enclosure = tape.evaluate(algebra, (wide, arb(0), arb(0)))
    assert enclosure.is_finite()
    assert enclosure.overlaps(tape.evaluate(algebra, (inside, arb(0), arb(0))))


UNDEFINED = [
    ("1/g1", 0.0),
    ("g1^-2", 0.0),
    ("g1^-3", 0.0),
    ("g1^(-1/2)", 0.0),
    ("g1^(-2/3)", 0.0),
    ("g1^(1/2)", -0.5),
    ("g1^(2/3)", -0.5),
    ("sqrt(g1)", -0.5),
    ("log(g1)", 0.0),
    ("log(g1)", -1.0),
    ("g1^g2", -0.5),
    ("g1^g2", 0.0),
    ("2 + 0.5*log(g1)^2", 0.0),
    ("exp(-1/g1^2)", 0.0),
    ("(-2)^g1", 0.5),
]


@pytest.mark.parametrize(("text", "g1"), UNDEFINED)
def test_what_is_undefined_is_nan_everywhere_and_silent(text: str, g1: float) -> None:
    tape = compile_tape(parse(text))
    assert math.isnan(tape.evaluate(ScalarAlgebra(), (g1, 0.5, 0.5)))
    array = tape.evaluate(RealAlgebra(), [np.array([g1, g1, 0.25]), np.full(3, 0.5), np.full(3, 0.5)])
    assert np.isnan(array[:2]).all()
    ball = tape.evaluate(BallAlgebra(), (arb(g1), arb("0.5"), arb("0.5")))
    assert ball.is_nan()
    wide = tape.evaluate(BallAlgebra(), (arb(g1, "1e-10"), arb("0.5"), arb("0.5")))
    assert not wide.is_finite() or text == "(-2)^g1" or g1 not in (0.0, -0.5, -1.0)


@pytest.mark.parametrize(
    ("text", "g1", "value"),
    [
        ("g1^3", -2.0, -8.0),
        ("g1^-3", -2.0, -0.125),
        ("g1^2", -3.0, 9.0),
        ("abs(g1)^(2/3)", -8.0, 4.0),
        ("g1^(2/3)", 0.0, 0.0),
        ("sqrt(g1)", 0.0, 0.0),
        ("g1^1000", 10.0, math.inf),
        ("g1^999", -10.0, -math.inf),
        ("exp(g1)", 1000.0, math.inf),
        ("exp(g1)", -1000.0, 0.0),
        ("1e400*g1", 1.0, math.inf),
        ("(1000*g1)^(1000*g1)", 1.0, math.inf),
    ],
)
def test_doubles_follow_the_arithmetic_of_the_field(text: str, g1: float, value: float) -> None:
    tape = compile_tape(parse(text))
    # pow is correct to an ulp or two.
    assert tape.evaluate(ScalarAlgebra(), (g1, 0.0, 0.0)) == pytest.approx(value, rel=1e-15)
    array = tape.evaluate(RealAlgebra(), [np.array([g1]), np.zeros(1), np.zeros(1)])
    assert array[0] == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(("value", "sign"), [(2.5, 1.0), (-0.1, -1.0), (0.0, 0.0), (math.inf, 1.0)])
def test_the_sign_is_the_derivative_of_the_modulus(value: float, sign: float) -> None:
    assert ScalarAlgebra().call("sign", value) == sign
    assert RealAlgebra().call("sign", np.array([value]))[0] == sign


def test_the_sign_of_what_is_undefined_is_undefined() -> None:
    assert math.isnan(ScalarAlgebra().call("sign", math.nan))


def test_integer_powers_of_balls_about_zero_are_finite() -> None:
    algebra = BallAlgebra()
    for exponent in range(2, 9):
        power = algebra.power(arb(0, "0.1"), Fraction(exponent))
        assert power.is_finite()
        assert power.contains(arb("0.05") ** exponent)


def test_balls_follow_the_precision_in_force() -> None:
    tape = compile_tape(parse("1/3 + g1"))
    for bits in (53, 128, 333):
        with ctx.workprec(bits):
            third = tape.evaluate(BallAlgebra(), (arb(0), arb(0), arb(0)))
            assert third.rel_accuracy_bits() >= bits - 2
