"""Integrals over a function of the curve with kinks are enclosed from one kink to the next."""

from fractions import Fraction
from itertools import pairwise

import pytest
from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.potentials.angular_part import balls as angular_ball
from service.dynamics.potentials.angular_part.balls import CurveFunction, curve_pieces

PLACES = [("0.4", "0.6"), ("0.7", "0.1"), ("0.05", "0.9"), ("-0.3", "0.5")]


def tape_of(text):
    return compile_tape(parse(text), ("w",))


def V1(text, alpha, place, order=1):
    body = RigidBody(Fraction(alpha), None, Fraction(1))
    g1, g3 = map(arb, place)
    return angular_ball.angular_balls(body, CurveFunction(tape_of(text)), order, g1, g3, arb.pi() / 4)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("alpha", ["2", "17/10", "3/5"])
@pytest.mark.parametrize("text", ["abs(w - 1/2)", "exp(-w)*abs(w - 1/3)", "abs(log(w)) + abs(2*w - 3)"])
def test_the_enclosure_in_pieces_meets_the_one_of_the_whole_and_is_no_wider(monkeypatch, text, alpha):
    with ctx.workprec(96):
        in_pieces = [V1(text, alpha, place) for place in PLACES]
        monkeypatch.setattr(angular_ball, "curve_pieces", lambda _: ())
        whole = [V1(text, alpha, place) for place in PLACES]
        for one, other in zip(in_pieces, whole, strict=True):
            for x, y in zip(one, other, strict=True):
                assert x.overlaps(y)
                # The other integrator stops at the same tolerance: no wider than some of its widths.
                assert x.rad() <= 8 * y.rad() + arb(2) ** -90


def test_an_absolute_value_is_the_function_or_its_negative_where_it_has_one_sign():
    # So near to the pole w is below 1/2 on the whole way from the direction phi0 = pi/4.
    with ctx.workprec(128):
        for place, sign in ((("0.1", "0.1"), -1), (("0.2", "0.15"), -1)):
            (kinked,) = V1("abs(w - 1/2)", 2, place, order=0)
            (smooth,) = V1("w - 1/2", 2, place, order=0)
            assert (kinked - sign * smooth).contains(0)


def test_a_kink_costs_no_more_than_some_evaluations(monkeypatch):
    calls, real_call = [], angular_ball._Path.__call__

    def counted(self, y, analytic):
        calls.append(y)
        return real_call(self, y, analytic)

    monkeypatch.setattr(angular_ball._Path, "__call__", counted)
    with ctx.workprec(192):
        V1("(w - 1/2)*exp(w)", 2, ("0.4", "0.6"), order=0)
        smooth = len(calls)
        calls.clear()
        V1("abs(w - 1/2)*exp(w)", 2, ("0.4", "0.6"), order=0)
    # Two pieces for one; an integrator that halves its way to the kink needs 40 times as many.
    assert len(calls) < 5 * smooth


@pytest.mark.parametrize(("text", "kinks"), [("abs(w-1/2)", 1), ("abs(w-1)*abs(w-2)", 2), ("abs(w+1)", 0)])
def test_every_kink_is_between_two_pieces(text, kinks):
    with ctx.workprec(80):
        pieces = curve_pieces(tape_of(text))
        assert sum(piece.has_kink for piece in pieces) == kinks
        for one, other in pairwise(pieces):
            assert one.upper == other.lower
            assert one.has_kink != other.has_kink


def test_functions_with_very_many_kinks_are_left_whole():
    with ctx.workprec(80):
        assert curve_pieces(tape_of("abs(sin(w))")) == ()
