"""Where a motion starts: what can be asked, and what is refused with the reason."""

import math
from fractions import Fraction

import pytest
from flint import ctx

from service.dynamics.problem import PlanarMotion, StartAtEquator, StartAtPoint, StartAtRest
from service.dynamics.reduction.window import StartOutsideWindowError, starting_point
from service.dynamics.reduction.windows import REDUCTION_BITS, choose_window, find_windows
from tests.support.planar import body, formula

NORTH_ONLY = "(3*g1^2+g3^2)*(g2-0.5)*(g2-0.7)"
"""A = 3: s² ∝ −(g2 − 1/2)(g2 − 7/10), rest points at these two g2 only."""


def start(text: str, A: int, C: int, **asked: object):
    rigid_body = body(A, C)
    motion = PlanarMotion(Fraction(1), **asked)
    with ctx.workprec(REDUCTION_BITS):
        window = choose_window(find_windows(rigid_body, formula(text, rigid_body), motion), motion)
        found = starting_point(window, motion)
        sine, cosine = found.v.sin_cos()
        if sine.contains(0) or cosine.contains(0):
            return found, None
        return found, found.arc.loop.point_from(sine, cosine)


def test_the_equator_with_its_direction():
    # dv/dt = c C s sin v.
    for s_sign in (1, -1):
        for g3_sign in (1, -1):
            found, _ = start("-g1", 2, 1, g3_sign=g3_sign, start=StartAtEquator(s_sign))
            assert float(found.v.sin()) == pytest.approx(g3_sign, abs=1e-15)
            assert found.direction == s_sign * g3_sign


def test_an_equator_that_is_not_reached_is_refused_with_the_reach():
    with pytest.raises(StartOutsideWindowError, match=r"g2 lies in \[0.5, 0.7\]"):
        start(NORTH_ONLY, 3, 1, start=StartAtEquator())


def test_rest_without_a_wish_is_at_the_larger_g1():
    found, at = start(NORTH_ONLY, 3, 1)
    assert found.direction == 0
    assert float(at.g2) == pytest.approx(0.5, abs=1e-15)


def test_a_hemisphere_without_rest_points_is_refused():
    with pytest.raises(StartOutsideWindowError, match="g2 of sign -1"):
        start(NORTH_ONLY, 3, 1, start=StartAtRest(-1))
    with pytest.raises(StartOutsideWindowError, match="no rest point"):
        start("-g1", 2, 1, start=StartAtRest(1))


@pytest.mark.parametrize(("A", "C", "text"), [(2, 1, "-g1"), (1, 2, "-g3")])
@pytest.mark.parametrize("s_sign", [1, -1])
@pytest.mark.parametrize("g2_sign", [1, -1])
def test_a_point_is_where_it_was_asked(A, C, text, s_sign, g2_sign):
    found, at = start(text, A, C, start=StartAtPoint(Fraction(1, 4), g2_sign, s_sign))
    g1 = at.g3 if found.arc.loop.mirrored else at.g1
    assert float(g1) == pytest.approx(0.25, abs=1e-16)
    assert math.copysign(1.0, float(at.g2)) == g2_sign
    assert found.direction == s_sign


@pytest.mark.parametrize("g1", [Fraction(-1, 4), Fraction(9, 10), Fraction(0), Fraction(2)])
def test_a_point_that_the_window_does_not_have_is_refused(g1):
    with pytest.raises(StartOutsideWindowError, match="not inside the window"):
        start("-g1", 2, 1, start=StartAtPoint(g1))


def test_a_point_behind_a_pole_is_found_on_the_unrolled_arc():
    found, at = start("-g1 + 1.2*(g1^2-g2^2)", 2, 1, g3_sign=-1, start=StartAtPoint(Fraction(1, 5), -1, 1))
    assert found.arc.lower < found.v
    assert found.v < found.arc.upper
    assert (float(at.g2), float(at.g3)) < (0.0, 0.0)
