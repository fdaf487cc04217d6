"""Changes of units, and mirrors: they leave the multipliers and change the unit of time."""

from fractions import Fraction
from functools import cache

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.effort import examples
from tests.workers.solvers.stability.cases import Case, case, lambda_, nu
from workers.solvers.stability.assessment import Stability

B = Fraction(3, 2)
FACTORS = st.fractions("1/1000", 1000, max_denominator=1000)
FORMULA = "(g1 + 1/(10*g3^2) - 3*(g1^2 - g2^2))"


@cache
def unit() -> Stability:
    return case(2, B, 1, FORMULA, nu(1)).assess()


def same(changed: Case, clock: float) -> None:
    """Compare with ``unit()``; ``clock`` is the period of the changed motion in parts of that one's."""
    stability, reference = changed.assess(), unit()
    # Other roundings, but the same numbers within both claims.
    assert abs(stability.trace - reference.trace) <= stability.error + reference.error
    assert stability.error <= 4.0 * reference.error
    assert stability.verdict == "unstable"
    error = stability.exponent_error * clock + reference.exponent_error
    assert abs(stability.exponent * clock - reference.exponent) <= error <= 1e-13


@given(FACTORS)
@settings(max_examples=examples(3, 8), deadline=None)
def test_a_stronger_field_is_only_faster(k):
    same(case(2, B, 1, f"({k})*{FORMULA}", nu(1)), float(k) ** -0.5)


@given(FACTORS)
@settings(max_examples=examples(3, 8), deadline=None)
def test_a_heavier_body_is_only_slower(k):
    same(case(2 * k, B * k, k, FORMULA, nu(1)), float(k) ** 0.5)


@pytest.mark.parametrize(
    ("A", "C", "text", "nu_or_lambda"),
    [
        (2, 1, FORMULA.replace("g1 +", "-g1 +"), nu(-1)),
        (2, 1, FORMULA, nu(1, g3_sign=-1)),
        (1, 2, "(g3 + 1/(10*g1^2) - 3*(g3^2 - g2^2))", lambda_(1)),
        (2, 1, FORMULA + " + 7", nu(1)),
        (2, 1, FORMULA + " + 5*(g1^2 + g2^2 + g3^2 - 1)", nu(1)),
    ],
    ids=["g1 mirrored", "g3 mirrored", "first and third axis exchanged", "constant", "off the sphere"],
)
def test_mirrors_and_what_vanishes_on_the_sphere_change_nothing(A, C, text, nu_or_lambda):
    same(case(A, B, C, text, nu_or_lambda), 1.0)
