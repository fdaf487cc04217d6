"""Section 3 of the paper, second half: the motions of a potential given by F and G."""

import math

import numpy as np
import pytest
import sympy
from flint import arb
from mpmath import mp, mpf, quad

from service.dynamics.equations.compatibility import energy_on_curve
from service.dynamics.equations.euler_poisson import energy_integral
from service.dynamics.potentials.families.written import general_potential
from service.dynamics.reduction.windows import find_windows
from tests.paper.forms import (
    G1,
    G2,
    G3,
    GAMMA,
    GENERAL_GRADIENT,
    GENERAL_V,
    A,
    C,
    H,
    Q,
    gradient,
    is_zero,
    symbolic,
)
from tests.paper.forms import GENERAL_F as F
from tests.paper.orbits import (
    ORBITS,
    State,
    agree,
    ball,
    motion_on,
    on_every_orbit,
    orbit_states,
    states,
    working_precision,
)
from tests.support.planar import body, formula, planar
from tests.support.solving import solve_planar

D = G1 * GENERAL_GRADIENT[2] - G3 * GENERAL_GRADIENT[0]


def varpi(at: State) -> arb:
    """Return F/Q + ∫F du/u² + G = (F + V)/Q with F = -h."""
    return (at.V - at.h) / at.Q


def test_O_angular_velocities():
    """(O): the squares are p² = -(2C/A) g3² ϖ, r² = -(2A/C) g1² ϖ: √(-ϖ) for the √ϖ printed.

    V = -g1, A = 2C = 2, ν = 1 at g1 = 1/2: ϖ = -1 and p² = 1/2.
    """
    p_squared = C * G3 * D / (A * (A - C) * G1)
    r_squared = A * G1 * D / (C * (A - C) * G3)
    whole = (F + GENERAL_V) / Q
    assert is_zero(p_squared + 2 * C / A * G3**2 * whole)
    assert is_zero(r_squared + 2 * A / C * G1**2 * whole)
    at = {G1: sympy.Rational(1, 2), G3: sympy.sqrt(2) / 2}
    energy = H(-G1, sympy.Integer(2), sympy.Integer(1)).subs(at)
    value = ((-G1 - energy) / (2 * G1**2 + G3**2)).subs(at)
    assert value == -1
    # p² by (6) with D = g3.
    assert (G3 * G3 / (2 * G1)).subs(at) == sympy.Rational(1, 2)


@on_every_orbit
def test_O_on_motions(name):
    """(O): (p, r) = (-√(2C/A) g3, √(2A/C) g1) σ √(-ϖ) along the service's motions, σ = ±1."""
    with working_precision():
        for at in states(name):
            root = (-varpi(at)).sqrt()
            sigma = 1 if at.r * at.g1 > 0 else -1
            assert agree(at.p, -sigma * (2 * at.C / at.A).sqrt() * at.g3 * root)
            assert agree(at.r, sigma * (2 * at.A / at.C).sqrt() * at.g1 * root)


@pytest.mark.parametrize("moments", [("17/10", 1), (3, 1), ("3/5", 1)])
def test_varpi_by_its_integral(moments):
    """ϖ, display after (O): F(w0)/Q + ∫F du/u² + G by quadrature gives p² of (6).

    F = e^{-w}, G = g2; D is that of the service's potential.
    """
    rigid_body = body(*moments)
    g1, g2, g3 = gamma = np.array([0.4, -0.6, math.sqrt(0.48)])
    slopes = general_potential(rigid_body, "exp(-w)", "g2", {}).gradient(gamma)
    A, C = (float(moment) for moment in (rigid_body.A, rigid_body.C))
    rho, Q, alpha = g1**2 + g3**2, A * g1**2 + C * g3**2, A / C

    def F(u: mpf) -> mpf:
        return mp.exp(-(abs(A * rho - u) ** alpha) / abs(C * rho - u))

    with mp.workdps(30):
        integral = quad(lambda u: F(u) / u**2, [rho * (A + C) / 2, Q])
        varpi = float(F(mpf(Q)) / Q + integral + g2)
    p_squared = C * g3 * (g1 * slopes[2] - g3 * slopes[0]) / (A * (A - C) * g1)
    # Doubles: sums of terms up to 10.
    assert abs(p_squared + 2 * C / A * g3**2 * varpi) < 1e-14


