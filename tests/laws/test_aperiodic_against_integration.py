"""Random motions that never close, by the integral and by the six equations."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from service.dynamics.motion import Motion
from service.dynamics.problem import StartAtPoint, TimeList
from service.dynamics.reduction.window import StartOutsideWindowError, Window
from service.dynamics.reduction.windows import find_windows
from tests.support.admissible import Case, cases
from tests.support.effort import examples
from workers.solvers.integration.solve import integrate_state


def moments() -> TimeList:
    return TimeList(tuple(Fraction(k, 8) for k in (-2, -1, 0, 1, 2, 8)))


def aperiodic_window(case: Case) -> Window | None:
    problem = case.problem()
    for window in find_windows(problem.body, problem.potential, case.motion):
        wide = abs(abs(window.g1[1]) - abs(window.g1[0])) > 0.05
        if window.kind != "periodic" and wide:
            return window
    return None


def solve_inside(case: Case, window: Window, share: Fraction) -> Motion:
    """Start at a g1 inside the window: every kind has those."""
    low, high = (Fraction(end).limit_denominator(10**6) for end in window.g1)
    for g2_sign in (1, -1):
        start = StartAtPoint(low + share * (high - low), g2_sign=g2_sign)
        motion = replace(case.motion, window=window.index, start=start)
        try:
            return case.changed(motion=motion).solve(times=moments())
        except StartOutsideWindowError:
            continue
    assume(False)
    raise AssertionError


@pytest.mark.random_law
@given(cases(attracts=True), st.fractions(Fraction(1, 3), Fraction(2, 3), max_denominator=9))
@settings(max_examples=examples(2, 25), deadline=None, suppress_health_check=[HealthCheck.filter_too_much])
def test_random_aperiodic_motions(case, share):
    window = aperiodic_window(case)
    assume(window is not None)
    motion = solve_inside(case, window, share)
    ends = [end.time.value for end in (motion.past, motion.future) if end.time is not None]
    # Well before an end, where the six variables of a collision are still of size 1.
    safe = min([1.0, *(abs(end) / 2 for end in ends)])
    times = motion.times[np.abs(motion.times) <= safe]
    problem = case.problem()
    rigid_body = replace(problem.body, B=problem.body.A)
    omega, gamma = np.split(motion.dense(np.zeros(1))[0], 2)
    witness = integrate_state(rigid_body, problem.potential, list(omega), list(gamma), times, tolerance=1e-9)
    gap = np.abs(witness.samples - motion.dense(times)).max()
    # Each route answers for its own error; their tolerance is 1e-9.
    assert gap <= witness.error + motion.error
    for end in (motion.past, motion.future):
        assert (end.time is None) or end.time.error <= 1e-12 * (1.0 + abs(end.time.value))
