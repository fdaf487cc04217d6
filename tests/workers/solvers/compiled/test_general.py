"""Kernels for motions from any state: series of known functions, rates, values, and how runs end."""

from fractions import Fraction
from math import factorial

import numpy as np
import pytest

from service.dynamics.body import RigidBody
from service.dynamics.equations.euler_poisson import energy_integral, euler_poisson_rhs
from service.dynamics.motion import COLUMNS
from service.dynamics.potentials.families.written import expression_potential
from service.dynamics.solution.dense_output import DenseOutput
from tests.workers.solvers.integration.cases import BODY
from workers.solvers.compiled.evaluation.interpreter import new_registers
from workers.solvers.compiled.evaluation.program import numbers_of
from workers.solvers.compiled.general.run_pair import COLLIDED, INACCURATE, OPEN, VERIFIED, solve_pair
from workers.solvers.compiled.general.sampling import new_values_at
from workers.solvers.compiled.general.steps import ARRIVED, COUNT, FAILED, ORDER, STATE, TIRED, take_series
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.lanes import LANES, first_row, new_rows, number_at, place_of, put_number
from workers.solvers.compiled.records import Asked
from workers.solvers.compiled.residual.nodes import (
    HALVES,
    PLACES,
    WIDTH,
    evaluate,
    put_gains,
    put_series,
    put_whole_states,
)
from workers.solvers.compiled.residual.residual import hold
from workers.solvers.integration.compiled import integrator_of, models_of, pair_request, verified_runs
from workers.solvers.integration.interface import neighbour_of
from workers.solvers.integration.run_pair import Span

FORMULA = "exp(g2)*sin(g1) + log(2 + g3) + (2 + g2)^(1/3) - 1/(3 + g1^2) + tan(g3/2)"
START = np.array([0.3, 0.1, -0.2, 0.6, 0.0, 0.8])


def steps(text, end, *, max_steps=1000, start=START):
    integrator = integrator_of(BODY, expression_potential(text, {}, BODY))
    return integrator.steps(start, end, local_tolerance=1e-13, max_steps=max_steps)


@kernel
def series_of(code, gradient, constants, moments, registers, states):
    """Return all orders of all registers, shape (registers, ORDER + 1, LANES)."""
    room = new_rows(registers * COUNT + 14)
    u = first_row(room)
    bodies = u + 8 * LANES * registers * COUNT
    for lane in range(LANES):
        for a in range(STATE):
            put_number(u, a * COUNT, lane, states[lane, a])
            put_number(bodies, a, lane, moments[a])
        for n in range(len(constants)):
            put_number(u, (STATE + n) * COUNT, lane, constants[n])
    take_series(code, gradient, bodies, u, bodies + 8 * LANES * STATE)
    found = np.empty((registers, COUNT, LANES))
    for n in range(registers):
        for k in range(COUNT):
            for lane in range(LANES):
                found[n, k, lane] = number_at(u, n * COUNT + k, lane)
    room[0, 0] = 0.0  # up to here it has an owner
    return found


