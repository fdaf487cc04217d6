"""Laws of any motion: closed forms, integrals, reversal, scaling."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.special import ellipj

from service.dynamics.body import RigidBody
from service.dynamics.equations.euler_poisson import areas_integral, energy_integral, geometric_integral
from service.dynamics.potentials.families.coefficients import gravity_potential
from service.dynamics.potentials.families.written import expression_potential
from tests.support.heyoka_integrator import HEYOKA
from tests.workers.solvers.integration.cases import BODY, NAMES, golden_states
from workers.solvers.integration.interface import joined
from workers.solvers.integration.solve import choose_integrator, integrate_state

ZERO, ONE = Fraction(0), Fraction(1)
NO_FIELD = gravity_potential(ZERO, ZERO, ZERO)
OMEGA, GAMMA = (
    (Fraction(1, 2), Fraction(3, 10), Fraction(-4, 5)),
    (Fraction(6, 7), Fraction(2, 7), Fraction(-3, 7)),
)
FIELD = expression_potential("-g1 + g2*g3/2 + exp(g2)*cos(g3) + 1/(3 + g1^3)", {}, BODY)


def of(state):
    return tuple(state[:3].tolist()), tuple(state[3:].tolist())


@pytest.mark.parametrize(("name", "tolerance"), [("taylor", 1e-12), (HEYOKA, 1e-12), ("dop853", 1e-9)])
@pytest.mark.parametrize("case", ["G1", "G4", "G6"])
def test_states_are_the_golden_ones(case, name, tolerance):
    """The closed forms in elliptic functions at t = 1 and 10, one and a half to three periods."""
    text = {"G1": "-g1", "G4": "-g1 + 1/(20*g3^2)", "G6": "-g1 + 1/(50*g3^2) + 6/5*(g1^2 - g2^2)"}[case]
    states = golden_states(case)
    motion = integrate_state(
        BODY,
        expression_potential(text, {}, BODY),
        *of(states[0]),
        np.array([1.0, 10.0]),
        tolerance=tolerance,
        integrator=name,
    )
    actual = np.abs(motion.samples - [states[1], states[10]]).max()
    # The claim stays below what was asked; rounding of the start grows by a factor of some ten at most.
    assert actual <= motion.error <= tolerance


@pytest.mark.parametrize("name", NAMES)
def test_free_body_turns_by_elliptic_functions(name):
    """Euler's motion, A > B > C and 2hB > L²: p ~ dn, q ~ sn, r ~ cn, any phase; V = 0."""
    A, B, C = 2.0, 1.5, 1.0
    p0, r0, phase = 1.0, 0.25, 0.7
    rate = p0 * np.sqrt((A - B) * (A - C) / (B * C))
    q0 = r0 * np.sqrt(C * (A - C) / (B * (A - B)))
    m = (r0 / p0) ** 2 * C * (B - C) / (A * (A - B))

    def omega(t):
        sn, cn, dn, _ = ellipj(rate * t + phase, m)
        # C r' = (A - B) p q: r falls from its largest value, so q has the sign of -sn.
        return np.stack([p0 * dn, -q0 * sn, r0 * cn], axis=-1)

    times = np.linspace(-20.0, 20.0, 81)
    start = omega(np.zeros(1))[0]
    motion = integrate_state(BODY, NO_FIELD, start.tolist(), GAMMA, times, tolerance=1e-11, integrator=name)
    # ellipj itself is good to some 1e-15 times its argument; the start is rounded once.
    assert np.abs(motion.samples[:, :3] - omega(times)).max() <= motion.error + 1e-13


@pytest.mark.parametrize("name", NAMES)
def test_lagrange_top_precesses_steadily(name):
    """B = C = 1, V = a g1, ω = (p, Ω g2, Ω g3): the q-equation gives A Ω p - Ω² g1 = a; γ turns about e1."""
    body = RigidBody(Fraction(2), ONE, ONE)
    a, omega_p, g1 = 0.75, 0.5, 0.6
    p = (a + omega_p**2 * g1) / (2.0 * omega_p)
    start = (p, 0.0, omega_p * 0.8), (g1, 0.0, 0.8)
    times = np.linspace(0.0, 50.0, 101)
    motion = integrate_state(
        body, gravity_potential(Fraction(3, 4), ZERO, ZERO), *start, times, tolerance=1e-10, integrator=name
    )
    p_t, q_t, r_t, g1_t, g2_t, g3_t = motion.samples.T
    # Tolerance: rates and claims; the steady motion is stable, so errors of the start stay.
    assert np.abs(p_t - p).max() <= motion.error + 1e-14
    assert np.abs(g1_t - g1).max() <= motion.error + 1e-14
    # In the body γ turns about e1 at the rate Ω g1 - p.
    turn = (omega_p * g1 - p) * times
    assert np.abs(g3_t - 0.8 * np.cos(turn)).max() <= motion.error + 1e-13
    assert np.abs(np.abs(g2_t) - np.abs(0.8 * np.sin(turn))).max() <= motion.error + 1e-13
    assert np.abs(q_t - omega_p * g2_t).max() <= 2 * motion.error + 1e-13
    assert np.abs(r_t - omega_p * g3_t).max() <= 2 * motion.error + 1e-13


