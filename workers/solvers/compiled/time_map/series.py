"""Time as a function of the phase, by Chebyshev series on panels."""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.blocks import two_sum
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import NODES, Panel, Records

FloatArray = NDArray[np.float64]


def nodes() -> FloatArray:
    """Return cos(π (j + 1/2) / NODES): from almost 1 down to almost −1."""
    j = np.arange(NODES)
    return np.sin(np.pi * (NODES - 1 - 2 * j) / (2 * NODES))


POINTS = nodes()


@inlined
def larger(one: float, other: float) -> float:
    """Return the larger of two numbers, NaN if either is: ``max`` drops it by its place."""
    return other if other > one or np.isnan(other) else one


@inlined
def last_coefficients(series: FloatArray) -> float:
    """Return the size of what a series of NODES coefficients leaves out, judged by how its coefficients fall.

    The largest of the last two may be small by chance: on a panel that is symmetric about its anchor the odd
    ones vanish, and one number is left. So the pairs before it count too, as they fall from one to the next,
    and what is left out is not taken to be less than they lead to expect. Evidence, no bound.
    """
    last = larger(abs(series[NODES - 1]), abs(series[NODES - 2]))
    before = larger(abs(series[NODES - 3]), abs(series[NODES - 4]))
    first = larger(abs(series[NODES - 5]), abs(series[NODES - 6]))
    expected = before if before >= first else before * (before / first)
    return larger(last, expected)


@inlined
def distance(panel: Panel, x: float) -> float:
    """Return the distance to the anchor at x; exact next to an anchor at one of the ends."""
    return float(0.5 * (panel.low * (1.0 - x) + panel.high * (1.0 + x)))


@kernel
def at(panel: Panel, x: float) -> tuple[float, float]:
    """Return what :func:`series_at` does, for one place: code that is shared."""
    return series_at(panel, x)


@kernel
def time_at(panels: Records, number: int, u: float) -> tuple[float, float]:
    """Return the time at the phase u, and what it leaves out."""
    for n in range(number):
        panel = panels[n]
        w = u - 0.5 * panel.anchor
        if n == number - 1 or w <= (panel.high if panel.last == 1.0 else 0.0):
            x = ((w - panel.low) - (panel.high - w)) / (panel.high - panel.low)
            value, _ = at(panel, min(panel.last, max(panel.first, x)))
            time, rest = two_sum(panel.start, value)
            return time, rest + panel.start_lo
    return math.nan, 0.0


@inlined
def series_at(panel: Panel, x: float) -> tuple[float, float]:
    """Return t − START and dt/dx at x, by Clenshaw's recurrence for both at once."""
    twice = 2.0 * x
    b1, b2 = panel.times[NODES], 0.0
    c1, c2 = 0.0, 0.0
    for k in range(NODES - 1, 0, -1):
        b1, b2 = (panel.times[k] - b2) + twice * b1, b1
        c1, c2 = (panel.slopes[k] - c2) + twice * c1, c1
    return panel.times[0] + x * b1 - b2, panel.slopes[0] + x * c1 - c2


@inlined
def slope_at(panel: Panel, x: float) -> float:
    """Return dt/dx at x alone, with the bits that :func:`series_at` has."""
    twice = 2.0 * x
    c1, c2 = 0.0, 0.0
    for k in range(NODES - 1, 0, -1):
        c1, c2 = (panel.slopes[k] - c2) + twice * c1, c1
    return float(panel.slopes[0] + x * c1 - c2)
