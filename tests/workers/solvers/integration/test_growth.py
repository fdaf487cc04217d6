"""How far errors grow: by closed forms, by orders, by runs that begin apart; and claims that know it."""

import time
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

from service.dynamics.body import RigidBody
from service.dynamics.defect.equations import Equations
from service.dynamics.potentials.families.written import expression_potential
from service.schemas.sweep.reading import read_sweep
from tests.support import doubled_series
from tests.workers.solvers.integration.cases import BODY
from workers.solvers.compiled.general.growth import grown
from workers.solvers.compiled.general.steps import STATE
from workers.solvers.compiled.lanes import LANES
from workers.solvers.errors import AccuracyNotMetError
from workers.solvers.integration import solve
from workers.solvers.integration.compiled import integrator_of
from workers.solvers.integration.dop853 import Dop853Integrator
from workers.solvers.integration.run_pair import UNIT_ROUNDOFF, errors_on_the_way, passed_on
from workers.solvers.integration.solve import GROWTH, integrate_state
from workers.sweeping.chunk import ChunkSolver
from workers.sweeping.plan import make_plan

FREE = RigidBody(Fraction(3), Fraction(2), Fraction(3, 2))
NEAR_THE_MIDDLE = (Fraction(2, 10**9), Fraction(5), Fraction(3, 10**9))
ASIDE = (Fraction(3, 5), Fraction(0), Fraction(4, 5))
P_AT_31, R_AT_31 = 9.457515547478334608278e-7, -1.891501259114510060422e-6
"""Numbers of the free body from these at t = 31; by Taylor series with 300 bits."""


def nodes_of(J, breaks):
    """J at the three nodes of Gauss of each part."""
    half, middle = 0.5 * np.diff(breaks), 0.5 * (breaks[1:] + breaks[:-1])
    times = middle[:, None] + half[:, None] * np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0])
    return np.array([[J(t) for t in row] for row in times])


def passed(J, start, breaks):
    """Return P at the last of the times, without errors on the way."""
    P = start.copy()
    nothing = np.zeros((len(breaks) - 1, STATE))
    passed_on(nodes_of(J, breaks), np.diff(breaks), nothing, nothing, P, np.zeros(STATE))
    return P


def test_a_constant_derivative_is_passed_by_its_exponential():
    draws = np.random.default_rng(3)
    J, W = draws.normal(size=(2, STATE, STATE))
    P = passed(lambda _: J, W @ W.T, np.linspace(0.0, 1.0, 13))
    Phi = expm(J)
    exact = Phi @ W @ W.T @ Phi.T
    # The series of the exponential leaves out 0.5^10/10! of each of twelve parts.
    assert np.abs(P - exact).max() <= 1e-8 * np.abs(exact).max()


def test_transitions_have_the_order_six():
    """Φ of J(t) = S + t T with matrices that do not commute, against parts that are 16 times shorter."""
    S, T, W = np.random.default_rng(4).normal(size=(3, STATE, STATE))

    def error(parts):
        exact = passed(lambda t: S + t * T, W @ W.T, np.linspace(0.0, 0.5, 257))
        return np.abs(passed(lambda t: S + t * T, W @ W.T, np.linspace(0.0, 0.5, parts + 1)) - exact).max()

    errors = [error(parts) for parts in (4, 8, 16)]
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx([6.0, 6.0], abs=0.5)


def test_errors_of_the_parts_add_as_squares():
    """Without growth n errors of the size σ are one of the size σ √n."""
    nothing = np.zeros((9, 6))
    found, _ = passed_on(
        np.zeros((9, 3, 6, 6)), np.ones(9), np.full((9, 6), 2.0), nothing, np.zeros((6, 6)), np.zeros(6)
    )
    assert found == pytest.approx(np.outer(2.0 * np.sqrt(np.arange(1.0, 10.0)), np.ones(6)), rel=1e-14)


def test_what_is_not_known_lets_nothing_grow():
    nodes = np.full((1, 3, 6, 6), np.nan)
    error = np.full(6, 3.0)
    found, errors = passed_on(nodes, np.ones(1), np.full((1, 6), 2.0), np.ones((1, 6)), np.eye(6), error)
    assert found == pytest.approx(np.full((1, 6), np.sqrt(5.0)))
    assert errors == pytest.approx(np.full((1, 6), 4.0))


