"""What kernels say of a motion from any state, beside what the general code says of the same."""

from dataclasses import replace

import numpy as np
import pytest

from service.dynamics.defect.evidence import check_residual
from service.dynamics.motion import COLUMNS, Estimate
from service.dynamics.potentials.families.written import expression_potential
from service.dynamics.solution.dense_output import DenseOutput
from tests.workers.solvers.integration.cases import BODY
from workers.solvers.integration import compiled
from workers.solvers.integration.compiled import VerifiedRun, integrator_of, samples_of
from workers.solvers.integration.interface import Run, neighbour_of
from workers.solvers.integration.solve import GROWTH, integrate_state, run_request_of, tolerances

STATE = (0.3, 0.1, -0.2, 0.6, 0.0, 0.8)
TIMES = np.linspace(-3.0, 5.0, 23)
TEXTS = ["-g1 + 1/(20*g3^2)", "exp(g2)*sin(g1) + log(2 + g3) + (2 + g2)^(1/3)", "g1/10"]


def verified(text, times=TIMES, tolerance=1e-9) -> VerifiedRun:
    field = expression_potential(text, {}, BODY)
    neighbour = np.array([neighbour_of(number) for number in STATE])
    integrator, run_request = integrator_of(BODY, field), run_request_of(times, tolerance)
    for local_tolerance in tolerances(integrator, tolerance):
        found = run_request.try_kernels(integrator, np.array(STATE), neighbour, local_tolerance)
        if isinstance(found, VerifiedRun):
            return found
        # A number is the error that was reached: the next tolerance is finer.
        assert isinstance(found, float)
    raise AssertionError(f"the accuracy {tolerance} is not met")


@pytest.mark.parametrize("text", TEXTS)
def test_defect_drift_and_claim_are_those_of_the_general_code(text):
    found = verified(text)
    dense = DenseOutput(COLUMNS, found.breaks, found.coefficients, None, found.error)
    field = expression_potential(text, {}, BODY)
    energy = Estimate(found.energy, found.energy_error, "estimate")
    shown = check_residual(BODY, field, dense, found.error, energy, is_planar=False)
    assert shown.error == found.error
    assert shown.settled == 1.0
    # Both bound the same D: they differ by what interpolation leaves out, at most a tenth of the claim each,
    # and by the rounding of some hundred sums of numbers up to 2.
    assert abs(shown.defect - found.defect) <= 0.2 * found.error + 1e-13
    # Seen at other nodes, of the same polynomials.
    assert abs(shown.drift - found.drift) <= 0.5 * max(shown.drift, found.drift) + 1e-14


def test_samples_have_the_bits_of_the_function_of_time():
    found = verified(TEXTS[0])
    dense = DenseOutput(COLUMNS, found.breaks, found.coefficients, None, found.error)
    assert np.array_equal(samples_of(found, TIMES, None), dense(TIMES))
    low_parts = np.full(len(TIMES), 1e-17)
    assert np.array_equal(samples_of(found, TIMES, low_parts), dense(TIMES, low_parts))


@pytest.mark.parametrize("text", TEXTS)
def test_kernels_and_the_general_way_find_the_same_motion(text, monkeypatch):
    """Without the kernels' word, the same runs go through the general code: the same claims, to rounding."""
    field = expression_potential(text, {}, BODY)
    quick = integrate_state(BODY, field, STATE[:3], STATE[3:], TIMES, tolerance=1e-9)
    monkeypatch.setattr(compiled, "verified_run", lambda *_: None)
    monkeypatch.setattr(compiled.CompiledIntegrator, "keeps", lambda *_: False)
    slow = integrate_state(BODY, field, STATE[:3], STATE[3:], TIMES, tolerance=1e-9)
    assert np.array_equal(quick.samples, slow.samples)
    # F is evaluated by other sums: the estimate's own rounding is some ulp of numbers up to 10.
    parts = [motion.error - motion.evidence[GROWTH] for motion in (quick, slow)]
    # The general way adds growth and difference of the same time, kernels those that are largest.
    assert parts[1] <= parts[0] * (1.0 + 1e-6) + 1e-14
    assert slow.error >= parts[0] * (1.0 - 1e-6) - 1e-14
    # It takes the tolerance for what a step leaves out; the last terms, which kernels see, are as large.
    assert 0.1 * slow.evidence[GROWTH] <= quick.evidence[GROWTH] <= 10.0 * slow.evidence[GROWTH]
    assert quick.energy.value == pytest.approx(slow.energy.value, abs=1e-14)


def test_a_step_that_breaks_the_equations_is_not_kept():
    """One coefficient of one step is moved by ten times what a step may leave."""
    field = expression_potential(TEXTS[0], {}, BODY)
    integrator = integrator_of(BODY, field)
    run = integrator.run(np.array(STATE), 5.0, local_tolerance=1e-13, max_steps=1000)
    allowed = 1e-10
    assert integrator.keeps(run, allowed, allowed)
    moved = run.coefficients.copy()
    moved[3, 2, 4] += 10.0 * allowed
    assert not integrator.keeps(replace(run, coefficients=moved), allowed, allowed)
    assert not integrator.keeps(Run(run.breaks, np.full_like(moved, np.nan), None), allowed, allowed)
