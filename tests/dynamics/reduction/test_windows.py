import math
from fractions import Fraction

import pytest
from flint import arb, ctx
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from service.dynamics.errors import EqualMomentsError
from service.dynamics.potentials.families.coefficients import rational_potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import NuNeedsDoubleMomentError
from service.dynamics.reduction.window import Window
from service.dynamics.reduction.windows import (
    NoMotionError,
    NoSuchWindowError,
    SeveralWindowsError,
    choose_window,
    find_windows,
)
from tests.support.effort import examples
from tests.support.planar import body, formula

DOUBLE = body(2, 1)


def windows(text: str, motion: PlanarMotion, A: int | str = 2, C: int | str = 1) -> tuple[Window, ...]:
    rigid_body = body(A, C)
    return find_windows(rigid_body, formula(text, rigid_body), motion)


def by_nu(nu: str | int, g3_sign: int = 1) -> PlanarMotion:
    return PlanarMotion(None, nu=Fraction(nu), g3_sign=1 if g3_sign > 0 else -1)


NU_1 = by_nu(1)
GOLDEN = (math.sqrt(5) - 1) / 2  # x at the equator: 1 - x² - x = 0


@pytest.mark.parametrize(
    ("text", "ends", "g1"),
    [
        ("-g1", ("pole", "equator"), (0.0, GOLDEN)),
        # Zeros of P(x) = 2 b1 + nu² a1 x + 2 nu² c1 x² where they lie inside (0, x1).
        ("-g1 + 1/(20*g3^2)", ("rest", "equator"), (0.1, GOLDEN)),
        ("-g1 + 1.2*(g1^2 - g2^2)", ("pole", "rest"), (0.0, 1 / 2.4)),
        (
            "-g1 + 1/(50*g3^2) + 1.2*(g1^2 - g2^2)",
            ("rest", "rest"),
            ((1 - math.sqrt(1 - 16 * 0.02 * 1.2)) / 4.8, (1 + math.sqrt(1 - 16 * 0.02 * 1.2)) / 4.8),
        ),
    ],
)
def test_the_four_types_of_the_elliptic_case_end_where_its_quadratic_vanishes(text, ends, g1):
    (window,) = windows(text, NU_1)
    assert (window.kind, window.ends) == ("periodic", ends)
    # Both sides are one rounding of the same number.
    assert window.g1 == pytest.approx(g1, abs=4e-16)


@given(
    a1=st.fractions(-4, 4, max_denominator=50),
    b1=st.fractions(Fraction(1, 1000), 2, max_denominator=1000),
    c1=st.fractions(-4, 4, max_denominator=50),
    nu=st.fractions(Fraction(1, 4), 4, max_denominator=20),
)
@settings(max_examples=examples(10, 60), deadline=None)
def test_rest_points_are_the_roots_of_the_elliptic_quadratic(a1, b1, c1, nu):
    text = f"({a1})*g1 + ({b1})/g3^2 + ({c1})*(g1^2 - g2^2)"
    x1 = 2 / (nu + math.sqrt(nu * nu + 4))
    linear, square = float(nu**2 * a1), float(2 * nu**2 * c1)
    discriminant = linear**2 - 8 * float(b1) * square
    # Within 1e-9 of a double root the comparison in doubles says nothing.
    assume(abs(discriminant) > 1e-9 and (square == 0 or abs(square) > 1e-6))
    roots = []
    if discriminant > 0:
        stable = -0.5 * (linear + math.copysign(math.sqrt(discriminant), linear))
        roots = [2 * float(b1) / stable] if stable else []
        roots += [stable / square] if square else []
    expected = sorted(x for x in roots if 0 < x < x1)
    assume(all(abs(x - x1) > 1e-9 for x in roots))
    found = sorted(
        x for w in windows(text, by_nu(nu)) for x, end in zip(w.g1, w.ends, strict=True) if end == "rest"
    )
    # The quadratic formula loses the digits of the root gap: 1e-16 / 1e-9 at worst, squared root of it.
    assert found == pytest.approx(expected, rel=1e-9)


