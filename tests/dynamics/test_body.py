from fractions import Fraction

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from service.dynamics.body import RigidBody
from service.dynamics.errors import (
    EqualMomentsError,
    ExtremeMomentsError,
    ImpossibleInertiaError,
    MissingMomentError,
    UnphysicalInertiaError,
)

MASSES = st.fractions(min_value=0, max_value=100, max_denominator=1000)
MOMENTS = st.fractions(min_value=Fraction(1, 1000), max_value=100, max_denominator=1000)


@given(MASSES, MASSES, MASSES)
def test_every_distribution_of_mass_is_a_body(xx: Fraction, yy: Fraction, zz: Fraction) -> None:
    # Moments are sums of two second moments of the mass; every body's are.
    A, B, C = yy + zz, zz + xx, xx + yy
    assume(min(A, B, C) > 0)
    body = RigidBody(A, B, C)
    assert body.require_B("this test") == B


@given(MOMENTS, MOMENTS, MOMENTS)
def test_a_body_is_refused_exactly_if_a_triangle_inequality_fails(
    A: Fraction, B: Fraction, C: Fraction
) -> None:
    possible = A + B >= C and B + C >= A and C + A >= B
    if possible:
        RigidBody(A, B, C)
    else:
        with pytest.raises(UnphysicalInertiaError) as caught:
            RigidBody(A, B, C)
        assert caught.value.pointer == "/body"
    RigidBody(A, B, C, allow_unphysical=True)
    RigidBody(A, None, C)


@pytest.mark.parametrize("name", ["A", "B", "C"])
@pytest.mark.parametrize("value", [Fraction(0), Fraction(-1, 3)])
def test_a_moment_that_is_not_positive_is_named(name: str, value: Fraction) -> None:
    moments = {"A": Fraction(2), "B": Fraction(2), "C": Fraction(1)} | {name: value}
    with pytest.raises(ImpossibleInertiaError) as caught:
        RigidBody(**moments, allow_unphysical=True)
    assert caught.value.pointer == f"/body/{name}"
    assert str(value) in caught.value.message


def test_a_thin_rod_is_allowed() -> None:
    # A rod along the third axis, slightly thick: C small, A = B; and the flat limit A + C = B.
    RigidBody(Fraction(1), Fraction(1), Fraction(1, 10**12))
    RigidBody(Fraction(2), Fraction(3), Fraction(1))


def test_the_exponent_of_the_curves_is_the_ratio_of_the_moments() -> None:
    assert RigidBody(Fraction(17, 10), None, Fraction(1)).alpha == Fraction(17, 10)


def test_planar_motions_need_two_different_moments() -> None:
    RigidBody(Fraction(2), None, Fraction(1)).require_planar()
    with pytest.raises(EqualMomentsError):
        RigidBody(Fraction(1), None, Fraction(1)).require_planar()


def test_a_missing_moment_is_asked_for_with_the_reason() -> None:
    with pytest.raises(MissingMomentError, match="integration needs the moment B") as caught:
        RigidBody(Fraction(2), None, Fraction(1)).require_B("integration")
    assert caught.value.pointer == "/body/B"


@pytest.mark.parametrize(
    ("A", "C", "said"), [("1e150", "1", "some 1e150 times"), ("1", "1e14", "some 1e14 times")]
)
def test_a_ratio_of_moments_beyond_all_use_is_refused_for_planar_motions(A, C, said):
    found = RigidBody(Fraction(A), None, Fraction(C), allow_unphysical=True)
    with pytest.raises(ExtremeMomentsError, match=said):
        found.require_planar()
