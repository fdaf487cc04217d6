"""Stability in compiled doubles: against balls, Lamé's closed form, known numbers; and what is declined."""

from dataclasses import replace
from fractions import Fraction

import pytest
from flint import ctx
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.body import RigidBody
from service.dynamics.errors import MissingMomentError
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.windows import choose_window, find_windows
from tests.support.admissible import Case as AdmissibleCase
from tests.support.admissible import cases as admissible
from tests.support.effort import examples
from tests.support.planar import body, formula
from tests.workers.solvers.stability.cases import TOLERANCE, in_window, lambda_, lame_trace, nu
from workers.solvers.stability.assessment import Stability
from workers.solvers.stability.by_doubles import LARGEST_ERROR, stability_by_doubles
from workers.solvers.stability.monodromy import StabilityUndefinedError

GRAVITY = "-g1"
TRACES = {
    "3/10": {
        "3/5": 2.810230411810,
        "3/2": 0.996244256876,
        "2": 0.385106630609,
        "5/2": -0.000207850348,
        "3": -0.259448901350,
        "4": -0.580593841300,
    },
    "1": {
        "3/5": 0.272591193785,
        "3/2": -0.431022634189,
        "2": -1.784120475788,
        "5/2": -1.969065344260,
        "3": -1.534812781286,
        "4": -0.005495326278,
    },
    "2": {
        "3/5": -1.553262001949,
        "3/2": -1.229640939942,
        "2": -1.608543553235,
        "5/2": 1.788589694010,
        "3": 7.205281206786,
        "4": 19.690002913594,
    },
}
"""μ + 1/μ of V = −g1 with A = 2, C = 1 by nu and B, from an independent computation."""


def by_doubles(
    A: Fraction | int, B: Fraction | str, C: Fraction | int, text: str, motion: PlanarMotion
) -> Stability | None:
    rigid_body = body(A, C, B)
    potential = formula(text, rigid_body)
    window = choose_window(find_windows(rigid_body, potential, motion), motion)
    return stability_by_doubles(rigid_body, potential, motion, window, TOLERANCE)


@pytest.mark.parametrize("nu_", TRACES)
def test_golden_traces(nu_):
    for B, expected in TRACES[nu_].items():
        found = by_doubles(2, B, 1, GRAVITY, nu(nu_))
        assert found is not None
        # The table has twelve decimals.
        assert abs(found.trace - expected) <= found.error + 5e-13
        assert found.verdict == ("stable" if abs(expected) < 2.0 else "unstable")


@given(
    st.fractions(Fraction(1, 10), 5, max_denominator=30), st.fractions(Fraction(1, 4), 4, max_denominator=30)
)
@settings(max_examples=examples(8, 100), deadline=None)
@pytest.mark.random_law
def test_against_lames_equation(nu_, B):
    found = by_doubles(2, B, 1, GRAVITY, nu(nu_))
    exact = lame_trace(nu_, B)
    if found is None:
        # An error of 1e-10 leaves the verdict open, or there is none.
        assert abs(abs(float(exact)) - 2.0) <= LARGEST_ERROR * max(1.0, abs(float(exact)))
        return
    assert abs(exact - found.trace) <= found.error <= LARGEST_ERROR * max(1.0, abs(found.trace))


@given(admissible(), st.fractions("1/5", 4, max_denominator=10))
@settings(max_examples=examples(6, 250), deadline=None)
@pytest.mark.random_law
def test_against_balls(problem, B):
    rigid_body = body(problem.A, problem.C, B)
    for window in find_windows(rigid_body, formula(problem.text, rigid_body), problem.motion):
        if window.kind == "periodic":
            agree(problem, rigid_body, replace(problem.motion, window=window.index))


def agree(problem: AdmissibleCase, rigid_body: RigidBody, motion: PlanarMotion) -> None:
    potential = formula(problem.text, rigid_body)
    window = choose_window(find_windows(rigid_body, potential, motion), motion)
    found = stability_by_doubles(rigid_body, potential, motion, window, TOLERANCE)
    try:
        slow = in_window(rigid_body, potential, motion, window).assess()
    except StabilityUndefinedError:
        assert found is None
        return
    if found is None:
        return
    # Two routes, each with its own error.
    assert abs(found.trace - slow.trace) <= found.error + slow.error
    both = found.multipliers_error + slow.multipliers_error
    assert all(
        abs(one - other) <= both for one, other in zip(found.multipliers, slow.multipliers, strict=True)
    )
    assert found.verdict == slow.verdict
    assert abs(found.exponent - slow.exponent) <= found.exponent_error + slow.exponent_error


def test_what_is_declined():
    """No multipliers through a pole where V is not smooth; a trace of 2; a B that is not there."""
    assert by_doubles(3, "5/2", 1, "-abs(g1)^(4/3)", lambda_(1)) is None
    assert by_doubles(2, 1, 1, GRAVITY, nu(1)) is None
    with pytest.raises(MissingMomentError):
        by_doubles(2, None, 1, GRAVITY, nu(1))


def test_next_to_a_separatrix_the_error_says_so():
    """1e-8 beside it the motion rests for most of 41 time units: what doubles know of c1 counts for more."""
    text = "-g1 + 809017/1000000*(g1^2 - g2^2)"
    rigid_body = body(2, 1, "3/2")
    potential, motion = formula(text, rigid_body), nu(1)
    window = choose_window(find_windows(rigid_body, potential, motion), motion)
    with ctx.workprec(128):
        slow = in_window(rigid_body, potential, motion, window).assess()
    found = stability_by_doubles(rigid_body, potential, motion, window, TOLERANCE)
    assert found is None or abs(found.trace - slow.trace) <= found.error + slow.error