@pytest.mark.parametrize("axis", range(STATE))
@pytest.mark.parametrize(
    ("text", "end"),
    [("0", 6.0), ("-g1 + 1/(20*g3^2)", 5.0), ("exp(g2)*sin(g1) + log(2 + g3) + (2 + g2)^(1/3)", -4.0)],
)
def test_growth_is_that_of_runs_that_begin_apart(text, end, axis):
    integrator = integrator_of(BODY, expression_potential(text, {}, BODY))
    start = np.array([0.1, 1.3, -0.2, 0.6, 0.0, 0.8])
    run = integrator.run(start, end, local_tolerance=1e-16, max_steps=1000)
    apart = np.zeros(STATE)
    apart[axis] = 1e-7
    series = np.pad(run.coefficients, ((0, 0), (0, 0), (0, LANES - STATE)))
    model = integrator.equations, run.breaks, series, series.shape[1]
    found = grown(*model, apart, 0.0, 0.0, float(np.abs(series).max()))
    sides = []
    for sign in (1.0, -1.0):
        side = integrator.run(start + sign * apart, end, local_tolerance=1e-16, max_steps=1000)
        sides.append(side.coefficients[-1].sum(axis=0))
    # Both sides leave out the third order, 1e-14 of the growth; Φ, cut where h‖J‖ is 1.25, 1e-4 at most.
    actual = 0.5 * np.abs(sides[0] - sides[1]).max()
    # Found is the largest in the last step, which may be in its middle.
    assert actual * (1.0 - 1e-4) <= found[-1] <= 1.5 * actual


@pytest.mark.parametrize("axis", range(STATE))
def test_growth_of_the_attitude_is_that_of_runs_that_begin_apart(axis):
    """The small turn φ, against those in twice the digits of two motions that begin apart by 2e-9."""
    text, terms = "-g1 + g2*g3/3", ((Fraction(-1), 1, 0, 0), (Fraction(1, 3), 0, 1, 1))
    integrator = integrator_of(BODY, expression_potential(text, {}, BODY))
    start, end = (
        (Fraction(1, 3), Fraction(1, 2), Fraction(1), Fraction(3, 5), Fraction(0), Fraction(4, 5)),
        5.0,
    )
    run = integrator.run(np.array([float(x) for x in start]), end, local_tolerance=1e-16, max_steps=1000)
    apart = np.zeros(STATE)
    apart[axis] = 1e-9
    equations = Equations.of(BODY, integrator._potential)
    found = errors_on_the_way(equations, run, apart, 0.0, ()).turned_deviations.max(axis=0)
    reference, seen = doubled_series.Motion((BODY.A, BODY.B, BODY.C), terms), []
    times = [Fraction(n, 20) for n in range(1, 101)]
    sides = [
        reference.turned(
            tuple(x + (sign * Fraction(1, 10**9) if n == axis else 0) for n, x in enumerate(start)), times
        )
        for sign in (1, -1)
    ]
    for one, other in zip(*sides, strict=True):
        a, b, c, d = one[6:]
        w, x, y, z = other[6:]
        # 2 q*q' = (2, φ), of twice the distance.
        turn = [a * x - b * w - c * z + d * y, a * y + b * z - c * w - d * x, a * z - b * y + c * x - d * w]
        seen.append([abs(float(each)) for each in turn])
    # Of the second order is 1e-9 of it; Φ, cut where h‖J‖ is 1.25, errs by 1e-4 at most. Times are a
    # twentieth apart, and so may be those of the largest.
    assert found == pytest.approx(np.max(seen, axis=0), rel=0.02, abs=1e-12)