def test_an_equilibrium_is_recognised_at_a_double_zero_with_no_room_around_it():
    (window,) = windows("-g1 + 1/(20*g3^2) + 5/4*(g1^2 - g2^2)", NU_1)
    assert window.kind == "equilibrium"
    assert window.g1 == pytest.approx((0.2, 0.2), abs=1e-15)


def test_just_below_it_there_is_a_narrow_oscillation_and_just_above_it_nothing():
    assert [w.kind for w in windows("-g1 + 1/(20*g3^2) + 5/4*(1-1e-12)*(g1^2-g2^2)", NU_1)] == ["periodic"]
    assert windows("-g1 + 1/(20*g3^2) + 5/4*(1+1e-12)*(g1^2-g2^2)", NU_1) == ()


def test_two_zeros_closer_than_doubles_can_tell_are_two():
    (window,) = windows("-g1 + 1/(20*g3^2) + 5/4*(1-1e-24)*(g1^2-g2^2)", NU_1)
    # x = (1 ± sqrt(e))/(5 (1 - e)): a gap of 1e-12 around 1/5.
    assert window.kind == "periodic"
    assert window.g1[1] - window.g1[0] == pytest.approx(0.4e-12, rel=1e-3)  # of numbers rounded at 3e-17


def test_the_separatrix_of_the_equator_is_told_from_its_two_neighbours():
    critical = "(1+sqrt(5))/4"
    (window,) = windows(f"-g1 + {critical}*(g1^2-g2^2)", NU_1)
    assert (window.kind, window.ends) == ("separatrix", ("pole", "equilibrium"))
    (below,) = windows(f"-g1 + {critical}*(1-1e-12)*(g1^2-g2^2)", NU_1)
    (above,) = windows(f"-g1 + {critical}*(1+1e-12)*(g1^2-g2^2)", NU_1)
    assert (below.kind, below.ends) == ("periodic", ("pole", "equator"))
    assert (above.kind, above.ends) == ("periodic", ("pole", "rest"))


def test_an_inner_double_zero_separates_collision_from_oscillation():
    kinds = [w.kind for w in windows("g1 - 1/(16*g3^2) - (g1^2-g2^2)", NU_1)]
    assert kinds == ["collision", "separatrix"]
    kinds = [w.kind for w in windows("g1 - (1-1e-8)/(16*g3^2) - (g1^2-g2^2)", NU_1)]
    assert kinds == ["collision", "periodic"]
    assert [w.kind for w in windows("g1 - (1+1e-8)/(16*g3^2) - (g1^2-g2^2)", NU_1)] == ["collision"]


def test_a_pole_that_is_approached_for_ever_is_told():
    assert [w.kind for w in windows("-(g1^2-g2^2)", NU_1)] == ["pole"]
    assert [w.kind for w in windows("(3*g1^2+g3^2)*(-1-g2/3)", PlanarMotion(Fraction(1)), A=3)] == ["pole"]


def test_a_pole_where_the_energy_would_jump_is_not_passed():
    """F differs with the sign of g3, so that p² at the pole would: no motion with q = 0 goes on there."""
    text = "-abs(g1)^(4/3)*(3 + g3/abs(g3))/2"
    assert [w.kind for w in windows(text, PlanarMotion(Fraction(1)), A=3)] == ["pole"]
    assert [w.kind for w in windows("-abs(g1)^(4/3)", PlanarMotion(Fraction(1)), A=3)] == ["periodic"]


def test_a_formula_that_writes_g1_by_the_others_has_the_same_window():
    """On the sphere 1 − g2² − g3² is g1²: at a pole its digits cancel to nothing."""
    (plain,) = windows("-abs(g1)", NU_1)
    (cancelling,) = windows("-sqrt(1-g2^2-g3^2)", NU_1)
    assert (cancelling.kind, cancelling.ends) == (plain.kind, plain.ends) == ("periodic", ("pole", "equator"))
    assert cancelling.g1 == plain.g1


def test_attraction_to_a_pole_is_a_collision():
    assert [w.kind for w in windows("-g1 - 1/(20*g3^2) - (g1^2-g2^2)/2", NU_1)] == ["collision"]


def test_no_motion_is_no_window():
    found = windows("g1", NU_1)
    assert found == ()
    with pytest.raises(NoMotionError, match="negative on the whole curve"):
        choose_window(found, NU_1)


