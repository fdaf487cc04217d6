"""Laws of the compatibility equation: its factors, its symmetries, its blindness off the sphere."""

from fractions import Fraction

import pytest
import sympy
from flint import ctx

from service.dynamics.equations.compatibility import (
    along_curves,
    energy_on_curve,
    pde_residual,
    residual_ball,
    residual_of,
)
from service.dynamics.formula.algebras.symbolic import sympy_expression
from tests.dynamics.verdict.formulas import body, potential

A, C = sympy.symbols("A C", positive=True)
GAMMA = sympy.symbols("g1 g2 g3", real=True)
G1, G2, G3 = GAMMA
POINT = (Fraction(2, 7), Fraction(6, 7), Fraction(3, 7))


def gradient(f: sympy.Expr) -> list[sympy.Expr]:
    return [f.diff(g) for g in GAMMA]


def L(V: sympy.Expr, first: sympy.Expr = A, third: sympy.Expr = C) -> sympy.Expr:
    return pde_residual(first, third, GAMMA, gradient(V), [gradient(slope) for slope in gradient(V)])


def test_the_equation_factorises_through_the_energy_on_a_curve_for_every_potential():
    V = sympy.Function("V")(*GAMMA)
    H = energy_on_curve(A, C, GAMMA, V, gradient(V))
    Q = A * G1**2 + C * G3**2
    product = -2 * (A - C) * G1 * G3 / Q * along_curves(A, C, GAMMA, gradient(H))
    assert sympy.simplify(sympy.expand(L(V) - product)) == 0


def test_a_factor_r_squared_passes_through_the_equation():
    W = sympy.Function("W")(*GAMMA)
    R = G1**2 + G2**2 + G3**2
    assert sympy.expand(L(R * W) - R * L(W)) == 0


def test_exchanging_the_axes_changes_the_sign_of_the_equation():
    # (A, C; g1, g3) -> (C, A; g3, g1), V(g1, g2, g3) -> V(g3, g2, g1).
    V = G1**3 * G2 + G3 * G2**2 * G1 + G3**4 / G1 + sympy.sin(G2 * G3)
    swap = {G1: G3, G3: G1}
    mirrored = L(V.subs(swap, simultaneous=True), C, A)
    assert sympy.simplify(mirrored + L(V).subs(swap, simultaneous=True)) == 0


@pytest.mark.parametrize("axis", [0, 2])
def test_mirroring_one_axis_changes_the_sign_of_the_equation(axis):
    V = G1**3 * G2 + G3 * G2**2 * G1 + G3**4 / G1 + sympy.sin(G2 * G3)
    mirror = {GAMMA[axis]: -GAMMA[axis]}
    assert sympy.simplify(L(V.subs(mirror)) + L(V).subs(mirror)) == 0


def test_misprinting_the_a3_term_leaves_the_residual_of_erratum_1():
    V = 16 * G1 * (8 * G1**4 + 16 * G1**2 * G3**2 + 9 * G3**4) + 16 * G3**6 / G1
    corrected = L(V - G3**8 / G1**3, 2 * C)
    printed = L(V + G3**8 / G1**3, 2 * C)
    assert sympy.simplify(corrected) == 0
    assert sympy.simplify(printed + 64 * C * G2 * G3**7 / G1**2) == 0


@pytest.mark.parametrize("text", ["g1*g2 + g3^3", "exp(g1)*sqrt(2 + g2)/g3", "sin(g1*g2) + log(1 + g3^2)"])
def test_balls_enclose_the_exact_residual(text):
    # The midpoint may be off by the radius, and SymPy's value by its last digits: 60 for a ball of 150 bits.
    on = body("17/10")
    V = potential(text, on)
    with ctx.workprec(150):
        ball = residual_ball(on, V.tape, POINT)
        exact = L(sympy_expression(V.tape, GAMMA), sympy.Rational(17, 10), sympy.Integer(1))
        values = {g: sympy.Rational(x.numerator, x.denominator) for g, x in zip(GAMMA, POINT, strict=True)}
        truth = type(ball.residual)(str(sympy.N(exact.subs(values), 60)))
        assert ball.residual.overlaps(truth)
        assert abs(ball.residual) < ball.size * 1.0001
        assert ball.residual.rad() < ball.size * 2.0**-130


def test_where_the_potential_has_no_value_nothing_is_enclosed():
    on = body(2)
    assert not residual_ball(on, potential("log(-1 - g1^2)").tape, POINT).is_defined


def test_both_ways_to_a_residual_agree():
    on = body("17/10", 1)
    V = potential("exp(g1*g2) + g3^3/g1", on)
    with ctx.workprec(100):
        by_tape, by_jet = residual_ball(on, V.tape, POINT), residual_of(on, V, POINT)
        assert str(by_tape) == str(by_jet)
        assert not residual_of(on, potential("log(-1 - g1^2)"), POINT).is_defined
