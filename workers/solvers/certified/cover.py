"""Proves, by boxes that cover a region, that time is a holomorphic and bounded function of the phase."""

from collections.abc import Callable
from typing import NamedTuple

from flint import acb, arb

from workers.solvers.certified.phase import TimedPhase

MAX_OVERESTIMATE_RATIO = 2.0**30
"""A bound this much larger than the function costs so many bits of a remainder: then it is refined."""
BOX_OVERLAP = 1.0 + 2.0**-20
"""Boxes are so much larger: roundings of their centres leave no gap."""


class Box(NamedTuple):
    """The square of side 2 ``half`` about x + iy."""

    x: float
    y: float
    half: float


def bound(
    phase: TimedPhase,
    boxes: list[Box],
    *,
    size: arb,
    smallest: float,
    most: int,
    is_needed: Callable[[Box], bool] = lambda _: True,
) -> arb | None:
    """Return a bound of |dt/dθ| on the boxes that are needed, where it is holomorphic.

    A box is halved both ways, down to ``smallest``, until its ball tells
    something. None if that fails, or takes more than ``most`` balls; ``size`` is about the largest rate.
    """
    waiting = list(boxes)
    largest = arb(0)
    for _ in range(most):
        while waiting and not is_needed(waiting[-1]):
            waiting.pop()
        if not waiting:
            return largest
        x, y, half = waiting.pop()
        ball = acb(arb(x, half * BOX_OVERLAP), arb(y, half * BOX_OVERLAP))
        value = abs(phase.rate(ball, analytic=True)).upper()
        if value < MAX_OVERESTIMATE_RATIO * size:
            largest = largest.max(value)
        elif half > smallest:
            half *= 0.5
            waiting += [Box(x + i * half, y + j * half, half) for i in (-1, 1) for j in (-1, 1)]
        else:
            return None
    return None