@pytest.mark.parametrize("text", ["0", "7", "g1^2 + g2^2 + g3^2", "sin(g1)^2 + cos(g1)^2"])
def test_a_potential_that_is_constant_on_the_sphere_moves_nothing(text):
    assert windows(text, NU_1) == ()


def test_the_sign_of_g1_turns_the_force_round():
    (window,) = windows("g1", by_nu("-13/10"))
    assert window.g1 == pytest.approx((0.0, -2 / (1.3 + math.sqrt(1.3**2 + 4))), abs=4e-16)


def test_two_windows_are_numbered_by_their_largest_g1():
    text = "(2*g1^2+g3^2)*((g2^2-0.2)*(g2^2-0.4)*(g2^2-0.6)*(g2^2-0.8))"
    found = windows(text, NU_1)
    assert [w.index for w in found] == [0, 1]
    assert all(w.kind == "periodic" and len(w.arcs) == 2 for w in found)
    # s² = −2G/(AC): motion where G < 0, that is g2² between 0.2 and 0.4 or 0.6 and 0.8.
    assert found[0].g2 == pytest.approx((math.sqrt(0.6), math.sqrt(0.8)), abs=1e-15)
    assert found[1].g2 == pytest.approx((math.sqrt(0.2), math.sqrt(0.4)), abs=1e-15)
    with pytest.raises(SeveralWindowsError, match="2 admissible windows") as caught:
        choose_window(found, NU_1)
    assert caught.value.windows == found
    assert choose_window(found, PlanarMotion(Fraction(1), window=1)) is found[1]
    with pytest.raises(NoSuchWindowError, match="accepted are 0 to 1"):
        choose_window(found, PlanarMotion(Fraction(1), window=2))


def test_windows_of_the_two_hemispheres_differ_if_G_is_not_even():
    text = "(3*g1^2+g3^2)*((g2-0.5)*(g2-0.7)*(g2+0.4)*(g2+0.8))"
    found = windows(text, PlanarMotion(Fraction(4, 5)), A=3)
    assert [len(w.arcs) for w in found] == [1, 1]
    assert found[0].g2 == pytest.approx((0.5, 0.7), abs=1e-15)
    assert found[1].g2 == pytest.approx((-0.8, -0.4), abs=1e-15)


@given(
    lambda_=st.fractions(Fraction(1, 3), 3, max_denominator=30), alpha=st.sampled_from(["3", "17/10", "5/2"])
)
@settings(max_examples=examples(7, 20), deadline=None)
def test_the_mirrored_body_has_the_mirrored_windows(lambda_, alpha):
    text, mirrored = "(%s*g1^2 + g3^2)*(g2^2-1/2+g2^3/5)", "(%s*g3^2 + g1^2)*(g2^2-1/2+g2^3/5)"
    straight = windows(text % alpha, PlanarMotion(lambda_), A=alpha)
    other = Fraction(float(lambda_) ** -float(Fraction(alpha)))
    turned = windows(mirrored % alpha, PlanarMotion(other), A=1, C=alpha)
    assert [w.ends for w in straight] == [w.ends for w in turned]
    for one, two in zip(straight, turned, strict=True):
        # λ' = λ^(−A/C) is rounded to a double, which moves the ends by a few ulp.
        assert one.g2 == pytest.approx(two.g2, abs=1e-14)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("n", [8, 12, 16, 20])
def test_high_terms_whose_doubles_underflow_and_cancel(n):
    """V = −U_n: near the poles g3^(4n−4) underflows, elsewhere terms of size 1e10 cancel."""
    potential = rational_potential([Fraction(0)] * (n - 1) + [Fraction(-1)], [], [])
    (window,) = find_windows(DOUBLE, potential, NU_1)
    assert (window.kind, window.ends) == ("periodic", ("rest", "equator"))
    # H[U_n] = (n − 3/2) ν^(2n−1), and p² has the sign of h − V.
    h = -(n - arb(3) / 2)
    (arc,) = window.arcs
    with ctx.workprec(256):
        for v in (arc.lower, arc.upper):
            at = arc.loop.refined().point(v)
            # At a rest point V = h: the end is known to 160 bits, and V' is below 1e10.
            assert abs(potential.value_ball(at.g1, at.g2, at.g3) - h) < 1e-30
        for share in range(1, 40):
            v = arb.pi() * share / 80
            at = arc.loop.refined().point(v)
            assert (potential.value_ball(at.g1, at.g2, at.g3) < h) == (arc.lower < v and v < arc.upper)


