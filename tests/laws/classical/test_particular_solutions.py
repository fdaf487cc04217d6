"""The particular solutions of the heavy body: relations kept, periods closed, instabilities told."""

import mpmath
import numpy as np
import pytest
from scipy.special import ellipk

from service.dynamics.equations.euler_poisson import areas_integral, energy_integral
from tests.support.classical import sensitivity
from tests.support.classical_oblique import BOBYLEV, CHAPLYGIN, GRIOLI, HESS, OBLIQUE, STAUDE, grioli_state
from tests.support.classical_on_axis import (
    GORIACHEV,
    KONOSEVICH_1,
    KONOSEVICH_2,
    ON_AXIS_ONE,
    STEKLOV,
    STEKLOV_LARGEST_A,
)
from tests.support.heyoka_integrator import HEYOKA
from workers.solvers.errors import AccuracyNotMetError
from workers.solvers.integration.solve import integrate_state

ALL = (*ON_AXIS_ONE, *OBLIQUE)
PERIODIC = [example for example in ALL if example.period is not None]
BY_RUNGE_KUTTA = (GORIACHEV, STEKLOV, KONOSEVICH_1, HESS, BOBYLEV, CHAPLYGIN, GRIOLI)
UNSTABLE = (STEKLOV, KONOSEVICH_1, KONOSEVICH_2, CHAPLYGIN)
"""Departures from these grow exponentially; from the others, at most by a power of the time."""
WITH_INTEGRATORS = [(example, HEYOKA) for example in ALL] + [(e, "dop853") for e in BY_RUNGE_KUTTA]


def names(value):
    return getattr(value, "name", value)


def along(example, times, *, integrator=HEYOKA, tolerance=1e-10):
    return integrate_state(
        example.body,
        example.potential,
        example.omega,
        example.gamma,
        np.asarray(times),
        tolerance=tolerance,
        integrator=integrator,
    )


@pytest.mark.one_in(4)
@pytest.mark.parametrize(("example", "integrator"), WITH_INTEGRATORS, ids=names)
def test_relations_and_integrals_hold_over_a_period(example, integrator):
    motion = along(example, np.linspace(0.0, example.period or 10.0, 121), integrator=integrator)
    omega, gamma = motion.samples[:, :3], motion.samples[:, 3:]
    # A departure from the relations may grow along the motion; the claim grows with it, and a residual is
    # off by the departure of the state times its own slope. Rounding in the residual is below the claim's.
    allowed = sensitivity(example.residuals, motion.samples) * motion.error
    assert np.abs(example.residuals(motion.samples)).max() <= allowed <= 1e-6
    # Sums of products of numbers below 5.
    inertia = max(float(example.body.A), float(example.body.B), float(example.body.C))
    allowed = 6 * inertia * np.abs(motion.samples).max() * motion.error
    energy = energy_integral(example.body, example.potential, omega, gamma)
    assert np.abs(energy - example.energy).max() <= allowed
    assert np.abs(areas_integral(example.body, omega, gamma) - example.areas).max() <= allowed


@pytest.mark.parametrize("example", PERIODIC, ids=names)
def test_the_period_and_none_of_its_parts_leads_back(example):
    times = np.concatenate([[0.0, example.period], example.period / np.array([2, 3, 4, 5, 6])])
    motion = along(example, times)
    start, end, *parts = motion.samples
    # The period has 16 digits: its own error moves the state by some ulp, which the claim contains.
    assert np.abs(end - start).max() <= 2 * motion.error
    assert min(np.abs(part - start).max() for part in parts) > 0.1


