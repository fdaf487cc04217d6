"""The exact ring says what the real functions say: values, derivatives, zero tests."""

from fractions import Fraction
from itertools import product

import pytest
from flint import arb, ctx
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from service.dynamics.equations.compatibility import residual_ball
from service.dynamics.errors import FormulaError
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.verdict.exact_ring.generators import (
    CircleConstant,
    Coordinate,
    Cosine,
    CosineOfTurn,
    Divisor,
    Element,
    Exponential,
    Layout,
    LayoutTooSmallError,
    Logarithm,
    NoProofError,
    Root,
    Sine,
    UndefinedInOctantError,
)
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.ring_functions.ring_algebra import RingAlgebra, VectorFields
from tests.dynamics.verdict.formulas import body, potential
from tests.support.effort import examples

BITS = 400
POINT = (Fraction(2, 7), Fraction(6, 7), Fraction(3, 7))
BALLS = BallAlgebra()

NUMBERS = st.sampled_from(["2", "3", "1/2", "1.7", "12", "pi", "pi/5", "3*pi/7", "sqrt(2)", "(2 - sqrt(3))"])
ROOTS = st.sampled_from(["sqrt(1 + g2)", "sqrt(2 - g1)", "sqrt(1 - g2)", "sqrt(3 + g3)", "(2 + g1)^(1/3)"])
LEAVES = st.sampled_from(["g1", "g2", "g3", "g1", "g2", "g3", "(g1^2 + g3^2)"]) | NUMBERS | ROOTS


def _compound(inner):
    powers = st.sampled_from(["2", "3", "(-1)", "(-2)", "0.5", "(1/3)", "(-3/2)"])
    functions = st.sampled_from(["exp", "log", "sin", "cos", "tan", "abs", "sqrt"])
    return st.one_of(
        st.builds("({} {} {})".format, inner, st.sampled_from(["+", "-", "*", "/", "*"]), inner),
        st.builds("({})^{}".format, inner, powers),
        st.builds("{}({})".format, functions, inner),
        st.builds("abs({})^({})".format, inner, inner),
        # What roots of roots are made of: squares written out, products, conjugates.
        st.builds("sqrt(({0})^2 + 2*({0})*({1}) + ({1})^2)".format, inner, inner),
        st.builds("sqrt({0} + {1} - 2*sqrt(({0})*({1})))".format, inner, inner),
        st.builds("sqrt({0} + sqrt(({0})^2 - ({1})^2))".format, inner, inner),
        st.builds("sqrt({0} - {1})*log(({0} + {1})*({0} - {1}))".format, inner, inner),
        st.builds("(({0})^3*({1})^2)^(1/3)".format, inner, inner),
        st.builds("({0} + {1})^30".format, inner, inner),
        st.builds("sin({0} + 2*{1})*cos({0} - {1}/3)".format, inner, inner),
    )


FORMULAS = st.recursive(LEAVES, _compound, max_leaves=7)
OCTANTS = st.sampled_from(list(product((1, -1), repeat=3)))


def examined(text, on, signs):
    """Return the ring that is large enough, V, H and ΞH."""
    tape, layout = potential(text, on).tape, Layout()
    while True:
        try:
            ring = Ring(layout, signs)
            algebra = RingAlgebra(ring)
            fields = VectorFields(on, algebra, ring)
            V = tape.evaluate(algebra, [ring.coordinate(i) for i in range(3)])
            H = fields.H(V)
            return ring, V, H, fields.derivative("along", H)
        except LayoutTooSmallError as error:
            layout = error.layout


class Evaluation:
    """Elements as balls at one point: each generator replaced by what its nature says it stands for."""

    def __init__(self, ring: Ring, gamma: list[arb]) -> None:
        self.ring, self.gamma, self.known = ring, gamma, {}

    def element(self, element: Element) -> arb:
        total = arb(0)
        for exponents, coefficient in element.numerator.terms():
            term = arb(coefficient)
            for index, (low, shift) in enumerate(zip(exponents, element.shift, strict=True)):
                if int(low) + shift:
                    term *= BALLS.power(self.generator(index), Fraction(int(low) + shift))
            total += term
        return total

    def generator(self, index: int) -> arb:
        if index not in self.known:
            self.known[index] = self._value(index)
        return self.known[index]

    def _value(self, index: int) -> arb:
        match self.ring.natures[index]:
            case Coordinate(position, degree):
                value = self.ring.signs[position] * self.gamma[position]
                return BALLS.power(value, Fraction(1, degree)) if degree > 1 else value
            case CircleConstant(degree):
                return BALLS.power(arb.pi(), Fraction(1, degree))
            case Root(base, degree):
                return BALLS.power(self.element(base), Fraction(1, degree))
            case Divisor(base):
                return self.element(base)
            case Exponential(exponent, degree):
                return (self.element(exponent) / degree).exp()
            case Logarithm(argument):
                return self.element(argument).log()
            case Sine(argument, _):
                return self.element(argument).sin()
            case Cosine(argument, _):
                return self.element(argument).cos()
            case CosineOfTurn(order):
                return 2 * (2 * arb.pi() / order).cos()