def test_kernels_and_general_code_find_the_same_growth():
    """The growth of roundings alone: series of kernels know what they leave out, other methods do not."""
    field = expression_potential("exp(g2)*sin(g1) + log(2 + g3) + (2 + g2)^(1/3)", {}, BODY)
    integrator = integrator_of(BODY, field)
    run = integrator.run(
        np.array([0.1, 1.3, -0.2, 0.6, 0.0, 0.8]), -4.0, local_tolerance=1e-16, max_steps=1000
    )
    series, apart = np.pad(run.coefficients, ((0, 0), (0, 0), (0, LANES - STATE))), np.full(STATE, 1e-16)
    model = integrator.equations, run.breaks, series, series.shape[1]
    by_kernels = grown(*model, apart, UNIT_ROUNDOFF, 0.0, float(np.abs(series).max()))
    found = errors_on_the_way(Equations.of(BODY, field), run, apart, 0.0).deviations
    # J is a difference of rates, with 1e-11 of rounding.
    assert found == pytest.approx(by_kernels[1:], rel=1e-8)


def test_what_all_runs_leave_out_alike_is_in_the_claim():
    """A small swing about a stable equilibrium: one step of every run goes to the end, all are cut alike."""
    body = RigidBody(Fraction(11, 4), Fraction(15, 8), Fraction(3, 2))
    terms = [(Fraction(-1331, 1000), 0, 1, 0), (Fraction(-8, 5), 2, 0, 0), (Fraction(-169, 100), 0, 2, 0)]
    x, y = Fraction(-2, 10**7), Fraction(-1, 10**7)
    whole = 1 + x * x + y * y
    state = (*[Fraction(1, 10**7)] * 3, 2 * x / whole, (whole - 2) / whole, 2 * y / whole)
    text = " + ".join(f"({c})*g1^{i}*g2^{j}*g3^{k}" for c, i, j, k in terms)
    times = [Fraction(n, 2) for n in range(1, 17)]
    exact = doubled_series.Motion((body.A, body.B, body.C), tuple(terms)).at(state, times)
    truth = np.array([[float(value) for value in row] for row in exact])
    for last in range(4, 17):
        motion = integrate_state(
            body,
            expression_potential(text, {}, body),
            state[:3],
            state[3:],
            np.array([float(t) for t in times[:last]]),
            tolerance=1e-6,
        )
        assert np.abs(motion.samples - truth[:last]).max() <= motion.error


@pytest.mark.parametrize("name", ["taylor", "heyoka", "dop853"])
def test_who_passes_an_unstable_axis_twice_multiplies_what_is_lost_between(name):
    """Roundings of the first departure make the second one come 1e10 times as far off."""
    times = np.array([31.0])
    field = expression_potential("0", {}, FREE)
    with pytest.raises(AccuracyNotMetError) as caught:
        integrate_state(FREE, field, NEAR_THE_MIDDLE, ASIDE, times, tolerance=1e-10, integrator=name)
    assert caught.value.reached >= 1.9e-6
    if name == "dop853":
        return  # its steps lose 300 times as much
    motion = integrate_state(FREE, field, NEAR_THE_MIDDLE, ASIDE, times, tolerance=1e-2, integrator=name)
    assert np.abs(motion.samples[0, [0, 2]] - [P_AT_31, R_AT_31]).max() <= motion.error
    assert motion.evidence[GROWTH] <= motion.error


def test_the_reference_has_the_digits_of_another():
    found = doubled_series.Motion((FREE.A, FREE.B, FREE.C), ()).at((*NEAR_THE_MIDDLE, *ASIDE), [Fraction(31)])
    p, _, r = (float(value) for value in found[0][:3])
    # Both numbers are cut to 22 digits, then to doubles.
    assert (p, r) == pytest.approx((P_AT_31, R_AT_31), rel=1e-15)


def test_the_reference_of_a_small_motion_does_not_depend_on_where_it_is_asked_for():
    """A top that is almost upright, whose series of high order vanish, falls over by 1e-3 until the end."""
    top = doubled_series.Motion(
        (Fraction(17, 8), Fraction(19, 8), Fraction(2)), ((Fraction(-477, 1000), 1, 0, 0),)
    )
    state = (Fraction(-1, 10**10), Fraction(3, 10**11), Fraction(0), Fraction(-1), Fraction(0), Fraction(0))
    (once,) = top.at(state, [Fraction(32)])
    often = top.at(state, [Fraction(n, 4) for n in range(1, 129)])[-1]
    # Steps leave out 2^-100 and round by 2^-104, some 100 of them; that grows by 1e7 = 2^24 until then.
    assert max(abs(one - other) for one, other in zip(once, often, strict=True)) <= Fraction(1, 2**69)


