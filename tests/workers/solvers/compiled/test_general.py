"""Kernels for motions from any state: series of known functions, rates, values, and how runs end."""

from math import factorial, inf

import numpy as np
import pytest

from service.dynamics.equations.euler_poisson import euler_poisson_rhs
from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.motion import COLUMNS
from service.dynamics.potentials.families.expression import expression_potential
from service.dynamics.solution.dense_output import DenseOutput
from tests.workers.solvers.integration.cases import BODY
from workers.solvers.compiled.general.held import hold
from workers.solvers.compiled.general.rates import WIDTH, new_values, rates_at
from workers.solvers.compiled.general.records import Asked
from workers.solvers.compiled.general.sampling import values_at
from workers.solvers.compiled.general.series import ORDER, STATE, take_series
from workers.solvers.compiled.general.steps import ARRIVED, FAILED, TIRED, take_steps
from workers.solvers.compiled.general.twin import HELD, INACCURATE, OPEN, solve_twin
from workers.solvers.integration.compiled import asked_of_twin, integrator_of
from workers.solvers.integration.programs import gradient_program
from workers.solvers.integration.twin import Span

FORMULA = "exp(g2)*sin(g1) + log(2 + g3) + (2 + g2)^(1/3) - 1/(3 + g1^2) + tan(g3/2)"
START = np.array([0.3, 0.1, -0.2, 0.6, 0.0, 0.8])


def steps(text, end, *, max_steps=1000, start=START):
    integrator = integrator_of(BODY, expression_potential(text, {}, BODY))
    gradient = integrator.gradient
    return take_steps(
        *gradient[:3],
        integrator.moments,
        gradient.registers,
        start,
        end,
        1e-13,
        max_steps,
        inf,
        1e-13,
    )


def test_series_of_a_steady_turn_is_that_of_sine_and_cosine():
    """Without a field about the third axis: g1 = cos rt, g2 = −sin rt with r = 2."""
    integrator = integrator_of(BODY, expression_potential("0*g1", {}, BODY))
    gradient = integrator.gradient
    u = np.zeros((gradient.registers, ORDER + 1))
    u[STATE : STATE + len(gradient.constants), 0] = gradient.constants
    u[:STATE, 0] = [0.0, 0.0, 2.0, 1.0, 0.0, 0.0]
    take_series(gradient.code, gradient.gradient, integrator.moments, u)
    cosine = [(-1.0) ** (k // 2) * 2.0**k / factorial(k) * (k % 2 == 0) for k in range(ORDER + 1)]
    sine = [(-1.0) ** (k // 2) * 2.0**k / factorial(k) * (k % 2 == 1) for k in range(ORDER + 1)]
    # Every order adds two roundings, relatively.
    assert u[3] == pytest.approx(cosine, rel=2.0 * ORDER * 2.0**-53, abs=0.0)
    assert u[4] == pytest.approx(-np.array(sine), rel=2.0 * ORDER * 2.0**-53, abs=0.0)


def test_rates_are_those_of_the_equations():
    field = expression_potential(FORMULA, {}, BODY)
    program, integrator = gradient_program(field, nearest_double), integrator_of(BODY, field)
    states = np.random.default_rng(5).uniform(-0.9, 0.9, (WIDTH, STATE))
    values, rates = new_values(program.registers, program.constants), np.empty((STATE, WIDTH))
    values[:STATE] = states.T
    rates_at(program.code, program.gradient, integrator.moments, values, rates, WIDTH)
    expected = euler_poisson_rhs(BODY, field, states[:, :3], states[:, 3:])
    truth = np.concatenate([expected.omega, expected.gamma], axis=1)
    # Some ten roundings of numbers up to 10.
    assert np.abs(rates.T - truth).max() <= 2e-14


def test_runs_end_at_their_end_by_their_number_of_steps_or_at_a_singularity():
    status, breaks, series = steps(FORMULA, -4.0)
    assert (status, breaks[-1], len(series)) == (ARRIVED, -4.0, len(breaks) - 1)
    values = np.empty((STATE, 3))
    times = np.array([-4.0, -1.3, 0.0])
    values_at(breaks[::-1].copy(), _mirrored(series), times, np.empty(0), values)
    dense = DenseOutput(COLUMNS, breaks[::-1].copy(), _mirrored(series), None, 0.0)
    assert np.array_equal(values.T, dense(times))
    assert steps(FORMULA, 4.0, max_steps=2)[0] == TIRED
    towards = np.array([0.0, 3.0, 0.0, 0.6, 0.0, 0.8])
    assert steps("-1/g3^2", 5.0, start=towards)[0] == FAILED


def _mirrored(series):
    mirrored = series[::-1].copy()
    mirrored[:, 1::2] *= -1.0
    return mirrored


@pytest.mark.parametrize(
    ("tolerance", "last", "status"), [(1e-9, 3.0, HELD), (1e-16, 3.0, INACCURATE), (1e-9, 0.0, OPEN)]
)
def test_a_twin_is_held_too_inaccurate_or_not_decided(tolerance, last, status):
    integrator = integrator_of(BODY, expression_potential(FORMULA, {}, BODY))
    other = integrator.neighbour()
    asked = asked_of_twin(
        integrator, Span(0.0, last), local_tolerance=1e-13, max_steps=1000, tolerance=tolerance
    )
    assert isinstance(asked, Asked)
    found = solve_twin(
        integrator.formula,
        integrator.gradient,
        integrator.moments,
        other.gradient,
        other.moments,
        START,
        START,
        np.linspace(0.0, last, 5),
        asked,
    )
    assert found[0] == status
    assert (status == OPEN) == bool(np.isnan(found[3]).all())


def test_a_run_of_another_field_is_not_held():
    """Of two fields that differ by 1e-6, the motion of one breaks the equations of the other."""
    status, breaks, series = steps("-g1", 3.0)
    assert status == ARRIVED
    for text, is_kept in (("-g1", True), ("-1000001/1000000*g1", False)):
        integrator = integrator_of(BODY, expression_potential(text, {}, BODY))
        model = integrator.formula, integrator.gradient, integrator.moments
        assert hold(*model, breaks, series, 1e-9, 1e-9, False, 0.0, np.zeros(3), 0.0)[0] == is_kept
