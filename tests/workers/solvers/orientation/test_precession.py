"""Precession of planar motions: golden numbers, the curve's own number against sums along the motion."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from service.dynamics.equations.orientation import (
    LOCAL_QUATERNION,
    PRECESSION,
)
from service.dynamics.motion import Estimate
from service.dynamics.problem import PlanarMotion, StartAtEquator
from service.dynamics.reduction.geometry.loop import make_loop
from tests.support.effort import examples
from tests.support.planar import body, formula
from tests.support.witnesses.rotation_matrix import rotation_matrix
from tests.workers.solvers.orientation.cases import (
    PRECESSIONS,
    quaternion_at,
    solved,
    solved_row,
    sums,
    through_poles,
)
from workers.solvers.compiled.frame import make_frame
from workers.solvers.orientation.advance import loop_advances
from workers.solvers.orientation.by_doubles import advances_by_doubles
from workers.solvers.orientation.pieces import VerticalAxisError
from workers.solvers.orientation.solve import with_orientation

TWO_PI = Fraction("6.28318530717958647692528676655900576839")


@pytest.mark.parametrize("nu", PRECESSIONS)
def test_golden_precession_through_the_poles(nu):
    orientation = with_orientation(through_poles(nu))
    exact = Fraction(PRECESSIONS[nu])
    advance = orientation.dense.advances["psi1"]
    # The sum of two doubles has the digits of the ball arithmetic; the golden numbers end at 1e-26.
    assert abs(Fraction(advance.hi) + Fraction(advance.lo) - exact) <= Fraction(advance.error) + Fraction(
        1, 10**26
    )
    found = orientation.precession
    assert abs(Fraction(found.psi1.value) - exact) <= Fraction(found.psi1.error) <= Fraction(1, 10**15)
    # The other route, summing ψ̇ along the motion, reaches the same; its defect is part of the error
    # claimed, and explained by the rest of it.
    errors = orientation.dense.errors
    assert 2 * abs(sums(orientation)["psi1"] - float(exact)) <= errors["psi1"] <= 1e-12
    assert 2 * abs(sums(orientation)["psi3"] - found.psi3.value) <= errors["psi3"] <= 1e-12


@pytest.mark.parametrize("nu", PRECESSIONS)
def test_golden_precession_by_doubles(nu):
    frame = make_frame(body(2, 1), PlanarMotion(None, Fraction(nu)))
    for sense in (1, -1):
        one, three = advances_by_doubles(frame.shared, sense)
        exact = sense * Fraction(PRECESSIONS[nu])
        assert abs(Fraction(one.hi) + Fraction(one.lo) - exact) <= Fraction(one.error) <= Fraction(2, 10**14)
        # Δψ3 = Δψ1 − 2πε, 2π to twice the digits of a double.
        gap = Fraction(one.hi) + Fraction(one.lo) - Fraction(three.hi) - Fraction(three.lo)
        assert abs(sense * gap - TWO_PI) <= Fraction(1, 10**30)


@example(moments=(Fraction(49, 10), Fraction(1, 5)), lambda_=Fraction(409, 25), sense=-1)
@given(
    moments=st.tuples(*[st.fractions(Fraction(1, 5), 5, max_denominator=20)] * 2).filter(
        lambda m: m[0] != m[1]
    ),
    lambda_=st.fractions(Fraction(1, 50), 50, max_denominator=50),
    sense=st.sampled_from([-1, 1]),
)
@settings(max_examples=examples(12, 300), deadline=None)
@pytest.mark.random_law
def test_the_advance_by_doubles_is_that_of_balls(moments, lambda_, sense):
    """This holds for any body on any curve; the potential has no part in it."""
    motion = PlanarMotion(lambda_)
    rigid_body = body(*moments)
    found = advances_by_doubles(make_frame(rigid_body, motion).shared, sense)
    loop = make_loop(rigid_body, formula("-g1", rigid_body), motion)
    slow = loop_advances(loop, sense)
    if found is None:
        # The rounding of log λ counts α-fold: only extreme curves are left to balls.
        alpha = max(moments) / min(moments)
        assert (1 + alpha) * abs(np.log(float(lambda_))) >= 10.0
        return
    for one, other in zip(found, slow, strict=True):
        gap = Fraction(one.hi) + Fraction(one.lo) - Fraction(other.hi) - Fraction(other.lo)
        # Two routes, each with its own error.
        assert abs(gap) <= Fraction(one.error) + Fraction(other.error)


@given(
    signs=st.tuples(*[st.sampled_from([-1, 1])] * 3), nu=st.fractions(Fraction(1, 20), 20, max_denominator=30)
)
@settings(max_examples=examples(3, 10), deadline=None)
def test_the_signs_of_the_precession(signs, nu):
    """Δψ1 has the sign ε of s g1 g3, and Δψ3 = Δψ1 − 2πε: each axis goes its part of one turn."""
    g1, g3, s = signs
    motion = PlanarMotion(None, g1 * nu, g3_sign=g3, start=StartAtEquator(s))
    found = with_orientation(solved(2, 1, "-g1" if g1 > 0 else "g1", motion)).precession
    sense = s * g1 * g3
    assert sense * found.psi1.value > 0.0
    assert sense * found.psi3.value < 0.0
    # Two roundings of numbers below 2π.
    assert found.psi1.value - found.psi3.value == pytest.approx(2 * np.pi * sense, abs=2e-15)


@given(sense=st.sampled_from([-1, 1]), lambda_=st.fractions(Fraction(1, 5), 5, max_denominator=20))
@settings(max_examples=examples(3, 5), deadline=None)
def test_the_mirror_exchanging_the_axes_turns_the_precession_round(sense, lambda_):
    """(A, C; g1, g3) → (C, A; g3, g1) reflects space: ψ1 → −ψ3, ψ3 → −ψ1."""
    straight = PlanarMotion(lambda_, start=StartAtEquator(sense))
    turned = PlanarMotion(1 / lambda_**2, start=StartAtEquator(sense))
    one = with_orientation(solved(2, 1, "-g1", straight)).precession
    other = with_orientation(solved(1, 2, "-g3", turned)).precession
    assert one.psi1.value == pytest.approx(-other.psi3.value, abs=2e-15)
    assert one.psi3.value == pytest.approx(-other.psi1.value, abs=2e-15)


def test_precession_knows_nothing_of_the_potential():
    """Summed along motions in other potentials; the number of the loop is the same at once."""
    plain, strong, other = (
        with_orientation(through_poles(text=text)) for text in ("-g1", "-3*g1", "-g1 + (g1^2-g2^2)/10")
    )
    for orientation in (strong, other):
        for name in PRECESSION:
            gap = abs(sums(orientation)[name] - sums(plain)[name])
            assert gap <= orientation.dense.errors[name] + plain.dense.errors[name] <= 1e-12
        assert orientation.precession == plain.precession


@pytest.mark.parametrize(
    "name", ["rest to equator", "rest to rest, north", "pole to rest, north", "alpha = 3"]
)
def test_a_libration_comes_back_in_space_too(name):
    orientation = with_orientation(solved_row(name)[2])
    for angle in PRECESSION:
        # A theorem; the sums along the motion, whose defect is one part of the columns' error, say the same.
        assert getattr(orientation.precession, angle) == Estimate(0.0, 0.0, "theorem")
        assert 2 * abs(sums(orientation)[angle]) < orientation.dense.errors[angle] <= 1e-12
    period = orientation.dense.period.hi
    ends = orientation.dense(np.array([0.0, np.nextafter(period, 0.0)]))
    first = orientation.dense.columns.index(LOCAL_QUATERNION[0])
    assert np.abs(np.diff(ends[:, first : first + 4], axis=0)).max() <= orientation.dense.errors["local_q0"]


@pytest.mark.parametrize(("lambda_", "claim"), [("1/1000", 1e-10), ("1000", 1e-4)])
def test_axes_that_come_close_to_the_vertical(lambda_, claim):
    """To 1e-3 and 1e-6: azimuths are worse there, and say so, the attitude is not."""
    motion = solved(2, 1, "-g1", PlanarMotion(Fraction(lambda_)))
    orientation = with_orientation(motion)
    dense, found = orientation.dense, orientation.precession
    for name in PRECESSION:
        value = getattr(found, name).value
        # The claims: the motion's 1e-14 and 1e-12, enlarged by the inverse angle and the time spent there.
        assert 2 * abs(sums(orientation)[name] - value) <= dense.errors[name] <= claim
    R = rotation_matrix(quaternion_at(orientation, motion.times))
    # Products of rounded components, and gamma's own rounding.
    assert np.abs(R[:, 2] - motion.samples[:, 3:]).max() <= 2e-14
    assert len(dense.breaks) <= 1000


def test_axes_that_are_all_but_vertical_are_refused():
    motion = solved(2, 1, "-g1", PlanarMotion(Fraction(10**8)), tolerance=1e-6)
    with pytest.raises(VerticalAxisError, match="axis 3") as refusal:
        with_orientation(motion)
    assert (refusal.value.code, refusal.value.pointer) == ("vertical_axis", "/outputs")