def test_a_sweep_of_states_claims_as_a_job_does():
    """The fastest passes the axis twice, and does not meet the accuracy; the others have their claims."""
    base = {
        "body": {"A": "3", "B": "2", "C": "3/2"},
        "potential": {"type": "expression", "expression": "0"},
        "motion": {"type": "state", "omega": ["2e-9", 5, "3e-9"], "gamma": ["3/5", 0, "4/5"]},
        "time": {"times": [31]},
        "accuracy": {"tier": "standard"},
    }
    axes = [{"pointer": "/motion/omega/1", "values": [1, 2, 5]}]
    sweep = read_sweep({"base": base, "axes": axes, "keep": ["error"]}, max_points=3)
    found = ChunkSolver(make_plan(sweep)).solve(0, 3, time.perf_counter() + 600.0)
    assert list(found.outcomes) == ["solved", "solved", "accuracy_not_met"]
    field = expression_potential("0", {}, FREE)
    for turn, error in zip((1, 2), found.numbers["error"], strict=False):
        omega = (NEAR_THE_MIDDLE[0], Fraction(turn), NEAR_THE_MIDDLE[2])
        assert integrate_state(FREE, field, omega, ASIDE, np.array([31.0]), tolerance=1e-10).error == error


def test_what_is_exactly_0_loses_nothing():
    """A turn about the middle axis itself stays one: no rounding leads away from it."""
    field = expression_potential("0", {}, FREE)
    omega = (Fraction(0), Fraction(5), Fraction(0))
    motion = integrate_state(FREE, field, omega, ASIDE, np.array([31.0]), tolerance=1e-10)
    # γ turns by 155.
    exact = 0.6 * np.cos(155.0) - 0.8 * np.sin(155.0)
    assert abs(motion.samples[0, 3] - exact) <= motion.error <= 1e-11
    assert motion.samples[0, 0] == motion.samples[0, 2] == 0.0


def test_long_runs_that_rest_on_two_obey_the_same(monkeypatch):
    """Without kernels' word there are two runs, as there are of those with very many steps."""
    monkeypatch.setattr(solve.RunRequest, "try_kernels", lambda *_: None)
    with pytest.raises(AccuracyNotMetError) as caught:
        integrate_state(
            FREE,
            expression_potential("0", {}, FREE),
            NEAR_THE_MIDDLE,
            ASIDE,
            np.array([31.0]),
            tolerance=1e-10,
        )
    assert caught.value.reached >= 1.9e-6


@pytest.mark.parametrize(
    ("omega", "terms", "end"),
    [
        # A top that falls from near the upright position, and a body next to its middle axis: both grow.
        (("0", "1/1000", "1/2"), [(Fraction(1), 0, 0, 1)], 9.0),
        (("1/10000", "2", "0"), [(Fraction(1, 10), 1, 0, 0)], -12.0),
    ],
)
def test_the_residual_of_a_run_shows_its_error(omega, terms, end):
    """DOP853 with a tolerance far above rounding, against doubled series: the error itself, no bound."""
    text = " + ".join(f"({c})*g1^{i}*g2^{j}*g3^{k}" for c, i, j, k in terms)
    field = expression_potential(text, {}, BODY)
    state = (*map(Fraction, omega), Fraction(3, 5), Fraction(0), Fraction(4, 5))
    start = np.array([float(x) for x in state])
    run = Dop853Integrator(BODY, field).run(start, end, local_tolerance=1e-9, max_steps=10_000)
    found = errors_on_the_way(Equations.of(BODY, field), run, np.zeros(6), 0.0).by_residual
    moments = BODY.A, BODY.B, BODY.C
    exact = doubled_series.Motion(moments, tuple(terms)).at(state, [Fraction(end)])
    truth = np.array([float(value) for value in exact[0]])
    actual = np.abs(run.coefficients[-1].sum(axis=0) - truth).max()
    # To first order: what it leaves out is the square of 1e-7, and Φ inside a step, 1e-3 of a step's part.
    assert found[-1] == pytest.approx(actual, rel=1e-2)
