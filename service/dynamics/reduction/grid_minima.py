"""Looks on a grid for places where P may nearly touch 0, on many curves of one body and potential at once.

It proves nothing: it says where balls need not look. About a near rest P is K (x² + ρ²), up to NEIGHBOURS
steps of the grid away. So half a step from it |P| is 1/256 of what it is NEIGHBOURS steps further; and where
P grows, or falls, at nearly one rate over LINE_STEPS steps on both sides of a zero there is no such place.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.reduction.geometry.loop import Loop

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

GRID_POINTS = 256
STEP = np.pi / GRID_POINTS
SAME_MINIMUM_DISTANCE = 8.0 / GRID_POINTS
"""Distance in v within which a place is the one that was looked for."""
NEIGHBOURS, MINIMUM_RELATIVE_DEPTH = 8, 2.0**-4
LINE_STEPS, LINE_SLOPE_RATIO = 6, 4.0
"""Steps on both sides of a zero on which P is looked at, and the greatest ratio of those that are alike."""
SLOPE_DISTANCE = 2.0**-24
"""Distance in v from a zero at which its slope is looked at."""
EQUATOR_STEPS = 4
"""Steps from the equator that SAME_MINIMUM_DISTANCE is less than, by half a step and more."""


@dataclass(frozen=True, slots=True)
class GridMinima:
    """The grid's places of one half loop, 0 < |v| < π."""

    is_low: BoolArray
    """|P| is less than at both neighbours, and much less than around."""
    slopes: FloatArray
    """|dP/dv| where P changes its sign and its steps around are alike, NaN elsewhere."""
    is_far_at_equator: bool
    """|P| about the equator is nowhere much less than around."""

    def lowest(self) -> list[float]:
        """Return the places where |P| is low."""
        found: list[float] = _places()[self.is_low].tolist()
        return found

    def passes_plainly(self, loop: Loop, zero: arb) -> bool:
        """Tell whether P passes its simple zero on a straight line, both on the grid and next to the zero."""
        place = round(abs(float(zero)) / STEP) - 1
        slope = float(self.slopes[place]) if 0 <= place < GRID_POINTS - 1 else np.nan
        if not slope > 0.0:
            return False
        # What is narrower than a step of the grid bends P at the zero, or does not concern it.
        near = abs(float(loop.point(zero.mid() + SLOPE_DISTANCE).P)) / SLOPE_DISTANCE
        return slope < LINE_SLOPE_RATIO * near < LINE_SLOPE_RATIO * LINE_SLOPE_RATIO * slope


def is_at_one_of(v: float, places: Sequence[float]) -> bool:
    """Tell whether one of the places is next to v on the grid."""
    return any(abs(v - other) <= STEP for other in places)


def are_apart(places: Sequence[arb]) -> bool:
    """Tell whether any two places are too far apart for a near rest between them, or next to them."""
    sizes = sorted(abs(float(v)) for v in places)
    return all(upper - lower > 2.0 * SAME_MINIMUM_DISTANCE for lower, upper in pairwise(sizes))


@cache
def _places() -> FloatArray:
    return np.linspace(0.0, np.pi, GRID_POINTS + 1)[1:-1]


def grid_minima_of(loops: Sequence[Loop], g3_sign: int) -> list[GridMinima]:
    """Return what the grid shows of each loop; they differ in λ alone."""
    v = _places()
    Z, G = (np.array([float(getattr(loop, name)) for loop in loops])[:, None] for name in "ZG")
    P = loops[0].radicand_on(Z, G, g3_sign * np.sin(v), np.cos(v))
    size = np.abs(P)
    around = np.pad(size, ((0, 0), (NEIGHBOURS, NEIGHBOURS)), mode="edge")
    for width in (1, 2, 4, 8):
        around = np.maximum(around[:, :-width], around[:, width:])
    # The largest of 16 places each, and of 17.
    around = np.maximum(around[:, :-1], around[:, 1:])
    with np.errstate(all="ignore"):
        # Where P is constant but for its rounding, every third place is lower than its neighbours.
        is_low = size < MINIMUM_RELATIVE_DEPTH * around
        is_low[:, 1:-1] &= (size[:, 1:-1] < size[:, :-2]) & (size[:, 1:-1] < size[:, 2:])
        is_low[:, [0, -1]] = False
        beside, wider = (
            size[:, GRID_POINTS // 2 - 1 - steps : GRID_POINTS // 2 + steps]
            for steps in (EQUATOR_STEPS, EQUATOR_STEPS + NEIGHBOURS)
        )
        # Written so that NaN is not far.
        is_far = beside.min(axis=1) > MINIMUM_RELATIVE_DEPTH * wider.max(axis=1)
        slopes = _slopes(P)
    return [GridMinima(low, slope, bool(far)) for low, slope, far in zip(is_low, slopes, is_far, strict=True)]


def _slopes(P: FloatArray) -> FloatArray:
    """Return the slope of P where it changes its sign and its steps around are alike, NaN elsewhere."""
    found = np.full(P.shape, np.nan)
    crosses = np.zeros(P.shape, dtype=np.bool_)
    crosses[:, LINE_STEPS:-LINE_STEPS] = (P[:, LINE_STEPS - 1 : -LINE_STEPS - 1] > 0.0) != (
        P[:, LINE_STEPS + 1 : -LINE_STEPS + 1] > 0.0
    )
    rows, places = np.nonzero(crosses)
    if len(rows):
        steps = np.diff(P[rows[:, None], places[:, None] + np.arange(-LINE_STEPS, LINE_STEPS + 1)], axis=1)
        low, high = steps.min(axis=1), steps.max(axis=1)
        alike = ((low > 0.0) & (high < LINE_SLOPE_RATIO * low)) | (
            (high < 0.0) & (low > LINE_SLOPE_RATIO * high)
        )
        slopes = np.abs(steps[:, LINE_STEPS - 1 : LINE_STEPS + 1].mean(axis=1)) / STEP
        found[rows, places] = np.where(alike, slopes, np.nan)
    return found
