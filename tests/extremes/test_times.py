"""Late times, few samples and many: the phase is right after 1e12 periods, or the claim grows."""

from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.problem import PlanarMotion, TimePeriods, TimeSpan
from service.dynamics.sampling import sample_times
from tests.extremes.elliptic import elliptic
from tests.extremes.problems import METHODS, require_claims, solve, three_terms
from tests.support.planar import body, planar
from tests.support.solving import solve_planar

ONE, ZERO = Fraction(1), Fraction(0)
WE = elliptic("WE", nu=ONE, a1=-ONE, b1=Fraction(1, 20), c1=ZERO)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("exponent", [3, 6, 9, 12, 15])
def test_times_to_1e15_periods(method, exponent):
    # The quadrature knows the period to 3e-17: after 1e12 of them the phase to 3e-5.
    tolerance = "1e-10" if method == "auto" or exponent < 7 else "1e-2"
    times = {"periods": f"1e{exponent}", "samples": 12}
    answer = three_terms(-1, "1/20", 0, 1, times, method=method, tolerance=tolerance)
    if method == "quadrature" and exponent == 15:
        assert answer.code in (None, "accuracy_not_met")
    if answer.code is None:
        require_claims(answer, WE)
    else:
        assert method == "quadrature"


@pytest.mark.parametrize("method", METHODS)
def test_the_claim_grows_with_the_error_of_the_period(method):
    claims = [
        three_terms(
            -1, "1/20", 0, 1, {"periods": periods, "samples": 9}, method=method, tolerance="1e-2"
        ).error
        for periods in ("1e12", "1e15")
    ]
    # The error of the quadrature's period is some 1e-20, that of compiled code's 1e-25; what is claimed of
    # a period without counting turns 1e-14: both are above it after 1e12 and 1e15 periods, or nearly so.
    assert claims[1] > 100.0 * claims[0]


def test_late_times_without_a_closed_form_are_those_of_the_first_period():
    """Eighths of 1e9 periods are whole periods, and hi + lo carries the phase to them."""
    law, motion, moments = "(A*g1^2+C*g3^2)*(g2^2-1/2+g2^3/5)", {"lambda": "4/5"}, ("17/10", 1)
    late = solve(law, motion, {"periods": "1e9", "samples": 9}, body=moments, tolerance="1e-4")
    assert np.abs(late.states - late.states[0]).max() <= late.error


def test_late_times_of_aperiodic_motions_stay_at_their_end():
    answer = three_terms(
        1, "-1/16", -1, 1, {"start": 0, "stop": "1e12", "samples": 2}, window=1, tolerance="1e-4"
    )
    assert abs(answer.states[-1, 3] - 0.25) <= answer.error


def test_one_sample():
    for times in ({"periods": "1e12", "samples": 1}, {"start": 0, "stop": 1, "samples": 1}, {"times": [0]}):
        answer = three_terms(-1, "1/20", 0, 1, times)
        assert len(answer.columns["t"]) == 1
        require_claims(answer, WE)


def test_the_door_takes_1e5_samples_and_names_more():
    many = {"periods": 3, "samples": 100_000}
    answer = three_terms(-1, "1/20", 0, 1, many)
    assert answer.states.shape == (100_000, 6)
    assert np.abs(answer.states[-1] - answer.states[0]).max() <= 2.0 * answer.error
    assert three_terms(-1, "1/20", 0, 1, {"periods": 3, "samples": 1_000_000}).code == "invalid_problem"
    assert three_terms(-1, "1/20", 0, 1, {"periods": "1e16", "samples": 2}).code == "invalid_problem"


@pytest.mark.long
def test_a_million_samples_of_the_solver():
    times = TimePeriods(Fraction(7), 1_000_000)
    motion = solve_planar(planar(body(2, 1), "-g1 + 1/(20*g3^2)", PlanarMotion(None, nu=ONE), times))
    assert motion.samples.shape == (1_000_000, 6)
    # Every 142857th interval is a period: 999 999 = 7 · 142 857.
    whole = motion.samples[::142_857]
    assert np.abs(whole - whole[0]).max() <= 2.0 * motion.error


def test_sampled_times_are_the_doubles_nearest_to_the_exact_ones():
    spans = [
        TimeSpan(Fraction(-1, 3), Fraction(10) ** 12, 1000),
        TimeSpan(Fraction("-1e-300"), Fraction("7e-5"), 777),
    ]
    for span in spans:
        step = (span.stop - span.start) / (span.samples - 1)
        exact = [float(span.start + step * k) for k in range(span.samples)]
        assert sample_times(span, None).doubles.tolist() == exact
