"""Golden motions by Taylor integration of the six equations, from a start that the literature gives."""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any  # numbers of mpmath and series of python-flint have no types

from flint import arb, ctx
from mpmath import mp, mpf

from tests.support.taylor import BITS, Equations, State, ball, crossing, float_of, integrate, state_at

ORDERS = (80, 95)
AGREEMENT = arb(10) ** -64
"""The motion returns to its start, q and energy stay within it; else two orders agree."""

TIMES = tuple(Fraction(each) for each in ("0", "1", "7/2", "10", "1000"))
P, G2 = 0, 4

Formula = Callable[[Any, Any, Any], Any]


@dataclass(frozen=True)
class Planar:
    """A potential with its gradient, both written by hand, and the curve |g3| = lambda |g1|^(C/A).

    ``rest`` is the rest point at which the motion starts, as a guess of
    (g1, sign of g2); without one it starts at the equator with s > 0.
    """

    A: Fraction
    C: Fraction
    power_of_lambda: tuple[Fraction, int]
    """(number, k): lambda^k is the number; nu is lambda squared."""
    V: Formula
    gradient: Formula
    rest: tuple[str, int] | None = None
    is_periodic: bool = True
    times: tuple[Fraction, ...] = TIMES

    def number(self, value: Fraction) -> mpf:
        return mpf(value.numerator) / value.denominator

    def g3(self, g1: mpf) -> mpf:
        value, k = self.power_of_lambda
        return self.number(value) ** (mpf(1) / k) * g1 ** (self.number(self.C) / self.number(self.A))

    def start(self) -> tuple[list[mpf], mpf]:
        """Return p, q, r, g1, g2, g3 and the energy, by equation (1) of theory.md, section 1."""
        A, C = self.number(self.A), self.number(self.C)
        if self.rest is None:
            g1 = mp.findroot(lambda x: x * x + self.g3(x) ** 2 - 1, mpf("0.6"))
            g2, g3 = mpf(0), self.g3(g1)
        else:
            guess, sign = self.rest
            g1 = mp.findroot(lambda x: self._D(x, sign), mpf(guess))
            g2, g3 = sign * self._height(g1), self.g3(g1)
        V1, _, V3 = self.gradient(g1, g2, g3)
        D = g1 * V3 - g3 * V1
        s = mpf(0) if self.rest else mp.sqrt(D / ((A - C) * A * C * g1 * g3))
        Q = A * g1**2 + C * g3**2
        energy = self.V(g1, g2, g3) + Q * D / (2 * (A - C) * g1 * g3)
        return [-C * g3 * s, mpf(0), A * g1 * s, g1, g2, g3], energy

    def _height(self, g1: mpf) -> mpf:
        return mp.sqrt(1 - g1**2 - self.g3(g1) ** 2)

    def _D(self, g1: mpf, sign: int) -> mpf:
        V1, _, V3 = self.gradient(g1, sign * self._height(g1), self.g3(g1))
        return g1 * V3 - self.g3(g1) * V1


@dataclass(frozen=True)
class AnyState:
    """A motion of the six equations from a given state."""

    moments: tuple[Fraction, Fraction, Fraction]
    V: Formula
    gradient: Formula
    state: tuple[Fraction, ...]
    times: tuple[Fraction, ...]


@dataclass(frozen=True)
class Found:
    period: arb | None
    energy: arb
    states: dict[Fraction, State]


def taylor(motion: Planar | AnyState) -> Found:
    """Return the numbers of the motion; AssertionError if they are not right to ``AGREEMENT``."""
    with ctx.workprec(BITS), mp.workprec(BITS):
        found = _integrated(motion, ORDERS[0])
        if found.period is None:
            other = _integrated(motion, ORDERS[1])
            for t, state in found.states.items():
                assert _distance(state, other.states[t]) < AGREEMENT, (t, state)
        return found


def _integrated(motion: Planar | AnyState, order: int) -> Found:
    if isinstance(motion, AnyState):
        moments, state = motion.moments, [ball(each) for each in motion.state]
        expected = None
    else:
        # The second moment does nothing while q = 0.
        moments = (motion.A, (motion.A + motion.C) / 2, motion.C)
        numbers, energy = motion.start()
        state, expected = [_arb(each) for each in numbers], _arb(energy)
    equations = Equations(moments, motion.gradient, order)
    start = _energy(motion, moments, state)
    assert expected is None or abs(start - expected) < AGREEMENT
    if isinstance(motion, Planar) and motion.is_periodic:
        section = G2 if motion.rest is None else P
        slope = equations.step(arb(0), state).coefficients[section][1]
        sign = 1 if slope > 0 else -1
        steps = integrate(
            equations,
            state,
            lambda step, end: (
                bool(sign * step.coefficients[section][0] < 0 and sign * end[section] > 0)
                and bool(step.start > 0)
            ),
        )
        period = crossing(steps[-1], section)
        assert _distance(state_at(steps, period), state) < AGREEMENT
        places = {t: ball(t) - period * (ball(t) / period).floor() for t in motion.times}
    else:
        last = ball(max(motion.times))
        steps = integrate(equations, state, lambda step, _: bool(step.start + step.length > last))
        period, places = None, {t: ball(t) for t in motion.times}
    states = {t: state_at(steps, place) for t, place in places.items()}
    for each in states.values():
        assert abs(_energy(motion, moments, each) - start) < AGREEMENT
        assert isinstance(motion, AnyState) or abs(each[1]) < AGREEMENT
    return Found(period, start, states)


def _energy(motion: Planar | AnyState, moments: tuple[Fraction, ...], state: State) -> arb:
    A, B, C = (ball(each) for each in moments)
    p, q, r, *g = state
    return (A * p * p + B * q * q + C * r * r) / 2 + motion.V(*g)


def _distance(one: State, other: State) -> arb:
    return max((abs(a - b) for a, b in zip(one, other, strict=True)), key=float_of)


def _arb(value: mpf) -> arb:
    return arb(mp.nstr(value, 95))
