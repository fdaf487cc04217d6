"""Formulas in Taylor series, by heyoka and by kernels, and the conversion of the series."""

from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.potentials.families.written import expression_potential
from tests.support.heyoka_integrator import HeyokaIntegrator, heyoka_integrator
from tests.workers.solvers.integration.cases import BODY
from workers.solvers.integration.compiled import CompiledIntegrator
from workers.solvers.integration.dop853 import Dop853Integrator
from workers.solvers.integration.interface import joined, neighbour_of


@pytest.mark.parametrize(
    "text",
    [
        "g2^3 + g1^2*g2^5",  # zero base of integer powers
        "1/g1^3 + g3^(-2)",
        "sqrt(g1) + g3^(2/3) - g1^(-1/2)",
        "exp(g2) + log(g1) + sin(g2) + cos(g3) + tan(g2)",
        "(1 + g1^2)^(g2/2) + pi*g3^g1",
        "-g1 - (g2 - g3)/(2 + g1*g2)",
        "tan(g2)^3 + exp(g2^2)^2 + sin(g2)^2",
        "3",
    ],
)
def test_every_operation_moves_the_body_as_runge_kutta_does(text):
    """On the equator, g2 = q = 0, and both ways: gradients and Taylor series are those of the formula."""
    field = expression_potential(text, {}, BODY)
    state = np.array([0.3, 0.0, -0.2, 0.6, 0.0, 0.8])
    ends = []
    for integrator in (
        HeyokaIntegrator(BODY, field),
        CompiledIntegrator(BODY, field),
        Dop853Integrator(BODY, field),
    ):
        runs = [integrator.run(state, end, local_tolerance=1e-13, max_steps=10_000) for end in (-0.25, 0.25)]
        assert [run.ending for run in runs] == [None, None]
        ends.append(joined(*runs)(np.linspace(-0.25, 0.25, 21)))
    # Some tens of local errors of 1e-13, times the sensitivity of half a unit of time.
    assert np.abs(ends[0] - ends[2]).max() <= 1e-11
    assert np.abs(ends[1] - ends[2]).max() <= 1e-11


@pytest.mark.parametrize("make", [HeyokaIntegrator, CompiledIntegrator])
def test_pieces_are_the_taylor_polynomials_to_rounding(make):
    """Neighbouring pieces meet, and an ending at any time repeats the values of a longer run there."""
    field = expression_potential("-g1 + 1/(20*g3^2)", {}, BODY)
    integrator = make(BODY, field)
    state = np.array([0.3, 0.1, -0.2, 0.6, 0.0, 0.8])
    run = integrator.run(state, 20.0, local_tolerance=1e-20, max_steps=10_000)
    right = run.coefficients.sum(axis=1)
    left = (run.coefficients * (-1.0) ** np.arange(run.coefficients.shape[1])[:, None]).sum(axis=1)
    # 16 terms of a sum of numbers up to 4: a few ulp of 4e-16.
    assert np.abs(right[:-1] - left[1:]).max() <= 4e-15
    times = np.linspace(0.1, 3.0, 8)
    shorter = [integrator.run(state, t, local_tolerance=1e-20, max_steps=10_000) for t in times]
    ends = np.array([part.coefficients[-1].sum(axis=0) for part in shorter])
    assert np.abs(joined(None, run)(times) - ends).max() <= 4e-15


def test_chunks_do_not_show():
    field = expression_potential("-g1", {}, BODY)
    state = np.array([0.3, 0.1, -0.2, 0.6, 0.0, 0.8])
    run = HeyokaIntegrator(BODY, field).run(state, 400.0, local_tolerance=1e-16, max_steps=10_000)
    assert len(run.breaks) > 1025
    assert run.coefficients.shape[0] == len(run.breaks) - 1
    right = run.coefficients.sum(axis=1)
    left = (run.coefficients * (-1.0) ** np.arange(run.coefficients.shape[1])[:, None]).sum(axis=1)
    assert np.abs(right[:-1] - left[1:]).max() <= 4e-15


def test_a_shared_integrator_has_the_bits_of_a_new_one():
    field, other = (expression_potential("-g1 + g3^2/7", {}, BODY) for _ in range(2))
    states = [np.array([0.3, 0.1, -0.2, 0.6, 0.0, 0.8]), np.array([-0.1, 0.7, 0.2, 0.0, 1.0, 0.0])]
    shared = heyoka_integrator(BODY, field)
    assert heyoka_integrator(BODY, other) is shared
    for state in (states[0], states[1], states[0]):
        for mine, new in ((shared, HeyokaIntegrator(BODY, field)), (shared.neighbour(), None)):
            fresh = new or HeyokaIntegrator(BODY, field).neighbour()
            runs = [each.run(state, 3.0, local_tolerance=1e-12, max_steps=1000) for each in (mine, fresh)]
            assert np.array_equal(runs[0].breaks, runs[1].breaks)
            assert np.array_equal(runs[0].coefficients, runs[1].coefficients)


def test_rounded_numbers_have_a_neighbour_on_the_side_of_the_truth():
    assert neighbour_of(Fraction(3, 4)) == 0.75
    assert neighbour_of(0.0) == 0.0
    third = Fraction(1, 3)
    low, high = sorted((float(third), neighbour_of(third)))
    assert Fraction(low) < third < Fraction(high)
    assert high == np.nextafter(low, 1.0)
    assert neighbour_of(-0.5) == np.nextafter(-0.5, -1.0)
