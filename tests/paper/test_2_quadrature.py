"""Section 2 of the paper, second half: the curve, the integral, Theorem 1, on motions of the service."""

import numpy as np
import pytest
import sympy
from flint import arb
from mpmath import mp, mpf, quad

from service.dynamics.errors import EqualMomentsError
from service.dynamics.problem import StartAtRest
from service.dynamics.reduction.windows import find_windows
from tests.paper.forms import GAMMA, C, L, gradient, is_zero, symbolic
from tests.paper.orbits import (
    ORBITS,
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
from workers.solvers.integration.solve import integrate_state

G1, G2, G3 = GAMMA
V = sympy.Function("V")(*GAMMA)
V1, V2, V3 = gradient(V)
D = G1 * V3 - G3 * V1


@on_every_orbit
def test_8_curve(name):
    """(8): |g3| = λ |g1|^{C/A} along the service's motions."""
    with working_precision():
        assert all(agree(abs(at.g3), at.lambda_ * abs(at.g1) ** (at.C / at.A)) for at in states(name))


def test_8_both_signs_belong_to_it():
    """(8): g3 = +λ g1^{C/A} printed; on one motion g3 takes both signs, and g1 < 0 is as good as g1 > 0."""
    with working_precision():
        assert {bool(at.g3 > 0) for at in states("Bobylev-Steklov")} == {True, False}
        mirrored = orbit_states((2, 1), "g1", motion_on("-13/10", nu=True))
        assert all(at.g1 < 0 and agree(at.g3**2, ball("-13/10") * at.g1) for at in mirrored)


@on_every_orbit
def test_9_second_component(name):
    """(9): g2² = 1 - g1² - λ² g1^{2C/A}."""
    with working_precision():
        for at in states(name):
            power = at.lambda_**2 * abs(at.g1) ** (2 * at.C / at.A)
            assert agree(at.g2**2, 1 - at.g1**2 - power)


def test_9_both_signs_belong_to_it():
    """(9): g2 = +√ printed; a motion that reaches the equator g2 = 0 goes on with the other sign."""
    assert {bool(at.g2 > 0) for at in states("rest to equator")} == {True, False}


@on_every_orbit
def test_g_of_the_quadrature(name):
    """g(g1), display after (t): (dg1/dt)² = A g1^{(A-C)/A}/(C (A-C) λ) (1 - g1² - λ² g1^{2C/A}) (D)_0.

    For g3 > 0; λ takes the sign of g3 and |g1| stands under the powers otherwise.
    """
    with working_precision():
        for at in states(name):
            size = abs(at.g1)
            sign = arb(1) if at.g3 * at.g1 > 0 else arb(-1)
            power = size ** ((at.A - at.C) / at.A) * sign
            last = 1 - size**2 - at.lambda_**2 * size ** (2 * at.C / at.A)
            printed = at.A * power / (at.C * (at.A - at.C) * at.lambda_) * last * at.D
            assert agree((at.r * at.g2 - at.q * at.g3) ** 2, printed)


def test_t_quadrature():
    """(t): t = ∫ dg1/√g, both hemispheres of a libration with G not even, against the service's period.

    Golden: 6.55593813374157484500337478933646021 (closed against integration with 220-bit floats).
    """
    rigid_body = body(3, 1)
    potential = formula(ORBITS["G not even"][1], rigid_body)
    motion = motion_on("4/5", start=StartAtRest(g2_sign=-1))
    with mp.workdps(45):
        golden = mpf("6.55593813374157484500337478933646021")
        slopes = sympy.lambdify(GAMMA, gradient(symbolic(potential)), "mpmath")
        power = mpf(2) / 3

        def g(x: mpf, side: int) -> mpf:
            last = 1 - x**2 - mpf(16) / 25 * x**power
            g3 = mpf(4) / 5 * x ** (power / 2)
            first, _, third = slopes(x, side * mp.sqrt(abs(last)), g3)
            return 3 * x**power / (2 * mpf("0.8")) * last * (x * third - g3 * first)

        equator = mp.findroot(lambda x: 1 - x**2 - mpf(16) / 25 * x**power, mpf("0.70"))
        half = mpf(0)
        for side in (-1, 1):
            # s² = -2G/(AC) vanishes with G.
            height = mp.findroot(lambda y: y**2 - 0.5 + y**3 / 5, mpf("0.7") * side)
            rest = mp.findroot(lambda x, y=height: 1 - y**2 - x**2 - mpf(16) / 25 * x**power, mpf("0.4"))
            middle, reach = (rest + equator) / 2, (equator - rest) / 2
            # g1 = middle - reach cos θ takes the square roots out of both ends.
            half += quad(
                lambda θ, side=side, middle=middle, reach=reach: (
                    reach * mp.sin(θ) / mp.sqrt(g(middle - reach * mp.cos(θ), side))
                ),
                [0, mp.pi],
                method="gauss-legendre",
            )
        # Golden has 36 digits; some are lost in g near its zeros.
        assert abs(2 * half - golden) < mpf(10) ** -33
        motion_found = solve_planar(planar(rigid_body, potential, motion))
        period = motion_found.dense.period
        assert period is not None
        # The period is two doubles, good to 1e-17 of itself; its own bound is honoured.
        assert abs(mpf(period.hi) + mpf(period.lo) - golden) < max(period.error, 1e-15)


def test_theorem_1_two_routes():
    """Theorem 1: the motions found from (6), (8), (9), (t) are those of the six equations (1), (2)."""
    rigid_body = body(3, 1, "5/2")
    potential = formula(ORBITS["G not even"][1], rigid_body)
    found = solve_planar(
        planar(rigid_body, potential, ORBITS["G not even"][2], (0, 1, 3, 5), tolerance=1e-11)
    )
    start = found.samples[0]
    integrated = integrate_state(
        rigid_body, potential, start[:3].tolist(), start[3:].tolist(), found.times, tolerance=1e-9
    )
    # Both carry a bound of their own error; the integrator also starts from rounded values.
    assert np.abs(found.samples - integrated.samples).max() < found.error + integrated.error < 2e-9


def test_theorem_1_for_an_arbitrary_body():
    """Theorem 1: "an arbitrary rigid body" must have A ≠ C, and (6) a positive radicand somewhere.

    V = g1, A = 2C, g1 > 0: s² = -1/((A-C) A C g1) < 0, there is no motion.
    """
    with pytest.raises(EqualMomentsError):
        find_windows(body(1, 1), formula("g1", body(1, 1)), motion_on(1))
    double = body(2, 1)
    assert find_windows(double, formula("g1", double), motion_on(1)) == ()
    assert find_windows(double, formula("g1", double), motion_on(-1, nu=True)) != ()


def test_theorem_1_needs_less():
    """Theorem 1: (e) on one curve is enough for the motions on it: V = -g1 + (g3² - g1)², A = 2C, λ = 1."""
    on_curve = {G3: sympy.sqrt(G1)}
    residual = L(-G1 + (G3**2 - G1) ** 2, 2 * C)
    assert is_zero(residual.subs(on_curve))
    assert not is_zero(residual)