def test_series_of_a_steady_turn_is_that_of_sine_and_cosine():
    """Without a field about the third axis: g1 = cos rt, g2 = −sin rt; every lane has its own r."""
    integrator = integrator_of(BODY, expression_potential("0*g1", {}, BODY))
    gradient = integrator.gradient
    rates = 2.0 - 0.25 * np.arange(LANES)
    states = np.array([[0.0, 0.0, r, 1.0, 0.0, 0.0] for r in rates])
    u = series_of(*gradient_parts(gradient), integrator.moments, gradient.registers, states)
    for lane, r in enumerate(rates):
        cosine = [(-1.0) ** (k // 2) * r**k / factorial(k) * (k % 2 == 0) for k in range(ORDER + 1)]
        sine = [(-1.0) ** (k // 2) * r**k / factorial(k) * (k % 2 == 1) for k in range(ORDER + 1)]
        # Every order adds two roundings, relatively.
        assert u[3, :, lane] == pytest.approx(cosine, rel=2.0 * ORDER * 2.0**-53, abs=0.0)
        assert u[4, :, lane] == pytest.approx(-np.array(sine), rel=2.0 * ORDER * 2.0**-53, abs=0.0)


def gradient_parts(gradient):
    return gradient.code, gradient.gradient, gradient.constants


@kernel
def there_and_back(series, level, time):
    """Return values at the nodes, their series, and that of their integral times ``time``."""
    values, rooms = new_rows(40), new_rows(8 * PLACES + 2)
    at, even = first_row(values), first_row(rooms)
    odd, integral = even + 64 * PLACES, even + 2 * 64 * PLACES
    room, few = even + 4 * 64 * PLACES, even + 8 * 64 * PLACES
    put_whole_states(place_of(series), len(series), level, at, room)
    put_series(at, level, room, even, odd)
    put_gains(even, odd, level, time, integral, few)
    count = 2 * HALVES[level] + 1
    found = np.empty((3, count + 1, LANES))
    for k in range(count):
        for a in range(LANES):
            found[0, k, a] = number_at(at, k, a)
            found[1, k, a] = number_at(even if k % 2 == 0 else odd, k // 2, a)
    for k in range(count + 1):
        for a in range(LANES):
            found[2, k, a] = number_at(integral, k, a)
    values[0, 0], rooms[0, 0] = 0.0, 0.0  # up to here they have owners
    return found


@pytest.mark.parametrize("level", range(len(HALVES)))
def test_values_at_the_nodes_have_the_series_and_the_integral_of_the_piece(level):
    degree, count = 13, 2 * HALVES[level] + 1
    series = np.random.default_rng(level).normal(size=(degree + 1, LANES))
    values, again, integral = there_and_back(series, level, 0.25)
    nodes = np.cos(np.pi * np.arange(count) / (count - 1))
    expected = np.polynomial.chebyshev.chebval(nodes, series).T
    # Some twenty terms of the size 1, rounded; what is beyond the degree is 0 to as much.
    assert np.abs(values[:count] - expected).max() <= 1e-13
    assert np.abs(again[:count] - np.pad(series, ((0, count - degree - 1), (0, 0)))).max() <= 1e-13
    exact = 0.25 * np.polynomial.chebyshev.chebint(series, lbnd=-1)
    assert np.abs(integral - np.pad(exact, ((0, count - degree - 1), (0, 0)))).max() <= 1e-13


@pytest.mark.parametrize("text", [FORMULA, "-g1 + g2^3*g3^(-2)/20 + 2^g2 - (2 + g1)^(1/2)"])
def test_rates_and_integrals_are_those_of_the_equations(text):
    field = expression_potential(text, {}, BODY)
    equations = integrator_of(BODY, field).equations
    states = np.random.default_rng(6).uniform(0.1, 0.9, (WIDTH, STATE))
    rates, found = np.empty((STATE, WIDTH)), np.empty((3, WIDTH))
    registers = new_registers(equations.gradient.code, 1, WIDTH)
    evaluate(equations, registers, np.ascontiguousarray(states.T), rates, found, WIDTH)
    expected = euler_poisson_rhs(BODY, field, states[:, :3], states[:, 3:])
    truth = np.concatenate([expected.omega, expected.gamma], axis=1)
    energy = energy_integral(BODY, field, states[:, :3], states[:, 3:])
    areas = (equations.moments[:3] * states[:, :3] * states[:, 3:]).sum(axis=1)
    # Some ten roundings of numbers up to 10.
    assert np.abs(rates.T - truth).max() <= 2e-14 * max(1.0, np.abs(truth).max() / 10.0)
    assert np.abs(found - [energy, areas, (states[:, 3:] ** 2).sum(axis=1)]).max() <= 2e-14


def test_the_neighbouring_problem_has_its_own_constants():
    """Its run is held against its own equations: a number that a double is not moves, 3 stays."""
    field = expression_potential("7*g1/10 + g3^3", {}, BODY)
    integrator = integrator_of(BODY, field)
    numbers = numbers_of(field.tape)
    assert integrator.equations.constants.tolist() == [float(number) for number in numbers]
    assert integrator.neighbour().equations.constants.tolist() == [neighbour_of(number) for number in numbers]


def test_runs_end_at_their_end_by_their_number_of_steps_or_at_a_singularity():
    status, breaks, series = steps(FORMULA, -4.0)
    assert (status, breaks[-1], len(series)) == (ARRIVED, -4.0, len(breaks) - 1)
    times = np.array([-4.0, -1.3, 0.0])
    beside = np.pad(_mirrored(series), ((0, 0), (0, 0), (0, LANES - STATE)))
    values = new_values_at(breaks[::-1].copy(), beside, beside.shape[1], times, np.empty(0))
    dense = DenseOutput(COLUMNS, breaks[::-1].copy(), _mirrored(series), None, 0.0)
    assert np.array_equal(values[: len(times), :STATE], dense(times))
    assert steps(FORMULA, 4.0, max_steps=2)[0] == TIRED
    towards = np.array([0.0, 3.0, 0.0, 0.6, 0.0, 0.8])
    assert steps("-1/g3^2", 5.0, start=towards)[0] == FAILED


def _mirrored(series):
    mirrored = series[::-1].copy()
    mirrored[:, 1::2] *= -1.0
    return mirrored


@pytest.mark.parametrize(
    ("tolerance", "last", "status"), [(1e-9, 3.0, VERIFIED), (1e-16, 3.0, INACCURATE), (1e-9, 0.0, OPEN)]
)
def test_a_pair_of_runs_is_verified_too_inaccurate_or_not_decided(tolerance, last, status):
    integrator = integrator_of(BODY, expression_potential(FORMULA, {}, BODY))
    asked = pair_request(
        integrator, Span(0.0, last), local_tolerance=1e-13, max_steps=1000, tolerance=tolerance
    )
    assert isinstance(asked, Asked)
    found = solve_pair(integrator.models, START, START, np.linspace(0.0, last, 5), asked)
    assert found[0] == status
    assert (status == OPEN) == bool(np.isnan(found[3]).all())


@pytest.mark.parametrize("span", [Span(0.0, 3.0), Span(-2.0, 0.0), Span(-2.0, 3.0)])
def test_motions_side_by_side_have_the_bits_they_have_alone(span):
    """More motions than lanes, of three bodies; one of them begins in a pole, which the others do not see."""
    field = expression_potential("-g1 + 1/(20*g3^2)", {}, BODY)
    bodies = [RigidBody(Fraction(2), Fraction(n, 7), Fraction(1)) for n in (10, 11, 12)]
    integrators = [integrator_of(body, field) for body in bodies]
    which = np.arange(11) % 3
    states = np.tile(START, (11, 1))
    states[:, 0] = np.linspace(-0.5, 0.5, 11)
    states[4] = [0.0, 0.0, 0.0, 0.6, 0.8, 0.0]  # g3 = 0 is the pole
    others = np.nextafter(states, 1.0)
    times = np.linspace(span.first, span.last, 10)
    asked = pair_request(integrators[0], span, local_tolerance=1e-13, max_steps=1000, tolerance=1e-9)
    found = verified_runs(models_of(integrators), which, states, others, times, asked, times, None)
    assert [ending == VERIFIED for ending in found.endings] == [n != 4 for n in range(11)]
    for n in np.flatnonzero(found.endings == VERIFIED):
        models = models_of([integrators[which[n]]])
        status, breaks, series, numbers = solve_pair(models, states[n], others[n], times, asked)
        assert status == VERIFIED
        assert np.array_equal(numbers, found.numbers[n])
        assert np.array_equal(DenseOutput(COLUMNS, breaks, series, None, 0.0)(times), found.samples[n])


@pytest.mark.parametrize(("span", "side"), [(Span(0.0, 5.0), 1.0), (Span(-5.0, 0.0), -1.0)])
def test_a_motion_that_is_held_up_to_a_singularity_collides(span, side):
    """A fall onto the equator along a meridian g1 = cos u, g3 = sin u: u'² / 2 = 1/sin² u + E with B = 1."""
    body = RigidBody(Fraction(1), Fraction(1), Fraction(1))
    integrator = integrator_of(body, expression_potential("-1/g3^2", {}, body))
    start = np.array([0.0, 0.0, 0.0, 0.6, 0.0, 0.8])
    asked = pair_request(integrator, span, local_tolerance=1e-13, max_steps=1000, tolerance=1e-9)
    times = np.array([span.first, span.last])
    status, _, _, numbers = solve_pair(integrator.models, start, start, times, asked)
    assert status == COLLIDED
    # From rest at sin u = 4/5, E = −25/16. With c = cos u the time is ∫ dc / sqrt(2 (25 c² − 9) / 16), from
    # c = 3/5 to 1: that is (4/5) arcosh(5/3) / sqrt(2).
    time = 0.8 * np.arccosh(5.0 / 3.0) / np.sqrt(2.0)
    # Steps collapse at 1e-13 of the longest one.
    assert numbers[0] == pytest.approx(side * time, abs=1e-12)
    assert numbers[2] > 1e6 * numbers[1]


def test_an_error_that_finer_runs_follow_is_not_held_against_the_equations():
    integrator = integrator_of(BODY, expression_potential(FORMULA, {}, BODY))
    asked = pair_request(
        integrator, Span(0.0, 3.0), local_tolerance=1e-13, max_steps=1000, tolerance=1e-16, is_last=False
    )
    status, _, _, numbers = solve_pair(integrator.models, START, START, np.linspace(0.0, 3.0, 5), asked)
    assert status == INACCURATE
    assert np.isnan(numbers).all()


def test_a_run_of_another_field_is_not_held():
    """The motion in one of two fields that differ by 1e-6 breaks the equations of the other."""
    status, breaks, series = steps("-g1", 3.0)
    assert status == ARRIVED
    beside = np.pad(series, ((0, 0), (0, 0), (0, LANES - STATE)))
    bounds = beside.shape[1], 1e-9, 1e-9, False, 0.0, np.zeros(3), 0.0
    for text, is_kept in (("-g1", True), ("-1000001/1000000*g1", False)):
        integrator = integrator_of(BODY, expression_potential(text, {}, BODY))
        assert hold(integrator.equations, breaks, beside, *bounds, 0.0)[0] == is_kept
