"""The equations of motion hold on each case, and its relations and their rates vanish: exactly, in a ring."""

from fractions import Fraction

import pytest
from flint import fmpq, fmpq_poly
from sympy import Poly, Symbol, expand, simplify, symbols

from service.dynamics.classical.cases import (
    bobylev_steklov,
    chaplygin,
    dokshevich_1965,
    elliptic_x_minus_k_over_x,
    goriatchev,
    grioli,
    hess,
    konosevich_pozdnyakovich,
    kowalewski,
    staude,
    steklov,
)
from service.dynamics.classical.protocol import derivative, value
from tests.conformance.classical.exact import InTime, OnCurve, Residue
from tests.support.effort import one_in

PLACES = [Fraction(k, 7) for k in range(-19, 20, 2)]
"""More than the degree in x of any residual: at most 12, times the denominators."""
BODIES = [Fraction(k, 53) for k in range(3, 80, 16)]
"""Values of B; each is a proof for its own body."""


def residuals(reduced, moments, direction, x0):
    """Return what the equations of motion and the relations leave at x0, elements of the ring."""
    U, V = value(reduced.U, x0), value(reduced.V, x0)
    # Where u is not needed, U is 1 and so is u.
    u0 = OnCurve((0, 1, 0, 0) if len(reduced.U) > 1 else (1, 0, 0, 0), U, V)
    v0 = OnCurve((0, 0, 1, 0), U, V)
    x = InTime(OnCurve((x0, 0, 0, 0), U, V), u0 * v0 * reduced.rate)
    u = InTime(u0, v0 * (value(derivative(reduced.U), x0) * reduced.rate * Fraction(1, 2)))
    v = InTime(v0, u0 * (value(derivative(reduced.V), x0) * reduced.rate * Fraction(1, 2)))
    state = reduced.state(reduced.constants, x, u, v)
    for relation in reduced.relations(reduced.constants, state).values():
        yield from (relation.now, relation.rate)
    (A, B, C), (a, b, c) = moments, direction
    (p, q, r, T1, T2, T3), rates = [each.now for each in state], [each.rate for each in state]
    yield from (
        rates[0] * A + -(q * r * (B - C) + T2 * c + -(T3 * b)),
        rates[1] * B + -(r * p * (C - A) + T3 * a + -(T1 * c)),
        rates[2] * C + -(p * q * (A - B) + T1 * b + -(T2 * a)),
        rates[3] + -(r * T2 + -(q * T3)),
        rates[4] + -(p * T3 + -(r * T1)),
        rates[5] + -(q * T1 + -(p * T2)),
    )


def require_exact(reduced, moments, direction):
    for x0 in PLACES:
        assert all(each.is_zero() for each in residuals(reduced, moments, direction, x0))


SECOND = {
    "goriatchev": (goriatchev, lambda B: 8 * B * (2 * B - 1) / (16 * B - 9)),
    "kowalewski": (kowalewski, lambda B: 9 * B * (2 * B - 1) / (2 * (9 * B - 5))),
    "chaplygin": (chaplygin, lambda B: 9 * (2 * B - 1) / (2 * (16 * B - 9))),
}


@pytest.mark.parametrize("name", one_in(3, SECOND))
def test_the_equations_hold_for_every_body_of_the_condition(name: str):
    module, second = SECOND[name]
    for B in BODIES:
        C = second(B)
        assert module.condition(Fraction(1), B, C, 1, 0) == 0
        require_exact(module.reduced(B, C), (1, B, C), (1, 0, 0))


def test_the_equations_hold_for_the_bodies_of_steklov():
    for B in BODIES[::2]:
        for C in (Fraction(2, 7), Fraction(3, 11), Fraction(7, 5)):
            require_exact(steklov.reduced(B, C), (1, B, C), (1, 0, 0))


def test_the_equations_hold_for_bobylev_and_steklov_with_any_areas():
    half = Fraction(1, 2)
    for p in (Fraction(0), Fraction(2, 5), Fraction(-3, 2)):
        for h in (Fraction(1, 3), Fraction(-2, 7)):
            reduced = bobylev_steklov.reduced(half, Fraction(3, 4), p, h)
            require_exact(reduced, (1, Fraction(5, 8), half), (1, 0, 0))


PYTHAGOREAN = [(Fraction(3, 5), Fraction(4, 5)), (Fraction(5, 13), Fraction(12, 13))]


@pytest.mark.parametrize(("ex", "ez"), PYTHAGOREAN)
def test_the_equations_hold_for_grioli(ex, ez):
    for C in (Fraction(1, 2), Fraction(3, 4), Fraction(7, 5)):
        B = (ex * ex * C + ez * ez) / (ex * ex + ez * ez)
        assert grioli.condition(1, B, C, ex, ez) == 0
        require_exact(grioli.reduced(B, C, ex, ez), (1, B, C), (ex, 0, ez))


@pytest.mark.one_in(2)
@pytest.mark.parametrize(("ex", "ez"), PYTHAGOREAN)
def test_the_equations_hold_for_dokshevich_modulo_the_equation_of_eta(ex, ez):
    for C in (Fraction(1, 2), Fraction(2, 3), Fraction(4, 5)):
        B = C * (ex * ex + ez * ez) / (ex * ex + C * ez * ez)
        assert dokshevich_1965.condition(1, B, C, ex, ez) == 0
        _, al, k = dokshevich_1965.ratios(B, C, ex, ez)
        modulus = fmpq_poly([_fmpq(c) for c in dokshevich_1965.slope_equation(al, k)])
        eta = Residue(fmpq_poly([0, 1]), modulus)
        require_exact(dokshevich_1965.reduced(B, C, ex, ez, eta), (1, B, C), (ex, 0, ez))


@pytest.mark.parametrize("module", [konosevich_pozdnyakovich, elliptic_x_minus_k_over_x])
def test_the_equations_hold_modulo_the_minimal_polynomial(module):
    B = Residue(fmpq_poly([0, 1]), fmpq_poly(list(module.MINIMAL)))
    C = module.second(B)
    require_exact(module.reduced(B, C), (1, B, C), (1, 0, 0))


def test_the_minimal_polynomials_are_irreducible():
    for module in (konosevich_pozdnyakovich, elliptic_x_minus_k_over_x):
        assert Poly(list(reversed(module.MINIMAL)), Symbol("B")).is_irreducible


def test_the_relation_of_hess_has_itself_as_a_factor_of_its_derivative():
    A, B, C, a, c, p, q, r, g2 = symbols("A B C a c p q r g2")
    f = hess.momentum_along(A, C, a, c, p, r)
    rate = A * a * ((B - C) * q * r + c * g2) / A + C * c * ((A - B) * p * q - a * g2) / C
    mu = c * (A - B) / (A * a)
    # On the condition: B from it.
    middle = A * C * (a**2 + c**2) / (A * a**2 + C * c**2)
    assert simplify(hess.condition(A, middle, C, a, c)) == 0
    assert simplify((rate - mu * q * f).subs(B, middle)) == 0


def test_the_cone_of_staude_is_where_both_torques_are_parallel():
    moments, centre, g = symbols("A B C"), symbols("a b c"), symbols("x y z")
    K, N = staude.torques(moments, centre, g)
    cross = [K[1] * N[2] - K[2] * N[1], K[2] * N[0] - K[0] * N[2], K[0] * N[1] - K[1] * N[0]]
    cone = staude.cone(moments, centre, g)
    assert all(expand(each - factor * cone) == 0 for each, factor in zip(cross, g, strict=True))


def _fmpq(number: Fraction):
    return fmpq(number.numerator, number.denominator)