@pytest.mark.parametrize("example", [STEKLOV, STEKLOV_LARGEST_A], ids=names)
def test_steklov_moves_by_elliptic_functions(example):
    """p' = β q r: p = P sn(μ t + u0 | m), q² = Q0 (1 - p²/P²), r² = R0 (1 - m p²/P²), any sign of m."""
    B, C = float(example.body.B), float(example.body.C)
    D, beta = 2 * B * C - 2 * B - 2 * C + 1, B - C
    Q0, R0 = 2 * example.energy * (2 * C - 1) / (beta * D), -2 * example.energy * (2 * B - 1) / (beta * D)
    P_squared = -Q0 * beta * (2 * B - 1) / (C - 1)
    m = P_squared / R0 * (B - 1) / (beta * (2 * C - 1))
    mu = beta * np.sqrt(Q0 * R0 / P_squared)
    period = 4 * ellipk(m) / mu
    motion = along(example, np.linspace(0.0, period, 81))
    p0, q0, r0 = motion.samples[0, :3]
    P = np.sqrt(P_squared)
    # p' and cn(u0) have the signs of β q r and of q: both are positive here, or the phase is the other one.
    u0 = float(mpmath.ellipf(mpmath.asin(p0 / P), m))
    assert beta * q0 * r0 > 0
    assert q0 > 0
    sn, cn = (
        np.array([float(mpmath.re(mpmath.ellipfun(name, mu * t + u0, m=m))) for t in motion.times])
        for name in ("sn", "cn")
    )
    # Rounded arguments of up to 10.
    assert np.abs(motion.samples[:, 0] - P * sn).max() <= motion.error + 1e-13
    assert np.abs(motion.samples[:, 1] - np.sqrt(Q0) * cn).max() <= motion.error + 1e-13
    assert np.abs(motion.samples[-1] - motion.samples[0]).max() <= 2 * motion.error
    if example.period is not None:
        assert period == pytest.approx(example.period, rel=1e-15)


@pytest.mark.parametrize("integrator", ["taylor", HEYOKA, "dop853"])
def test_grioli_precesses_regularly_about_an_oblique_axis(integrator):
    """The explicit solution, in elementary functions, over five periods and to both sides."""
    motion = along(GRIOLI, np.linspace(-20.0, 20.0, 101), integrator=integrator)
    # The closed form is rounded a dozen times.
    assert np.abs(motion.samples - grioli_state(motion.times)).max() <= motion.error + 1e-14


def test_staude_stays_where_it_is_in_the_body():
    motion = along(STAUDE, np.linspace(0.0, 50.0, 51))
    assert np.abs(motion.samples - motion.samples[0]).max() <= motion.error


@pytest.mark.parametrize("offset", [1e-9, 1e-3, 0.5])
def test_departures_from_hess_grow_by_an_exact_law(offset):
    """f = A a p + C c r obeys f' = μ q f, μ = c (A - B)/(A a), whatever its size: f = f0 exp(μ ∫ q dt)."""
    omega = (HESS.omega[0], HESS.omega[1], HESS.omega[2] + type(HESS.omega[2])(str(offset)))
    times = np.linspace(0.0, 10.0, 2001)
    motion = integrate_state(HESS.body, HESS.potential, omega, HESS.gamma, times, tolerance=1e-10)
    f = motion.samples[:, :3] @ [3.0, 0.0, 1.5]
    q = motion.samples[:, 1]
    h = times[1] - times[0]
    # The trapezoidal rule with end corrections, for q' = ((C - A) p r + a g3 - c g1)/B is known as well.
    p, _, r, g1, _, g3 = motion.samples.T
    rate = (-1.5 * p * r + g3 - g1) / 2.0
    steps = h * (q[1:] + q[:-1]) / 2 + h**2 * (rate[:-1] - rate[1:]) / 12
    growth = np.exp(np.concatenate([[0.0], np.cumsum(steps)]) / 3.0)
    # The rule's error is T h⁴ q''''/720, h = 1/200: below 1e-11 for derivatives of order one.
    assert np.abs(f - f[0] * growth).max() <= 5 * motion.error + 1e-11 * np.abs(f).max()
    assert np.abs(growth).max() > 2.0


@pytest.mark.one_in(3)
@pytest.mark.parametrize("example", PERIODIC, ids=names)
def test_claims_tell_unstable_motions_from_stable_ones(example):
    """After many periods each motion still returns within its claim; unstable ones pay for it."""
    if example not in UNSTABLE:
        motion = along(example, [0.0, 8 * example.period], tolerance=1e-11)
    else:
        periods = 2 if example is KONOSEVICH_2 else 8
        # Multipliers of 5 to 1000 a period make more than 1e-9 of one ulp in the state, on any machine.
        with pytest.raises(AccuracyNotMetError):
            along(example, [0.0, periods * example.period], tolerance=1e-11)
        motion = along(example, [0.0, periods * example.period], tolerance=1e-5)
    assert np.abs(motion.samples[1] - motion.samples[0]).max() <= 2 * motion.error
