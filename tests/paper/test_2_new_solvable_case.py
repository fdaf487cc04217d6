"""Section 2 of the paper: from q = 0, I3 = 0 to one quadrature.

The motions of the service are states of its orbits in balls; the right-hand sides
of the paper are evaluated there.
"""

import pytest
import sympy
from flint import arb

from service.dynamics.equations.compatibility import along_curves
from tests.paper.forms import GAMMA, A, C, L, gradient, is_zero, printed_rates, service_rates
from tests.paper.orbits import (
    agree,
    on_every_orbit,
    states,
    working_precision,
)
from tests.support.planar import body, formula

G1, G2, G3 = GAMMA
V = sympy.Function("V")(*GAMMA)
V1, V2, V3 = gradient(V)
D = G1 * V3 - G3 * V1


@on_every_orbit
def test_3_q_vanishes(name):
    """(3): q = 0 along the service's motions, and (1), (2) keep it: q' = 0 there."""
    with working_precision():
        for at in states(name):
            assert at.q == 0
            assert agree((at.C - at.A) * at.p * at.r - at.D, arb(0))


@on_every_orbit
def test_4_areas_vanish(name):
    """(4): I3 = A p g1 + B q g2 + C r g3 = 0 along the service's motions."""
    with working_precision():
        assert all(agree(at.A * at.p * at.g1 + at.C * at.r * at.g3, arb(0)) for at in states(name))


@pytest.mark.parametrize("gamma", [(2, 3, -5), (-1, 4, 7)])
def test_5_middle_equation(gamma):
    """(5): (A-C) p r - g3 V_1 + g1 V_3 = 0 is the service's B q' = 0 at q = 0. Integers: exact in doubles."""
    rigid_body = body(4, 2, 8)
    potential = formula("g1^2*g3 - 3*g2*g3 + 2*g1*g2^2", rigid_body)
    (p, r), (g1, g2, g3) = (3, -5), gamma
    slope_1, slope_3 = 2 * g1 * g3 + 2 * g2**2, g1**2 - 3 * g2
    rates = service_rates(rigid_body, potential, (p, 0, r), gamma)
    assert -8 * rates.omega[1] == (4 - 2) * p * r - g3 * slope_1 + g1 * slope_3


@on_every_orbit
def test_6_squares_of_the_angular_velocities(name):
    """(6): p² = C g3 D/(A (A-C) g1), r² = A g1 D/(C (A-C) g3), D = g1 V_3 - g3 V_1, as printed."""
    with working_precision():
        for at in states(name):
            assert agree(at.p**2, at.C * at.g3 * at.D / (at.A * (at.A - at.C) * at.g1))
            assert agree(at.r**2, at.A * at.g1 * at.D / (at.C * (at.A - at.C) * at.g3))


def test_6_signs_of_the_angular_velocities():
    """(6): the printed signs -, + break I3 = 0 and (5) where g1 g3 < 0; p = -C g3 s, r = A g1 s keep both.

    V = g1, A = 2, C = 1, at (g1, g3) = (-1/4, 1/2): printed p = -1/√2, r = 1/√2, I3 = 1/√2.
    """
    A, C, g1, g3 = 2, 1, sympy.Rational(-1, 4), sympy.Rational(1, 2)
    D = -g3
    p, r = -sympy.sqrt(C * g3 / (A * (A - C) * g1) * D), sympy.sqrt(A * g1 / (C * (A - C) * g3) * D)
    assert A * p * g1 + C * r * g3 == 1 / sympy.sqrt(2)
    assert (A - C) * p * r + D == -1
    s = sympy.sqrt(D / ((A - C) * A * C * g1 * g3))
    p, r = -C * g3 * s, A * g1 * s
    assert A * p * g1 + C * r * g3 == (A - C) * p * r + D == 0
    # And p takes both signs on one motion between rest points with g1, g3 > 0.
    signs = {bool(at.p > 0) for at in states("rest to rest")}
    assert signs == {True, False}


@on_every_orbit
def test_6_one_amplitude(name):
    """(6), corrected: r = A g1 s with the s of p = -C g3 s, s² = D/((A-C) A C g1 g3), on all signs."""
    with working_precision():
        for at in states(name):
            s = -at.p / (at.C * at.g3)
            assert agree(at.r, at.A * at.g1 * s)
            assert agree(s**2, at.D / ((at.A - at.C) * at.A * at.C * at.g1 * at.g3))


def test_e_the_operator_of_the_service():
    """(e): the printed left side is the service's L(V), for every V."""
    V11, V12, V13 = gradient(V1)
    V23, V33 = V2.diff(G3), V3.diff(G3)
    printed = (
        G1 * G2 * G3 * (A * V11 - C * V33)
        + (A * G1**2 + C * G3**2) * (G1 * V23 - G3 * V12)
        - G2 * (A * G1**2 - C * G3**2) * V13
        - (A - 2 * C) * G2 * G3 * V1
        + 2 * (A - C) * G3 * G1 * V2
        - (2 * A - C) * G1 * G2 * V3
    )
    assert sympy.expand(printed - L(V)) == 0


def test_e_is_what_the_first_and_third_equations_say():
    """(e): with (6) the residuals of (1) are L/(2(A-C) g1), 0, -L/(2(A-C) g3): zero exactly where L = 0."""
    s_squared = D / ((A - C) * A * C * G1 * G3)

    def rate_over_s(f: sympy.Expr) -> sympy.Expr:
        return along_curves(A, C, GAMMA, gradient(f))

    s = sympy.Symbol("s")
    torques, turning = printed_rates((A, 1, C), (V1, V2, V3), (-C * G3 * s, 0, A * G1 * s), GAMMA)
    # (f s)' = s² X(f) + f X(s²)/2, with X the derivative along the curve per s dt.
    p_rate = -C * (s_squared * rate_over_s(G3) + G3 * rate_over_s(s_squared) / 2)
    r_rate = A * (s_squared * rate_over_s(G1) + G1 * rate_over_s(s_squared) / 2)
    assert is_zero(A * p_rate - torques[0] - L(V) / (2 * (A - C) * G1))
    assert is_zero(torques[1].subs(s**2, s_squared))
    assert is_zero(C * r_rate - torques[2] + L(V) / (2 * (A - C) * G3))
    assert all(is_zero(s * rate_over_s(g) - rate) for g, rate in zip(GAMMA, turning, strict=True))


def test_7_slope_of_the_curve():
    """(7): dg3/dg1 = C g3/(A g1), from the service's derivative along the curves and from (2) with I3 = 0."""
    steps = [along_curves(A, C, GAMMA, [int(i == j) for j in range(3)]) for i in range(3)]
    assert is_zero(steps[2] / steps[0] - C * G3 / (A * G1))
    rigid_body = body(4, 2, 8)
    g1, g2, g3 = 3, -2, 5
    omega = (-2 * g3, 0, 4 * g1)
    rates = service_rates(rigid_body, formula("g2", rigid_body), omega, (g1, g2, g3)).gamma
    assert rates[2] * 4 * g1 == rates[0] * 2 * g3 != 0
