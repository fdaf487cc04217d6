"""The coordinate at a pole: the curve, its slope, and which root of |sin v| a potential asks for."""

from dataclasses import replace
from fractions import Fraction

import pytest
from flint import acb, arb, ctx

from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import make_loop
from tests.support.effort import each_once
from tests.support.planar import body, formula
from workers.solvers.certified.by_integral import IntegralMotion, integral_motion, periodic_window
from workers.solvers.certified.way import way_of
from workers.solvers.complex_plane.complex_loop import ComplexLoop, Passage, unit_at_poles


def passage(A: str, text: str, pole: int, way: int, unit: int) -> Passage:
    rigid_body = body(A, 1)
    potential = formula(text, rigid_body)
    loop = make_loop(rigid_body, potential, PlanarMotion(Fraction(6, 5)))
    side = way if pole % 2 == 0 else -way
    return Passage(ComplexLoop(loop, potential.tape, arb(1), side, unit), pole, way)


@each_once(
    phi=["0.2", "1.1", "1.5"],
    pole__way=[(0, 1), (0, -1), (1, 1), (1, -1), (-1, 1)],
    A__unit=[("7/5", 5), ("3", 1), ("101/100", 100), ("17/4", 12)],
)
def test_the_place_is_that_of_the_angle(A, unit, pole, way, phi):
    with ctx.workprec(256):
        one, step = passage(A, "-g1", pole, way, unit), arb(2) ** -80
        at, slope = one.place(acb(arb(phi)), analytic=True)
        u = 2 * ((arb(phi) / 2).tan() ** unit).atan()
        v = arb.pi() * pole + way * u
        loop = one.curve.loop
        point = loop.point(v)
        g1, g2, g3 = (value.real for value in one.curve.gamma(at))
        for found, expected in ((g1, point.g1), (g2, point.g2), (g3, point.g3), (at.c.real, point.c)):
            assert found.overlaps(expected)
            # Both keep more than half of the bits, next to the pole g1 among them.
            assert found.rel_accuracy_bits() > 128
        before, after = (2 * (((arb(phi) + off) / 2).tan() ** unit).atan() for off in (-step, step))
        # A difference quotient over 2^-79 is off by the square of that.
        assert abs((after - before) / (2 * step) - slope.real) < arb(2) ** -100
        assert one.phase(v).overlaps(arb(phi))


@pytest.mark.parametrize(
    ("A", "text", "unit"),
    [
        ("2", "-g1 + g3^4/g1", 0),
        ("4", "abs(g1)^(3/2)", 0),
        ("3", "abs(g1)^(4/3)", 0),
        ("3", "-g1", 1),
        ("2", "-g1 + (2*g1^2 + g3^2)*sqrt(1 - g2)", 1),
        ("7/5", "-abs(g1)^(4/7)", 5),
        ("7/5", "-abs(g1)^(1/2)", 10),
        ("2", "-abs(g1)^(1/3)", 3),
    ],
)
def test_the_unit_makes_all_powers_whole(A, text, unit):
    rigid_body = body(A, 1)
    potential = formula(text, rigid_body)
    loop = make_loop(rigid_body, potential, PlanarMotion(Fraction(1)))
    assert unit_at_poles(loop, potential.tape) == unit


@pytest.mark.parametrize(
    ("text", "nu", "period", "is_even"),
    [
        # Of the literature's tables in the theory: from pole to rest, and from pole to equator.
        ("-g1 + 6/5*(g1^2 - g2^2)", 1, "6.97000159489442", True),
        ("-g1", "13/10", "6.130431451127", False),
    ],
)
def test_the_way_through_poles_has_the_time_of_one_strip(text, nu, period, is_even):
    rigid_body = body(2, 1)
    potential, motion = formula(text, rigid_body), PlanarMotion(nu=Fraction(nu), lambda_=None)
    with ctx.workprec(128):
        _, start = periodic_window(rigid_body, potential, motion)
        whole = integral_motion(start, 64)
        curve = replace(whole.phase.curve, unit=3)
        ends = (start.arc.lower, start.arc.upper)
        if is_even:
            ends = whole.phase.lower, whole.phase.upper
        pieces = IntegralMotion(way_of(curve, start, ends), start, whole.energy, 64)
        assert pieces.phase.is_even is is_even
        assert whole.period.overlaps(pieces.period)
        # The last digit of the table is rounded.
        assert abs(pieces.period - arb(period)) < arb(10) ** -11
        for t in ("0.4", "2.9", "5.1", "-3.3"):
            for one, other in zip(whole.states([arb(t)])[0], pieces.states([arb(t)])[0], strict=True):
                assert one.overlaps(other)
                assert other.rad() < 1e-15