@settings(max_examples=examples(8, 120), deadline=None)
@given(text=FORMULAS, signs=OCTANTS)
def test_the_ring_agrees_with_balls_in_value_energy_and_residual(text, signs):
    on = body("17/10", "3/2")
    try:
        candidate = potential(text, on)
    except FormulaError:
        assume(False)
    gamma = [s * g for s, g in zip(signs, POINT, strict=True)]
    with ctx.workprec(BITS):
        residual = residual_ball(on, candidate.tape, gamma)
        g1, g2, g3 = (BALLS.constant(g) for g in gamma)
        value = candidate.value_ball(g1, g2, g3)
        assume(residual.is_defined and value.is_finite() and abs(value) < arb(10) ** 30)
        try:
            ring, V, H, along = examined(text, on, signs)
            normal = ring.normal(along)
        except NoProofError:
            assume(False)  # too large
        evaluation = Evaluation(ring, [g1, g2, g3])
        # Overlapping says something only if the balls are small. They are not at a
        # root of a zero that the ring does not see, abs(sin(pi)), or for sin(exp(1000)).
        assume(evaluation.element(V).is_finite() and evaluation.element(V).rad() < 1e-40)
        assert evaluation.element(V).overlaps(value)
        assert evaluation.element(H).overlaps(candidate.H_ball(on, g1, g2, g3))
        # ΞH = -(Q g2 / (2 (A - C) g1 g3)) L(V)
        A, C = BALLS.constant(on.A), BALLS.constant(on.C)
        factor = -(A * g1 * g1 + C * g3 * g3) * g2 / (2 * (A - C) * g1 * g3)
        assert evaluation.element(along).overlaps(factor * residual.residual)
        assert evaluation.element(normal).overlaps(factor * residual.residual)


@pytest.mark.parametrize(
    "text",
    [
        "sqrt(8) - 2*sqrt(2)",
        "12^(1/3)*18^(1/3) - 6",
        "log(g1^2*12) - 2*log(abs(g1)) - 2*log(2) - log(3)",
        "exp(g1 + 2*g2)/exp(g2)^2 - exp(g1)",
        "exp(3*log(2 + g2)) - (2 + g2)^3",
        "sin(g1)^2 + cos(g1)^2 - 1",
        "tan(g1) - sin(g1)/cos(g1)",
        "sin(-g1) + sin(g1)",
        "1/(1 - g2) - (1 + g2)/(g1^2 + g3^2)",
        "(1 - g2^2)^(1/2)*(g1^2 + g3^2)^(1/2) - 1 + g2^2",
        "(g1^2)^(1/2) - abs(g1)",
        "abs(g1*g3) - abs(g1)*abs(g3)",
        "sqrt((1 + g1)/(2 + g3))^2*(2 + g3) - 1 - g1",
        "(2 + g1)^(1/2)*(2 + g1)^(1/3) - (2 + g1)^(5/6)",
        "1/(g1 + g3) + 1/(g1 - g3) - 2*g1/(g1^2 - g3^2)",
        "log(exp(g1*g2)) - g1*g2",
        "sqrt(exp(g1)) - exp(g1/2)",
    ],
)
def test_identities_are_recognised(text):
    on = body(2)
    for signs in ((1, 1, 1), (-1, -1, 1)):
        ring, V, _, _ = examined(text, on, signs)
        assert ring.normal(V).is_zero


@pytest.mark.parametrize(
    "text",
    [
        # For 2 - 5 g2 < 0 the two roots below differ in sign; splitting them would be wrong.
        "sqrt((g1 - g3)/(2 - 5*g2)) - sqrt((g1 - g3)*(2 - 5*g2))/(2 - 5*g2)",
        "sqrt((g2 - g1)^2) - (g2 - g1)",
        "log((g2 - g1)^2) - 2*log((g2 - g1)*(g2 - g3))",
    ],
)
def test_roots_of_factors_of_unknown_sign_are_not_split(text):
    ring, V, _, _ = examined(text, body(2), (1, 1, 1))
    assert not ring.normal(V).is_zero


@pytest.mark.parametrize("text", ["sqrt(-g1^2)", "log(-abs(g2))", "1/(g1^2 + g2^2 + g3^2 - 1)", "(-2)^g1"])
def test_what_has_no_value_in_an_octant_is_noticed(text):
    with pytest.raises(UndefinedInOctantError):
        examined(text, body(2), (1, 1, 1))


@pytest.mark.parametrize("text", ["(1 + g1 + g2 + g3)^400", "(g1 + exp(g1) + sin(g2))^900*g1"])
def test_powers_that_would_explode_are_not_expanded(text):
    ring, V, H, _ = examined(text, body(2), (1, 1, 1))
    assert len(V.numerator) == 1
    assert len(H.numerator) < 100
    with pytest.raises(NoProofError):
        # Nor is the difference of two of them, which would be.
        ring.normal(ring.add(V, ring.constant(Fraction(1))))
