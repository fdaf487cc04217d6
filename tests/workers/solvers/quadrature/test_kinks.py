"""Panels that end at kinks have the periods of panels that shrink to them, and there are few of them."""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import pytest
from flint import acb, arb, ctx

from service.dynamics.formula.algebras.ball import BallAlgebra, ComplexBallAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.rewriting import with_sides
from service.dynamics.formula.tape import compile_tape
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.window import starting_point
from service.dynamics.reduction.windows import find_windows
from tests.support.planar import body, formula
from workers.solvers.orbits.orbit import make_orbit
from workers.solvers.quadrature.panel import BranchedSpeed
from workers.solvers.quadrature.squared_speed import (
    branches,
    phase_speed,
    time_map_of,
    with_absolute_values,
)
from workers.solvers.quadrature.time_map import make_time_map

BODY = body(2, 1)
MOTION = PlanarMotion(Fraction(1))


def orbit_of(text: str):
    (window,) = find_windows(BODY, formula(text, BODY), MOTION)
    return make_orbit(starting_point(window, MOTION))


def exact(period) -> arb:
    return arb(period.hi) + arb(period.lo)


KINKS = ["abs(g2-3/10)/5", "sqrt((g2+1/7)^2)/10", "(abs(g2-3/4)+(g2-3/4))^2/3", "exp(-abs(g2-1/5)*100)/9"]


@pytest.mark.one_in(2)
@pytest.mark.parametrize("text", KINKS)
def test_periods_are_those_without_the_cuts(text: str) -> None:
    with ctx.workprec(160):
        orbit = orbit_of(f"-g1 + (2*g1^2+g3^2)*({text})")
        speed = phase_speed(orbit)
        assert isinstance(speed, BranchedSpeed)
        # V itself on all of the way, kinks and all.
        whole = replace(
            speed.parts[0][2],
            radicand=replace(
                speed.parts[0][2].radicand,
                **{
                    side: replace(getattr(speed.parts[0][2].radicand, side), tape=orbit.loop.potential.tape)
                    for side in ("northern", "southern", "both")
                },
            ),
        )
        slow = make_time_map(orbit.rate, orbit.corners, is_even=orbit.is_even, speed=whole)
        fast = time_map_of(orbit)
        gap = abs(exact(slow.period) - exact(fast.period))
        # lo is rounded to 2^-53 of a number that is at most 2^-53 of the period.
        assert gap < slow.period.error + fast.period.error + fast.period.hi * 2.0**-104
    assert fast.period.error <= 1e-15 * fast.period.hi
    assert len(fast.edges) < len(slow.edges) / 3
    assert len(fast.kinks) >= 2


def test_steps_are_as_cheap_on_both_sides() -> None:
    """Panels shrink geometrically towards a step; where exp is large they do not shrink for it."""
    counts = []
    for exponent in (2, 4, 6):
        with ctx.workprec(160):
            orbit = orbit_of(f"-g1 + (2*g1^2+g3^2)/(9 + exp(-(g2-3/10)*10^{exponent}))")
            counts.append(len(time_map_of(orbit).edges))
    # log2(10) halvings for each factor 10, on both sides of two passages.
    assert max(b - a for a, b in pairwise(counts)) <= 2 * 4 * 3.4


def test_a_branch_has_the_values_of_v_where_it_holds() -> None:
    tape = compile_tape(parse("abs(g2-3/10)*g1 + sqrt((g2+1/2)^2) + g3/(2+exp(7*g2))"))

    def places(left: float, right: float) -> tuple[arb, arb, arb]:
        return arb("0.4"), arb((left + right) / 2, (right - left) / 2), arb("0.7")

    found = branches(tape, places, (), 1.0)
    assert [branch.is_kink for branch in found].count(True) == 1
    assert found[0].left == 0.0
    assert found[-1].right == 1.0
    for branch in found:
        g2 = (branch.left + branch.right) / 2
        values = [t.evaluate(BallAlgebra(), places(g2, g2)) for t in (branch.tape, tape)]
        assert values[0].overlaps(values[1])
        # Both are rounded a few times in 53 bits.
        assert values[0].rad() + values[1].rad() < 1e-13


def test_roots_of_even_powers_are_absolute_values() -> None:
    text = "sqrt(g1^2) + (g2^4)^(3/4) + (g3*g3)^(-1/2) + (g1^3)^(1/2)"
    plain = with_absolute_values(compile_tape(parse(text)))
    calls = [made.name for made in plain.instructions if made.operation == "call"]
    assert calls == ["abs", "abs", "abs"]
    place = arb("0.4"), arb("-0.7"), arb("0.3")
    value = plain.evaluate(BallAlgebra(), place)
    expected = arb("0.4") + arb("0.7") ** 3 + 1 / arb("0.3") + arb("0.4") ** 1.5
    assert value.overlaps(expected)


def test_a_decaying_quotient_is_enclosed_where_a_growing_one_is_not() -> None:
    tape = compile_tape(parse("g1/(3+exp(g2))"))
    decaying = with_sides(tape, {}, {1})
    wide = acb(1), acb(arb(30, 5), arb(0, 10)), acb(0)
    algebra = ComplexBallAlgebra(analytic=True)
    assert not tape.evaluate(algebra, wide).is_finite()
    # |exp(−x)| ≤ e^-25 there.
    assert abs(decaying.evaluate(algebra, wide)) < 3e-11
    narrow = acb(1), acb("1.7"), acb(0)
    assert decaying.evaluate(algebra, narrow).overlaps(tape.evaluate(algebra, narrow))
