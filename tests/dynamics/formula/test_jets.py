"""Derivatives by jets against SymPy's, and against each other."""

import math
from fractions import Fraction

import numpy as np
import pytest
import sympy
from flint import arb, ctx, fmpq

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.jets import FirstOrderJets, Jet, SecondOrderJets
from service.dynamics.formula.algebras.real import RealAlgebra, ScalarAlgebra
from service.dynamics.formula.algebras.symbolic import SymbolicAlgebra, real_symbols, sympy_expression
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.formula.tree import VARIABLES
from tests.support.formulas import POTENTIALS

POINTS = [
    (Fraction(3, 10), Fraction(-1, 7), Fraction(2, 3)),
    (Fraction(9, 11), Fraction(1, 2), Fraction(1, 13)),
]
FUNCTIONS = ["exp(X)", "log(X)", "sin(X)", "cos(X)", "tan(X)", "abs(X)", "abs(-X)", "sqrt(X)", "X^-1", "X^3"]
COMPOSED = [function.replace("X", "(2 + g1*g2 - g3/4)") for function in FUNCTIONS]


def _balls(point: tuple[Fraction, ...]) -> tuple[arb, ...]:
    return tuple(arb(fmpq(x.numerator, x.denominator)) for x in point)


@pytest.mark.one_in(4)
@pytest.mark.parametrize("text", POTENTIALS + COMPOSED)
@pytest.mark.parametrize("point", POINTS)
def test_gradient_and_hessian_are_those_of_sympy(text: str, point: tuple[Fraction, ...]) -> None:
    tape = compile_tape(parse(text))
    symbols = real_symbols(VARIABLES)
    expression = sympy_expression(tape)
    values = {s: sympy.Rational(x.numerator, x.denominator) for s, x in zip(symbols, point, strict=True)}

    def number(derivative: sympy.Expr) -> arb:
        return arb(str(derivative.subs(values).evalf(50)))

    with ctx.workprec(200):
        jets = SecondOrderJets(BallAlgebra(), 3)
        jet = tape.evaluate(jets, jets.variables(_balls(point)))
        gradient, hessian = jets.gradient(jet), jets.hessian(jet)
        for i, x in enumerate(symbols):
            expected = number(expression.diff(x))
            # SymPy evaluates to 50 digits; the values are below 10^6.
            assert abs(gradient[i] - expected) < arb("1e-43") * (1 + abs(expected))
            for j, y in enumerate(symbols):
                expected = number(expression.diff(x, y))
                assert abs(hessian[i][j] - expected) < arb("1e-43") * (1 + abs(expected))


@pytest.mark.parametrize("text", POTENTIALS)
def test_first_order_is_the_first_part_of_second_order(text: str) -> None:
    tape = compile_tape(parse(text))
    first, second = FirstOrderJets(BallAlgebra(), 3), SecondOrderJets(BallAlgebra(), 3)
    point = _balls(POINTS[0])
    short = tape.evaluate(first, first.variables(point))
    long = tape.evaluate(second, second.variables(point))
    assert str(short.value) == str(long.value)
    assert [str(x) for x in first.gradient(short)] == [str(x) for x in second.gradient(long)]


@pytest.mark.parametrize("text", POTENTIALS)
def test_one_direction_is_the_gradient_along_it(text: str) -> None:
    tape = compile_tape(parse(text))
    point, direction = POINTS[0], (Fraction(2), Fraction(-1, 3), Fraction(5, 7))
    with ctx.workprec(150):
        full, single = FirstOrderJets(BallAlgebra(), 3), SecondOrderJets(BallAlgebra(), 1)
        gradient = full.gradient(tape.evaluate(full, full.variables(_balls(point))))
        along = _balls(direction)
        inputs = [single.seed(x, (d,)) for x, d in zip(_balls(point), along, strict=True)]
        jet = tape.evaluate(single, inputs)
        expected = sum((g * d for g, d in zip(gradient, along, strict=True)), arb(0))
        assert single.gradient(jet)[0].overlaps(expected)

        whole = SecondOrderJets(BallAlgebra(), 3)
        hessian = whole.hessian(tape.evaluate(whole, whole.variables(_balls(point))))
        bend = sum((hessian[i][j] * along[i] * along[j] for i in range(3) for j in range(3)), arb(0))
        assert single.hessian(jet)[0][0].overlaps(bend)


@pytest.mark.parametrize("text", POTENTIALS)
def test_arrays_and_floats_give_the_same_gradient(text: str) -> None:
    tape = compile_tape(parse(text))
    point = tuple(float(x) for x in POINTS[0])
    scalars, arrays = FirstOrderJets(ScalarAlgebra(), 3), FirstOrderJets(RealAlgebra(), 3)
    one = scalars.gradient(tape.evaluate(scalars, scalars.variables(point)))
    many = arrays.gradient(tape.evaluate(arrays, arrays.variables([np.array([x, x]) for x in point])))
    for x, y in zip(one, many, strict=True):
        # numpy's and the C library's functions differ by an ulp or two each.
        assert np.allclose(x, y, rtol=1e-14, atol=1e-14)


def test_jets_work_over_expressions() -> None:
    tape = compile_tape(parse("g1^2*g3 + sin(g2)"))
    g1, g2, g3 = real_symbols(VARIABLES)
    jets = SecondOrderJets(SymbolicAlgebra(), 3)
    jet = tape.evaluate(jets, jets.variables((g1, g2, g3)))
    assert jets.gradient(jet) == (2 * g1 * g3, sympy.cos(g2), g1**2)
    assert jets.hessian(jet) == ((2 * g3, 0, 2 * g1), (0, -sympy.sin(g2), 0), (2 * g1, 0, 0))


def test_a_zero_derivative_is_none_and_costs_nothing() -> None:
    tape = compile_tape(parse("g2*(g1 + 3) + log(g3)"))
    jets = FirstOrderJets(ScalarAlgebra(), 1)
    inputs = (jets.seed(1.0, (None,)), jets.seed(2.0, (None,)), jets.seed(0.0, (None,)))
    jet = tape.evaluate(jets, inputs)
    assert jet.first == (None,)
    assert jets.gradient(jet) == (0.0,)
    # The derivative of log at 0, which has none, was not asked for.
    assert math.isnan(jet.value)
    assert jets.pi() == Jet(math.pi, (None,))


def test_the_derivative_of_the_modulus_is_the_sign() -> None:
    tape = compile_tape(parse("abs(g1)"))
    jets = SecondOrderJets(ScalarAlgebra(), 1)
    for x, sign in ((2.0, 1.0), (-3.0, -1.0)):
        jet = tape.evaluate(jets, (jets.seed(x, (1.0,)), jets.constant(Fraction(0)), jets.pi()))
        assert jets.gradient(jet) == (sign,)
        assert jets.hessian(jet) == ((0.0,),)
    sign_jet = jets.call("sign", jets.seed(-3.0, (1.0,)))
    assert (sign_jet.value, jets.gradient(sign_jet)) == (-1.0, (0.0,))


def test_a_ball_on_one_side_of_zero_has_an_exact_slope() -> None:
    jets = FirstOrderJets(BallAlgebra(), 1)
    jet = jets.call("abs", jets.seed(arb(-1, "0.5"), (arb(1),)))
    assert jets.gradient(jet)[0] == -1