def test_varpi_sign_of_g2():
    """ϖ, last term: G(+√(1-…)) printed, G(g2) meant. V = Q g2, A = 2C = 2 at (2, -6, 3)/7: s² = 6/7 > 0.

    The printed ϖ = G(6/7) > 0 allows no motion there.
    """
    double = body(2, 1)
    potential = formula("(2*g1^2 + g3^2)*g2", double)
    at = dict(zip(GAMMA, (sympy.Rational(k, 7) for k in (2, -6, 3)), strict=True))
    V1, _, V3 = gradient(symbolic(potential))
    s_squared = ((G1 * V3 - G3 * V1) / (2 * G1 * G3)).subs(at)
    assert s_squared == sympy.Rational(6, 7) == -2 * at[G2] / 2
    assert s_squared != -2 * abs(at[G2]) / 2
    (window,) = find_windows(double, potential, motion_on(1))
    assert window.g2[1] <= 0


@on_every_orbit
def test_T_integrand(name):
    """(T): (dg1/dt)² = -(2A g1²/C) (1 - g1² - λ² g1^{2C/A}) ϖ, as printed, along the service's motions."""
    with working_precision():
        for at in states(name):
            last = 1 - at.g1**2 - at.lambda_**2 * abs(at.g1) ** (2 * at.C / at.A)
            printed = -2 * at.A * at.g1**2 / at.C * last * varpi(at)
            assert agree((at.r * at.g2) ** 2, printed)


def test_T_quadrature():
    """(T): t = ∫ dg1/√g between the rest points of V = -g1 + 1/(50 g3²) + 6/5 (g1² - g2²), A = 2C, ν = 1.

    Golden: half of 3.413231915305928034289635613636809859442; h = -0.74 = -F.
    """
    with mp.workdps(45):
        # ϖ = (V - h)/Q with g3² = g1 = x, g2² = 1 - x - x²
        def whole(x: mpf) -> mpf:
            V = -x + 1 / (50 * x) + mpf("1.2") * (2 * x * x + x - 1)
            return (V + mpf("0.74")) / (2 * x * x + x)

        low, high = (mp.findroot(lambda x: whole(x) * x**2, mpf(at)) for at in ("0.045", "0.37"))
        middle, reach = (low + high) / 2, (high - low) / 2

        def integrand(angle: mpf) -> mpf:
            x = middle - reach * mp.cos(angle)
            return reach * mp.sin(angle) / mp.sqrt(-4 * x**2 * (1 - x**2 - x) * whole(x))

        t = quad(integrand, [0, mp.pi / 2, mp.pi], method="gauss-legendre")
        golden = mpf("3.413231915305928034289635613636809859442")
        # 40 digits are golden; the integrand loses some at its ends.
        assert abs(2 * t - golden) < mpf(10) ** -35
    rigid_body, potential = body(*ORBITS["rest to rest"][0]), formula(ORBITS["rest to rest"][1], body(2, 1))
    found = solve_planar(planar(rigid_body, potential, ORBITS["rest to rest"][2]))
    period = found.dense.period
    assert period is not None
    assert abs(period.hi + period.lo - float(golden)) <= period.error + 4.5e-16  # one ulp of 3.4


@on_every_orbit
def test_h_is_kept(name):
    """h = -F, display after (T): the energy (E) of the service is one number along a motion."""
    rigid_body = body(*ORBITS[name][0])
    potential = formula(ORBITS[name][1], rigid_body)
    rows = np.array([[float(x) for x in (at.p, at.q, at.r, at.g1, at.g2, at.g3)] for at in states(name)])
    h = energy_integral(rigid_body, potential, rows[:, :3], rows[:, 3:])
    # Doubles: terms of size up to 10 in the sums.
    assert np.abs(h - float(states(name)[0].h)).max() < 1e-14
    assert is_zero(energy_on_curve(A, C, GAMMA, GENERAL_V, GENERAL_GRADIENT) + F)


def test_h_depends_on_the_curve_by_its_argument():
    """h = -F(-λ^{2A/C} (A-C)^{A/C-1}) of V = -g1(4g1² + 3g3²), A = 4C, F = -√w/(2·3^{3/2}), at three λ."""
    with working_precision():
        for number in ("1/2", "9/10", "7/5"):
            at = orbit_states((4, 1), "-g1*(4*g1^2+3*g3^2)", motion_on(number), 1)[0]
            w = ball(number) ** 8 * arb(3) ** 3
            assert agree(at.h, w.sqrt() / (2 * arb(27).sqrt()))