@pytest.mark.parametrize("name", NAMES)
def test_body_turning_about_one_axis_is_a_pendulum(name):
    """V = -g1 and q alone: the mathematical pendulum, sin(θ/2) = k sn(t/√B + K) from rest."""
    # γ = (cos θ, 0, sin θ): θ' = q and B θ'' = -sin θ.
    B, swing = 1.5, 2.0
    start = (0.0, 0.0, 0.0), (np.cos(swing), 0.0, np.sin(swing))
    times = np.linspace(0.0, 30.0, 61)
    motion = integrate_state(
        BODY, gravity_potential(-ONE, ZERO, ZERO), *start, times, tolerance=1e-10, integrator=name
    )
    m = np.sin(swing / 2) ** 2
    _, cn, dn, _ = ellipj(times / np.sqrt(B), m)
    cosine = 1.0 - 2.0 * m * (cn / dn) ** 2  # sn(u + K) = cn/dn
    assert np.abs(motion.samples[:, 3] - cosine).max() <= motion.error + 1e-13
    # The other five follow the plane of the pendulum exactly: their rates are products with zeros.
    assert np.all(motion.samples[:, [0, 2, 4]] == 0.0)


@pytest.mark.parametrize("name", NAMES)
def test_drift_of_the_integrals_falls_with_the_tolerance(name):
    times = np.linspace(0.0, 20.0, 41)
    drifts = []
    integrator = choose_integrator(BODY, FIELD, name)
    state = np.array([float(x) for x in (*OMEGA, *GAMMA)])
    for local_tolerance in (1e-6, 1e-9, 1e-12):
        run = integrator.run(state, 20.0, local_tolerance=local_tolerance, max_steps=10_000)
        assert run.ending is None
        samples = joined(None, run)(times)
        omega, gamma = samples[:, :3], samples[:, 3:]
        integrals = (
            energy_integral(BODY, FIELD, omega, gamma),
            geometric_integral(gamma),
            areas_integral(BODY, omega, gamma),
        )
        drifts.append([np.abs(values - values[0]).max() for values in integrals])
    loose, middle, tight = np.array(drifts)
    # A thousand times tighter steps leave at most a tenth of the drift (methods of order 8 and more:
    # about a thousandth), and what is left is within two orders of the local tolerance.
    assert np.all(middle <= 0.1 * loose)
    assert np.all(tight <= 0.1 * middle + 1e-14)
    assert np.all(tight <= 1e-10)


@pytest.mark.parametrize("name", NAMES)
def test_motion_backwards_is_the_motion_of_the_reversed_state(name):
    """(ω, γ)(-t) from (ω, γ) is (-ω, γ)(t) from (-ω, γ); one solution reaches to both sides of 0."""
    times = np.linspace(-8.0, 12.0, 41)
    there = integrate_state(BODY, FIELD, OMEGA, GAMMA, times, tolerance=1e-10, integrator=name)
    turned = tuple(-x for x in OMEGA)
    back = integrate_state(BODY, FIELD, turned, GAMMA, -times, tolerance=1e-10, integrator=name)
    mirrored = back.samples * [-1, -1, -1, 1, 1, 1]
    assert np.abs(there.samples - mirrored).max() <= there.error + back.error
    assert there.dense.breaks[0] == -8.0
    assert there.dense.breaks[-1] == 12.0
    assert np.all(np.diff(there.dense.breaks) > 0.0)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("k", [1e-12, 1e12])
def test_stronger_field_is_the_same_motion_faster(name, k):
    """V → k² V, ω → k ω, t → t/k: no time or size is built into the integrators."""
    exact = Fraction(k)
    fields = [gravity_potential(-factor, ZERO, factor / 3) for factor in (ONE, exact**2)]
    times = np.array([1.0, 5.0])
    plain = integrate_state(BODY, fields[0], OMEGA, GAMMA, times, tolerance=1e-9, integrator=name)
    omega = tuple(exact * x for x in OMEGA)
    scaled = integrate_state(
        BODY, fields[1], omega, GAMMA, times / k, tolerance=1e-9 * max(1.0, k), integrator=name
    )
    difference = np.abs(scaled.samples / [k, k, k, 1, 1, 1] - plain.samples).max(axis=0)
    # A slow motion is asked for to 1e-9: γ has it, ω = O(1e-12) is below it. A fast one is asked for to 1e3
    # in ω = O(1e12); local tolerances stay below 1e-6, and ten to a hundred of them add up in γ.
    assert difference[3:].max() <= (1e-4 if k > 1 else plain.error + scaled.error)
    assert difference[:3].max() <= (1e-4 if k > 1 else 1.0)


@pytest.mark.parametrize("name", NAMES)
def test_equilibrium_stays(name):
    motion = integrate_state(
        BODY,
        gravity_potential(-ONE, ZERO, ZERO),
        (ZERO,) * 3,
        (ONE, ZERO, ZERO),
        np.array([0.0, 100.0]),
        tolerance=1e-12,
        integrator=name,
    )
    # Not even a rounding in the equations; one in the conversion to Chebyshev series.
    assert np.abs(motion.samples - [0, 0, 0, 1, 0, 0]).max() <= 1e-15


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("times", [[0.0], [0.0, 0.0], [-3.0], [2.0, 1.0, 1.0]])
def test_any_list_of_times_is_served_in_its_order(name, times):
    asked = np.array(times)
    motion = integrate_state(BODY, FIELD, OMEGA, GAMMA, asked, tolerance=1e-9, integrator=name)
    assert motion.samples.shape == (len(times), 6)
    start = [float(x) for x in (*OMEGA, *GAMMA)]
    # One rounding of the sum of a Chebyshev series at its end.
    assert np.abs(motion.dense(np.zeros(1))[0] - start).max() <= 1e-15
    assert motion.dense.error == motion.error
