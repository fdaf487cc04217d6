"""The pieces of a dense output, resolved in time."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from service.dynamics.bounds import largest
from service.dynamics.dense_output import chebyshev_coefficients, chebyshev_points
from service.dynamics.errors import DynamicsError
from workers.solvers.quadrature.orbit import Orbit
from workers.solvers.quadrature.time_map import PrecisionLostError, TimeMap

FloatArray = NDArray[np.float64]

DEGREE = 20
FINEST = 1e14
"""Pieces to the scale of time where they are shortest: next to a pole passed without smoothness."""
MAX_PIECES = 4000
BETWEEN = (-0.93, -0.31, 0.42, 0.87)
"""Places in a piece, none a node, where the series is compared with the motion."""

KNOWN_BITS, KNOWN = 54, 2.0**-54
"""Least relative accuracy of a variable's ball, or largest radius: either will do."""


class DenseOutputNotResolvedError(DynamicsError):
    """The motion needs more pieces than allowed."""

    code = "dense_output_not_resolved"


Sampler = Callable[[FloatArray], FloatArray]
"""The six variables, shape (n, 6), at times of shape (n,)."""


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


def nothing_resolved(period: float) -> ResolvedMotion:
    """Return a dense output without columns, for those who want no function of time."""
    return ResolvedMotion(np.array([0.0, period]), np.zeros((1, 1, 0)), 0.0, 0)


def resolve_motion(
    sample: Sampler, span: tuple[float, float], passages: FloatArray, *, scale: float, atol: float
) -> ResolvedMotion:
    """Return the six variables as functions of t over ``span``, which is cut at the ``passages`` too.

    Pieces are halved until the tail of every column's series is below ``atol``
    plus the rounding of its own size and of times of the size ``scale``.

    Raises
    ------
    DenseOutputNotResolvedError
        More than MAX_PIECES pieces would be needed.
    """
    waiting = _first_pieces(span, passages)
    places = np.concatenate([chebyshev_points(DEGREE), BETWEEN])
    done: list[tuple[float, float, FloatArray]] = []
    departure, evaluations = 0.0, 0
    while waiting:
        # One generation at a time: the inversion costs the same for one piece as for many.
        spans = np.array(waiting)
        middle, half = spans.mean(axis=1), 0.5 * (spans[:, 1] - spans[:, 0])
        values = sample((middle[:, None] + half[:, None] * places).ravel()).reshape(
            len(waiting), len(places), -1
        )
        evaluations += values.shape[0] * values.shape[1]
        following: list[tuple[float, float]] = []
        for (left, right), states in zip(waiting, values, strict=True):
            series = chebyshev_coefficients(states[: DEGREE + 1])
            pieces = scale / (right - left)
            if _is_resolved(series, states, pieces, atol) or pieces > FINEST:
                done.append((left, right, series))
                found = np.polynomial.chebyshev.chebval(np.array(BETWEEN), series).T
                departure = largest((departure, float(np.abs(found - states[DEGREE + 1 :]).max())))
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


def _first_pieces(span: tuple[float, float], passages: FloatArray) -> list[tuple[float, float]]:
    """Return equal pieces of the span, cut at the passages of a pole as well."""
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


def _is_resolved(series: FloatArray, states: FloatArray, pieces: float, atol: float) -> bool:
    """Say whether the tails of all columns are below ``atol`` and rounding.

    A time is known to a few ulp of its scale, which moves a column by its
    slope, here its range over the piece's share (1/``pieces``) of the scale.
    """
    tails = np.abs(series[-2:]).max(axis=0)
    rounding = 4e-16 * (np.abs(states).max(axis=0) + pieces * np.ptp(states, axis=0))
    return bool(np.all(tails <= atol + rounding))


def phase_sampler(orbit: Orbit, time_map: TimeMap) -> Sampler:
    """Return the six variables as a function of the time map's own times, from 0 to its total.

    It raises PrecisionLostError where the balls of a state are wider than the rounding of doubles.
    """

    def sample(times: FloatArray) -> FloatArray:
        panels, places = time_map.phase_at(times)
        rows = []
        for panel, x in zip(panels, places, strict=True):
            state = orbit.state(time_map.theta(int(panel), float(x)))
            rows.append([float(value) for value in state])
            if any(value.rel_accuracy_bits() < KNOWN_BITS and not value.rad() < KNOWN for value in state):
                raise PrecisionLostError("the variables are known to fewer digits than a double has")
        return np.array(rows)

    return sample