def test_a_corner_of_the_potential_hides_no_zero():
    """G(g2) = |g2 − 1/3| − 1/5 < 0 for 2/15 < g2 < 8/15, with a corner in between."""
    (window,) = windows("(3*g1^2+g3^2)*(abs(g2-1/3)-1/5)", PlanarMotion(Fraction(1)), A=3)
    assert window.g2 == pytest.approx((2 / 15, 8 / 15), abs=1e-15)


def test_an_arc_may_come_round_to_the_one_pole_that_attracts():
    """−Q/(1 + g2)² diverges at the south pole; the north pole is passed, and nothing else stops it."""
    (window,) = windows("-g1 - (2*g1^2+g3^2)/(1+g2)^2", NU_1)
    assert (window.kind, window.ends, window.g2) == ("collision", ("pole", "equator"), (-1.0, 1.0))


def test_where_the_potential_is_not_defined_there_is_no_window():
    found = windows("(3*g1^2+g3^2)*(1/2-sqrt(g2-1/2))", PlanarMotion(Fraction(1)), A=3)
    # sqrt(g2 − 1/2) > 1/2 means g2 > 3/4; there s² stays finite at the pole.
    assert [(w.kind, w.g2[0]) for w in found] == [("pole", pytest.approx(0.75, abs=1e-15))]


def test_a_potential_defined_only_near_a_pole_is_not_taken_for_a_constant():
    (window,) = windows("(3*g1^2+g3^2)*(1/10-sqrt(g2-9/10))", PlanarMotion(Fraction(1)), A=3)
    # Motion where sqrt(g2 − 9/10) > 1/10, up to the pole, where s² stays finite; the rest point lies
    # next to the edge of the domain.
    assert (window.kind, window.ends) == ("pole", ("pole", "rest"))
    assert window.g2 == pytest.approx((0.91, 1.0), abs=1e-15)


def test_a_motion_that_leaves_the_domain_of_the_potential_is_told_so():
    (window,) = windows("(3*g1^2+g3^2)*(sqrt(g2+1/2)-2)", PlanarMotion(Fraction(1)), A=3)
    assert (window.kind, window.ends) == ("edge", ("pole", "equator"))
    assert window.g2 == pytest.approx((-0.5, 1.0), abs=1e-15)


def test_equal_moments_have_no_curve():
    with pytest.raises(EqualMomentsError):
        windows("-g1", PlanarMotion(Fraction(1)), A=1)


def test_nu_is_for_double_moments_only():
    with pytest.raises(NuNeedsDoubleMomentError):
        windows("-g1", NU_1, A=3)


TWINS = "-g1 + 1.2*(g1^2 - g2^2)"
"""On both hemispheres a window from a pole to g1 = 1/2.4."""


def test_windows_with_the_same_ends_are_mirror_images_only_if_v_is_even_in_g2():
    (both,) = windows(TWINS, NU_1)
    assert len(both.arcs) == 2
    # Far from the ends: what it changes is the motion between them, on one side alone.
    bump = "(2*g1^2 + g3^2)*exp(-10^8*(g2 - 9/10)^2)/1000"
    one, other = windows(f"{TWINS} + {bump}", NU_1)
    assert (one.ends, len(one.arcs), len(other.arcs)) == (other.ends, 1, 1)
    assert one.g1 == pytest.approx(other.g1, abs=1e-15)


@pytest.mark.parametrize("factor", ["(g2 - 1/3)*(g2 + 1/3)", "cos(3*g2)", "abs(g2)", "((1 - g2)^2 + 2*g2)"])
def test_a_v_that_is_even_though_not_as_it_is_written_has_mirror_images(factor):
    (both,) = windows(f"{TWINS} + (2*g1^2 + g3^2)*{factor}/1000", NU_1)
    assert len(both.arcs) == 2
