"""A motion of an undecided potential is proved on its own arc, refuted there, or refused."""

from fractions import Fraction
from itertools import pairwise

import pytest
from flint import arb, ctx

from service.dynamics.equations.compatibility import residual_ball
from service.dynamics.potentials.families.written import expression_potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.window import starting_point
from service.dynamics.reduction.windows import REDUCTION_BITS, choose_window, find_windows
from service.dynamics.verdict.own_curve import (
    InadmissibleMotionError,
    UndecidedMotionError,
    cells_of,
    place_on,
    require_proof_on_arc,
)
from tests.dynamics.verdict.formulas import body, verdict_on

WELL = "-g1 + 1/(20*g3^2)"
"""nu = 1: from rest at g1 = 0.1 through the equator; g2² ≤ 0.89."""
HIDDEN = "exp(-10000)"
"""Below what 4096 bits tell from 0."""
NU_1 = PlanarMotion(None, nu=Fraction(1))


def arc_of(text, motion=NU_1, on=None):
    on = on or body(2)
    V = expression_potential(text, {}, on)
    window = choose_window(find_windows(on, V, motion), motion)
    return V, starting_point(window, motion).arc


def require(text, motion=NU_1, on=None):
    on = on or body(2)
    with ctx.workprec(REDUCTION_BITS):
        V, arc = arc_of(text, motion, on)
        require_proof_on_arc(on, V, motion, arc, lambda: False)


@pytest.mark.parametrize(
    "term",
    [
        "(abs(g2 - 99/100) + g2 - 99/100)^3*g1*g3",  # a cap that it does not enter
        "(abs(g1 - 1/20) - g1 + 1/20)^3*g2*g3",
        "(abs(g1 + 1/20) - g1 - 1/20)^3*g2*g3",
        "(g3^2 - g1)^3*g2",  # zero on the curve nu = 1, with two derivatives
    ],
)
def test_a_motion_that_meets_no_doubtful_piece_is_proved(term):
    text = f"{WELL} + {HIDDEN}*{term}"
    assert verdict_on(text).verdict == "undecided"
    require(text)


@pytest.mark.parametrize(
    "term",
    [
        "(abs(g2 - 9/10) + g2 - 9/10)^3*g1*g3",  # entered: g2 reaches 0.943
        "(g3^2 - g1)*g2",  # its derivatives are not zero there
        "(g3^2 - 2*g1)^3*g2",  # zero on another curve
        "abs(g2 - g1 + 1/10)",
    ],
)
def test_a_motion_that_meets_one_is_refused(term):
    text = f"{WELL} + {HIDDEN}*{term}"
    with pytest.raises((UndecidedMotionError, InadmissibleMotionError)):
        require(text)


def test_a_bump_on_the_curve_refutes_with_a_point_of_it():
    # Of the 48 points none sees it; of those on the curve the nearest are within its reach.
    text = f"{WELL} + g1*g3*exp(-10^7*(g2 - 3101/10000)^2)"
    with pytest.raises(InadmissibleMotionError) as caught:
        require(text)
    error = caught.value
    assert error.residual.excludes_zero
    g1, g2, g3 = map(Fraction, error.g)
    # On the curve and near the bump; squares of numbers up to 1 that are known to the radius.
    assert abs(g3**2 - g1) < 4 * Fraction(error.radius)
    assert abs(g2 - Fraction(3101, 10000)) < Fraction(1, 100)


@pytest.mark.parametrize(
    ("text", "motion", "on"),
    [
        ("-g1", NU_1, body(2)),
        ("g1", PlanarMotion(Fraction(3, 2), g1_sign=-1, g3_sign=-1), body(2)),
        ("-g3", PlanarMotion(Fraction(3, 2)), body(1, 2)),
        (WELL, NU_1, body(2)),
        ("(3*g1^2 + g3^2)*(g2^2 - 1/2 + g2^3/5)", PlanarMotion(Fraction(4, 5)), body(3)),
    ],
)
def test_the_cells_cover_the_arc_and_hold_what_is_in_them(text, motion, on):
    with ctx.workprec(REDUCTION_BITS):
        _, arc = arc_of(text, motion, on)
        cells = list(cells_of(arc))
        assert cells[0].lower.overlaps(arc.lower)
        assert cells[-1].upper.overlaps(arc.upper)
        for one, other in pairwise(cells):
            assert one.upper.overlaps(other.lower)
        for cell in cells:
            for share in (Fraction(1, 7), Fraction(1, 2), Fraction(8, 9)):
                v = cell.lower + (cell.upper - cell.lower) * arb(share.numerator) / share.denominator
                there = place_on(arc.loop, v)
                assert all(inside.overlaps(bound) for inside, bound in zip(there, cell.g, strict=True))
                assert [1 if x > 0 else -1 for x in there] == list(cell.octant)


def test_a_proved_potential_is_proved_on_every_curve_too():
    for text in ("-g1", WELL, "-g1 + (2*g1^2 + g3^2)*abs(g2 - 1/3)"):
        require(text)


def test_a_kink_that_the_curve_crosses_is_not_passed_over():
    # Both sides are admissible, the energy jumps on g1 = g3, which nu = 1/2 crosses at g1 = 1/2.
    U = "(g1 - (2*g1^2 + g3^2)/(3/2*sqrt(2)*sqrt(g1^2 + g3^2)))"
    motion = PlanarMotion(None, nu=Fraction(1, 2))
    with pytest.raises((UndecidedMotionError, InadmissibleMotionError)):
        require(f"-3*g1 - abs{U}/10000", motion)


def test_when_it_is_late_nothing_is_proved():
    with ctx.workprec(REDUCTION_BITS):
        V, arc = arc_of("-g1")
        with pytest.raises(UndecidedMotionError):
            require_proof_on_arc(body(2), V, NU_1, arc, lambda: True)


def test_the_residual_of_a_refuted_motion_is_that_of_the_potential_there():
    text = f"{WELL} + g1*g3/1000"
    on = body(2)
    with pytest.raises(InadmissibleMotionError) as caught:
        require(text)
    error = caught.value
    V = expression_potential(text, {}, on)
    point = [Fraction(x) for x in error.g]
    with ctx.workprec(300):
        there = residual_ball(on, V.tape, point).residual
        told = arb(error.residual.mid, error.residual.rad)
        # The point that is told is a rounding of the one on the curve: some 1e-20.
        assert abs(there - told) < 1e-15
