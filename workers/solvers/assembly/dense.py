"""Resolves a motion in time: the pieces of its dense output."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from service.dynamics.bounds import largest
from service.dynamics.errors import DynamicsError
from service.dynamics.solution.dense_output import chebyshev_coefficients, chebyshev_points

FloatArray = NDArray[np.float64]

DEGREE = 20
FINEST = 1e14
"""Pieces to the scale of time where they are shortest: next to a pole passed without smoothness."""
MAX_PIECES = 4000
BETWEEN = (-0.93, -0.31, 0.42, 0.87)
"""Places in a piece, none a node, where the series is compared with the motion."""

NARROW = 0.5
"""A feature of less than this part of a piece may fall between its nodes, and is looked at on its own."""
SEEN = 8.0
"""Largest departure at a feature, in parts of what the tail of a resolved series may be."""


class DenseOutputNotResolvedError(DynamicsError):
    """The motion needs more pieces than allowed."""

    code = "dense_output_not_resolved"


Sampler = Callable[[FloatArray], FloatArray]
"""The six variables, shape (n, 6), at times of shape (n,)."""
Features = tuple[FloatArray, FloatArray]
"""Times at which something may happen, and for how long it may last, shapes (n,)."""


@dataclass(frozen=True, slots=True)
class ResolvedMotion:
    """The pieces of a dense output and what they took."""

    breaks: FloatArray
    """Shape (pieces + 1,)."""
    coefficients: FloatArray
    """Shape (pieces, DEGREE + 1, 6)."""
    departure: float
    """Largest departure from the motion that was seen between the nodes of any piece."""
    evaluations: int

    @property
    def error(self) -> float:
        """Twice the departure: a factor for the places not looked at."""
        return 2.0 * self.departure

    def moved(self, by: float) -> float:
        """Return a bound of what an error ``by`` of the time, less than any piece, does to a column.

        A piece so short that its coefficients are roundings has no slope, but a range.
        """
        lengths = np.diff(self.breaks)[:, None]
        slopes = np.abs(np.polynomial.chebyshev.chebder(self.coefficients, axis=1)).sum(axis=1)
        slid = slopes * (2.0 * by) / lengths
        ranges = 2.0 * np.abs(self.coefficients[:, 1:]).sum(axis=1)
        is_short = slid > ranges
        parts = (np.where(is_short, 0.0, slid), np.where(is_short, ranges, 0.0))
        return sum(float(part.max(initial=0.0)) for part in parts)


def nothing_resolved(period: float) -> ResolvedMotion:
    """Return a dense output without columns, for those who want no function of time."""
    return ResolvedMotion(np.array([0.0, period]), np.zeros((1, 1, 0)), 0.0, 0)


def resolve_motion(
    sample: Sampler,
    span: tuple[float, float],
    passages: FloatArray,
    *,
    scale: float,
    atol: float,
    features: Features | None = None,
    finest: float = FINEST,
) -> ResolvedMotion:
    """Return the six variables as functions of t over ``span``, which is cut at the ``passages`` too.

    Passages, in order, are those of poles and of kinks of V: times at which the motion is not smooth.
    Pieces are halved until the tail of every column's series is below ``atol``
    plus the rounding of its own size and of times of the size ``scale``, and, at
    every one of the ``features`` that is narrow for the piece, the series is the motion.
    Pieces shorter than ``scale`` / ``finest`` are not halved: what is left shows in the departure.

    Raises
    ------
    DenseOutputNotResolvedError
        More than MAX_PIECES pieces would be needed.
    """
    waiting = _first_pieces(span, passages)
    nodes = np.concatenate([chebyshev_points(DEGREE), BETWEEN])
    done: list[tuple[float, float, FloatArray]] = []
    departure, evaluations = 0.0, 0
    while waiting:
        # One generation at a time: the inversion costs the same for one piece as for many.
        places = [np.concatenate([nodes, _narrow(features, *piece)]) for piece in waiting]
        times = [
            0.5 * (left + right) + 0.5 * (right - left) * x
            for (left, right), x in zip(waiting, places, strict=True)
        ]
        values = np.split(sample(np.concatenate(times)), np.cumsum([len(x) for x in places])[:-1])
        evaluations += sum(len(x) for x in places)
        following: list[tuple[float, float]] = []
        for (left, right), x, states in zip(waiting, places, values, strict=True):
            series = chebyshev_coefficients(states[: DEGREE + 1])
            pieces = scale / (right - left)
            found = np.polynomial.chebyshev.chebval(x[DEGREE + 1 :], series).T
            departures = np.abs(found - states[DEGREE + 1 :])
            allowed = _allowed(states, pieces, atol)
            is_resolved = bool(np.all(np.abs(series[-2:]).max(axis=0) <= allowed))
            is_seen = bool(np.all(departures[len(BETWEEN) :] <= SEEN * allowed))
            if (is_resolved and is_seen) or pieces > finest:
                done.append((left, right, series))
                departure = largest((departure, float(departures.max())))
            else:
                between = 0.5 * (left + right)
                following.extend([(left, between), (between, right)])
        waiting = following
        if len(done) + len(waiting) > MAX_PIECES:
            raise DenseOutputNotResolvedError(f"more than {MAX_PIECES} pieces would be needed for {atol:.1e}")
    done.sort(key=lambda piece: piece[0])
    edges = np.array([span[0], *(right for _, right, _ in done)])
    coefficients = np.stack([series for _, _, series in done])
    return ResolvedMotion(edges, coefficients, departure, evaluations)


def _narrow(features: Features | None, left: float, right: float) -> FloatArray:
    """Return the places in [−1, 1] of the features inside a piece that are narrow for it."""
    if features is None:
        return np.zeros(0)
    times, widths = features
    is_inside = (times > left) & (times < right) & (widths < NARROW * (right - left))
    inside = times[is_inside]
    return ((inside - left) - (right - inside)) / (right - left)


def _first_pieces(span: tuple[float, float], passages: FloatArray) -> list[tuple[float, float]]:
    """Return equal pieces of the span, cut at the passages as well."""
    first, last = span
    breaks = [first]
    for t in sorted({*np.linspace(first, last, 9).tolist(), *passages.tolist()}):
        if not first < t <= last:
            continue
        if t - breaks[-1] > 1e-9 * (last - first):
            breaks.append(t)
        elif t in passages and first < breaks[-1] < last:
            breaks[-1] = t
    breaks[-1] = last
    return list(pairwise(breaks))


def _allowed(states: FloatArray, pieces: float, atol: float) -> FloatArray:
    """Return the largest tail of each column that is resolved: ``atol`` and rounding.

    A time is known to a few ulp of its scale, which moves a column by its
    slope, here its range over the piece's share (1/``pieces``) of the scale.
    """
    rounding = 4e-16 * (np.abs(states).max(axis=0) + pieces * np.ptp(states, axis=0))
    allowed: FloatArray = atol + rounding
    return allowed
