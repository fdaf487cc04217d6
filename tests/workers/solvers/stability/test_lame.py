"""Bobylev's and Steklov's motions: Hill's equation is Lamé's and its multipliers are known."""

from fractions import Fraction

import pytest
from flint import arb
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.effort import examples
from tests.workers.solvers.stability.cases import bobylev_steklov, lame_trace

MOMENTS = ("0.6", "1", "1.5", "2", "2.5", "3", "4")
TRACES = {
    "0.3": (
        2.810230411810,
        2,
        0.996244256876,
        0.385106630609,
        -0.000207850348,
        -0.259448901350,
        -0.580593841300,
    ),
    "1": (
        0.272591193785,
        2,
        -0.431022634189,
        -1.784120475788,
        -1.969065344260,
        -1.534812781286,
        -0.005495326278,
    ),
    "2": (
        -1.553262001949,
        2,
        -1.229640939942,
        -1.608543553235,
        1.788589694010,
        7.205281206786,
        19.690002913594,
    ),
}
"""μ + 1/μ for A = 2, C = 1, V = −g1, by ν and B: theta functions, and a Taylor integration of the six."""
LARGEST = {("0.3", "0.6"): 2.39221, ("2", "3"): 7.06371, ("2", "4"): 19.6391}


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    ("nu", "B", "trace"), [(nu, B, t) for nu in TRACES for B, t in zip(MOMENTS, TRACES[nu], strict=True)]
)
def test_the_trace_is_the_tabulated_one(nu, B, trace):
    stability = bobylev_steklov(nu, B).assess()
    # Half a unit of the last digit printed, and the error claimed.
    assert abs(stability.trace - trace) <= 5e-13 + stability.error
    if (nu, B) in LARGEST:
        # Printed to six digits.
        assert abs(stability.multipliers[0] - LARGEST[nu, B]) <= 5e-6 * LARGEST[nu, B]
        assert stability.verdict == "unstable"
    else:
        assert stability.verdict == ("marginal" if B == "1" else "stable")


@given(
    st.fractions(Fraction(1, 10), 20, max_denominator=50),
    st.fractions(Fraction(1, 5), 5, max_denominator=50).filter(lambda B: B != 1),
)
@settings(max_examples=examples(7, 20), deadline=None)
def test_the_error_covers_the_distance_from_the_closed_form(nu, B):
    stability = bobylev_steklov(nu, B).assess()
    distance = abs(lame_trace(nu, B) - arb(stability.trace))
    assert distance <= stability.error
    # Some hundred roundings of the largest propagator on the way: 1e-13 in parts of it.
    assert stability.error <= 1e-13 * max(2.0, abs(stability.trace))


@pytest.mark.parametrize("nu", ["1e-6", "1e-3", "1e3", "1e6"])
@pytest.mark.parametrize("B", ["0.7", "3"])
def test_the_error_covers_the_distance_at_the_ends_of_the_family(nu, B):
    stability = bobylev_steklov(nu, B).assess()
    # As above.
    assert abs(lame_trace(nu, B) - arb(stability.trace)) <= stability.error
    assert stability.error <= 1e-13 * max(2.0, abs(stability.trace))


@given(
    st.fractions(Fraction(1, 10), 5, max_denominator=20),
    st.fractions(Fraction(1, 2), 5, max_denominator=20),
)
@settings(max_examples=examples(7, 20), deadline=None)
def test_bands_of_stability_are_those_of_lames_equation(nu, B):
    # E lies in a band if and only if x = 2 nu (C − B)/B does; bands end at the zeros of x (1 − x² − nu x).
    x = float(2 * nu * (1 - B) / B)
    root = float(nu * nu + 4) ** 0.5
    x1, x2 = 2.0 / (float(nu) + root), -(float(nu) + root) / 2.0
    stability = bobylev_steklov(nu, B).assess()
    if x == 0.0:
        assert stability.verdict == "marginal"
    elif min(abs(x - x1), abs(x - x2)) > 1e-9:
        # Nearer to an edge the trace may be closer to 2 than its error.
        assert stability.verdict == ("stable" if x2 < x <= 0.0 or x > x1 else "unstable")


def test_the_edges_of_the_bands_are_marginal():
    # nu = 3/2: x2 = −2, and x = 2 nu (C − B)/B = −2 at B = 3; x1 = 1/2 is reached at B = 6/7.
    for B in ("3", "6/7"):
        stability = bobylev_steklov("3/2", B).assess()
        assert stability.verdict == "marginal"
        # A trace with this error stands for multipliers with its square root.
        assert abs(stability.trace - 2.0) <= stability.error
        assert abs(stability.multipliers[0] - 1.0) <= stability.multipliers_error <= 1e-6


@pytest.mark.parametrize("nu", ["0.3", "1", "7"])
def test_lagranges_top_is_marginal(nu):
    stability = bobylev_steklov(nu, 1).assess()
    assert stability.verdict == "marginal"
    assert abs(stability.trace - 2.0) <= stability.error <= 1e-13
