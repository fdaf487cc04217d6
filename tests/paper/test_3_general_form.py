"""Section 3 of the paper: the general solution by two functions F and G.

F is written as a function of w = |A-C|^{α-1} |g3|^{2α}/g1² > 0; the argument printed is -w for A > C.
"""

import math
from fractions import Fraction

import numpy as np
import pytest
import sympy
from mpmath import mp, mpf, quad

from service.dynamics.equations.compatibility import along_curves, energy_on_curve, pde_residual
from service.dynamics.potentials.angular_part.field import curve_parameter
from service.dynamics.potentials.families.coefficients import homogeneous_potential
from service.dynamics.potentials.families.written import general_potential
from tests.paper.forms import (
    ALPHA,
    G1,
    G2,
    G3,
    GAMMA,
    GENERAL_F,
    GENERAL_GRADIENT,
    GENERAL_V,
    RHO,
    A,
    C,
    H,
    L,
    Q,
    gradient,
    is_zero,
    symbolic,
)
from tests.support.planar import body
from tests.support.witnesses.angular_part import angular_part


def test_V_general_solution():
    """(V): if H[V] = H[V1], (V - V1)/Q is a function of g2: (g1 d_3 - g3 d_1)(V/Q) = 2(A-C) g1 g3 H[V]/Q²."""
    W = sympy.Function("W")(*GAMMA)
    first = gradient(W / Q)
    assert is_zero(G1 * first[2] - G3 * first[0] - 2 * (A - C) * G1 * G3 * H(W) / Q**2)


@pytest.mark.parametrize("moments", [("17/10", 1), (3, 5)])
def test_V_of_the_service(moments):
    """(V): the service's potential of F(w) = e^{-w} and G(g2) = g2 is V1 + Q g2, has H = -F, and L(V) = 0."""
    rigid_body = body(*moments)
    potential = general_potential(rigid_body, "exp(-w)", "g2", {})
    A, C = (float(moment) for moment in (rigid_body.A, rigid_body.C))
    gamma = np.array([0.4, -0.6, math.sqrt(0.48)])
    g1, g2, g3 = gamma
    part = angular_part(rigid_body, lambda w: np.exp(-w), gamma)
    # One and the same integral twice: rounding.
    assert abs(potential.value(gamma) - part - (A * g1**2 + C * g3**2) * g2) < 1e-15
    first, second = potential.gradient(gamma), potential.hessian(gamma)
    w = curve_parameter(rigid_body, g1, g3)
    # Sums of some ten terms of size 1 to 10, in doubles.
    assert abs(energy_on_curve(A, C, gamma, potential.value(gamma), first) + math.exp(-w)) < 1e-14
    assert abs(pde_residual(A, C, gamma, first, second)) < 1e-13


def test_V1_solves_the_equation():
    """(V1): H[V1] = -F(w), and w is constant on the curves, so L(V1) = -(2(A-C) g1 g3/Q) X(H[V1]) = 0."""
    assert is_zero(energy_on_curve(A, C, GAMMA, GENERAL_V, GENERAL_GRADIENT) + GENERAL_F)
    w = G3 ** (2 * ALPHA) / G1**2
    steps = along_curves(ALPHA, sympy.Integer(1), GAMMA, gradient(w))
    assert sympy.powsimp(sympy.expand(steps / w)) == 0


def test_V1_argument():
    """(V1): at u = Q the argument is (A-C)^α |g3|^{2α}/(-(A-C) g1²): -w for A > C, complex for A < C."""
    assert is_zero(A * RHO - Q - (A - C) * G3**2)
    assert is_zero(C * RHO - Q + (A - C) * G1**2)
    values = {A: 3, C: 5, G1: sympy.Rational(1, 2), G3: sympy.Rational(1, 3)}
    printed = ((A * RHO - Q) ** (A / C) / (C * RHO - Q)).subs(values)
    assert sympy.im(sympy.N(printed, 30)) != 0
    # What the service has in its place, for both.
    g = np.array([0.5, 1 / 3])
    for first, third in ((3, 5), (5, 3), (2, 1)):
        difference, alpha = abs(first - third), first / third
        w = difference ** (alpha - 1) * g[1] ** (2 * alpha) / g[0] ** 2
        assert curve_parameter(body(first, third), *g) == pytest.approx(w, rel=1e-14)  # a few roundings


@pytest.mark.parametrize(("first", "third"), [("17/10", 1), (3, 1), ("3/5", 1), (2, 5)])
def test_V1_integral(first, third):
    """(V1): Q ∫ F(w) du/u² by quadrature over u from ρ(A+C)/2 is the service's V1 from φ0 = π/4; F = e^{-w}.

    40 digits against doubles; the service promises some 1e-15 of the largest |F| = 1.
    """
    rigid_body = body(first, third)
    A, C = float(rigid_body.A), float(rigid_body.C)
    alpha = A / C
    for g1, g3 in ((0.41, 0.52), (0.7, 0.1), (0.2, 0.9)):
        rho, last = g1 * g1 + g3 * g3, A * g1 * g1 + C * g3 * g3

        def integrand(u: mpf, rho: float = rho) -> mpf:
            return mp.exp(-(abs(A * rho - u) ** alpha) / abs(C * rho - u)) / u**2

        with mp.workdps(40):
            expected = last * quad(integrand, [rho * (A + C) / 2, last])
        gamma = np.array([g1, math.sqrt(1 - rho), g3])
        found = angular_part(rigid_body, lambda w: np.exp(-w), gamma)
        assert abs(found - float(expected)) < 1e-14


def test_V1_needs_a_function_per_quadrant():
    """(V1): with one F it is even in g1 and g3; V = a g1 has H = -aν/2, odd, at equal w = C ν²."""
    east, west = ({G1: sign * sympy.Rational(1, 2), G3: sympy.Rational(1, 2)} for sign in (1, -1))
    energy = H(G1, 2 * C)
    assert energy.subs(east) == -energy.subs(west) == sympy.Rational(-1, 4)
    points = np.array([[0.5, 0.1, 0.5], [-0.5, 0.1, 0.5], [0.5, 0.1, -0.5]])
    assert len(set(curve_parameter(body(2, 1), points[:, 0], points[:, 2]).tolist())) == 1
    assert len(set(angular_part(body(2, 1), lambda w: w, points).tolist())) == 1


def test_V1_lower_limit():
    """(V1): the lower limit may be any multiple of ρ: another adds Q c(ρ), a V2. A fixed number fails.

    F(w) = 1/w, A = 2, C = 1: a limit 3/2 is inside C ρ < u < A ρ for ρ = 1; for ρ = 1/2 the way down
    to Q < 1 crosses u = A ρ = 1, where F du/u² has a pole of order 2.
    """
    c = sympy.Function("c")(RHO)
    assert is_zero(L(Q * c).doit())
    u = sympy.Symbol("u")
    integrand = (u - sympy.Rational(1, 2)) / (1 - u) ** 2 / u**2
    assert sympy.limit(integrand * (u - 1) ** 2, u, 1) == sympy.Rational(1, 2)


def test_V2_solves_the_equation():
    """(V2): L(Q G(g2)) = 0 and H = 0 for every G; the service's A_n-terms are of this form."""
    function = Q * sympy.Function("G")(G2)
    assert is_zero(L(function))
    assert is_zero(H(function))
    potential = homogeneous_potential(body(3, 2), A=[Fraction(k) for k in (1, -2, 5)])
    assert is_zero(symbolic(potential) - (3 * G1**2 + 2 * G3**2) * (1 - 2 * G2 + 5 * G2**2))
