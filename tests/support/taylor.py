"""The Euler-Poisson equations by Taylor series with 90 digits: no code of the service is in it.

A step is a series of the six variables (p, q, r, g1, g2, g3) in powers of the
time since its start, found by Picard's iteration, which makes one more
coefficient right each time. Only midpoints are kept: the digits are no
enclosures, they are checked by what uses them (the motion returns after its
period, integrals stay, another order of the series gives the same digits).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

from flint import arb, arb_series, ctx, fmpq

BITS = 300
REST = arb(10) ** -74
"""What the last terms of a series may add to a variable at the end of a step."""

Gradient = Callable[[arb_series, arb_series, arb_series], tuple[object, object, object]]
State = list[arb]


def ball(value: Fraction) -> arb:
    return arb(fmpq(value.numerator, value.denominator))


@dataclass(frozen=True)
class Step:
    """The motion from ``start`` on, for the time ``length``: six lists of coefficients."""

    start: arb
    length: arb
    coefficients: list[list[arb]]

    def state(self, t: arb) -> State:
        return [value_at(each, t - self.start) for each in self.coefficients]


def value_at(coefficients: Sequence[arb], t: arb) -> arb:
    total = arb(0)
    for coefficient in reversed(coefficients):
        total = total * t + coefficient
    return arb(total.mid())


@dataclass(frozen=True)
class Equations:
    """The six equations of one body in one potential."""

    moments: tuple[Fraction, Fraction, Fraction]
    gradient: Gradient
    order: int

    def step(self, start: arb, state: State) -> Step:
        A, B, C = (ball(each) for each in self.moments)
        found = [arb_series([each]) for each in state]
        for order in range(2, self.order + 2):
            ctx.cap = order
            p, q, r, g1, g2, g3 = found
            V1, V2, V3 = self.gradient(g1, g2, g3)
            rates = (
                ((B - C) * q * r + g2 * V3 - g3 * V2) / A,
                ((C - A) * p * r + g3 * V1 - g1 * V3) / B,
                ((A - B) * p * q + g1 * V2 - g2 * V1) / C,
                r * g2 - q * g3,
                p * g3 - r * g1,
                q * g1 - p * g2,
            )
            found = [
                arb_series([value, *(rate[k] / (k + 1) for k in range(order - 1))])
                for value, rate in zip(state, rates, strict=True)
            ]
        coefficients = [[arb(each[k].mid()) for k in range(self.order + 1)] for each in found]
        size = max((abs(each[k]) for each in coefficients for k in (-1, -2)), key=float_of)
        length = arb(((REST / size) ** (arb(1) / self.order)).mid())
        return Step(start, length, coefficients)


def float_of(value: arb) -> float:
    return float(value.mid())


def integrate(equations: Equations, state: State, stop: Callable[[Step, State], bool]) -> list[Step]:
    """Return steps from 0 on; the last is the first of which, with the state at its end, ``stop`` is true."""
    steps: list[Step] = []
    time = arb(0)
    while True:
        steps.append(step := equations.step(time, state))
        time = arb((time + step.length).mid())
        state = step.state(time)
        if stop(step, state):
            return steps


def state_at(steps: Sequence[Step], t: arb) -> State:
    return next(step for step in reversed(steps) if step.start <= t).state(t)


def crossing(step: Step, variable: int) -> arb:
    """Return when the variable, which changes its sign within the step, is zero."""
    coefficients = step.coefficients[variable]
    slopes = [k * each for k, each in enumerate(coefficients)][1:]
    low, high = arb(0), step.length
    rises = bool(value_at(coefficients, high) > 0)
    for _ in range(20):
        middle = (low + high) / 2
        low, high = (low, middle) if (value_at(coefficients, middle) > 0) == rises else (middle, high)
    t = (low + high) / 2
    for _ in range(8):
        t = arb((t - value_at(coefficients, t) / value_at(slopes, t)).mid())
    return step.start + t
