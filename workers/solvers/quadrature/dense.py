"""The dense output of a periodic planar motion, resolved in time."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from service.dynamics.dense_output import DenseOutput, chebyshev_coefficients, chebyshev_points
from service.dynamics.errors import DynamicsError
from service.dynamics.motion import COLUMNS
from workers.solvers.quadrature.orbit import Orbit
from workers.solvers.quadrature.time_map import TimeMap

FloatArray = NDArray[np.float64]

DEGREE = 20
FINEST = 1e14
"""Pieces to a period where they are shortest: next to a pole passed without smoothness."""
MAX_PIECES = 4000
BETWEEN = (-0.93, -0.31, 0.42, 0.87)
"""Places in a piece, none a node, where the series is compared with the motion."""


class DenseOutputNotResolvedError(DynamicsError):
    """The motion needs more pieces than allowed."""

    code = "dense_output_not_resolved"


@dataclass(frozen=True, slots=True)
class ResolvedMotion:
    """A dense output and what it took.

    Its error is twice the largest departure from the motion that was seen
    between the nodes of any piece: a factor for the places not looked at.
    """

    dense: DenseOutput
    evaluations: int
    passages: FloatArray
    """Times in [0, period) at which a pole is passed, growing."""


def resolve_motion(orbit: Orbit, time_map: TimeMap, *, atol: float) -> ResolvedMotion:
    """Return the six variables as functions of t since the start, over one period.

    Pieces are halved until the tail of every column's series is below ``atol``
    plus the rounding of its own size.

    Raises
    ------
    DenseOutputNotResolvedError
        More than MAX_PIECES pieces would be needed.
    """
    period = time_map.period.hi
    origin = float(time_map.time_at(np.array([orbit.start]))[0])
    sample = _sampler(orbit, time_map, origin)
    passages = (time_map.time_at(np.array(orbit.corners)) - origin) % period
    waiting = _first_pieces(period, passages)
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
            periods = period / (right - left)
            if _is_resolved(series, states, periods, atol) or periods > FINEST:
                done.append((left, right, series))
                found = np.polynomial.chebyshev.chebval(np.array(BETWEEN), series).T
                departure = max(departure, float(np.abs(found - states[DEGREE + 1 :]).max()))
            else:
                between = 0.5 * (left + right)
                following.extend([(left, between), (between, right)])
        waiting = following
        if len(done) + len(waiting) > MAX_PIECES:
            raise DenseOutputNotResolvedError(f"more than {MAX_PIECES} pieces would be needed for {atol:.1e}")
    done.sort(key=lambda piece: piece[0])
    edges = np.array([0.0, *(right for _, right, _ in done)])
    coefficients = np.stack([series for _, _, series in done])
    dense = DenseOutput(COLUMNS, edges, coefficients, time_map.period, 2.0 * departure)
    return ResolvedMotion(dense, evaluations, np.sort(passages))


def _first_pieces(period: float, passages: FloatArray) -> list[tuple[float, float]]:
    """Return equal pieces of a period, cut at the passages of a pole as well."""
    breaks = [0.0]
    for t in sorted({*np.linspace(0.0, period, 9).tolist(), *passages.tolist()}):
        if t - breaks[-1] > 1e-9 * period:
            breaks.append(t)
        elif t in passages and 0.0 < breaks[-1] < period:
            breaks[-1] = t
    breaks[-1] = period
    return list(pairwise(breaks))


def _is_resolved(series: FloatArray, states: FloatArray, periods: float, atol: float) -> bool:
    """Say whether the tails of all columns are below ``atol`` and rounding.

    A time is known to a few ulp of the period, which moves a column by its
    slope, here its range over the piece's share (1/``periods``) of the period.
    """
    tails = np.abs(series[-2:]).max(axis=0)
    rounding = 4e-16 * (np.abs(states).max(axis=0) + periods * np.ptp(states, axis=0))
    return bool(np.all(tails <= atol + rounding))


def _sampler(orbit: Orbit, time_map: TimeMap, origin: float) -> Callable[[FloatArray], FloatArray]:
    """Return the six variables as a function of times since the start, in [0, period]."""
    period = time_map.period.hi

    def sample(times: FloatArray) -> FloatArray:
        local = times + origin
        local = np.where(local > period, local - period, local)
        panels, places = time_map.phase_at(np.clip(local, 0.0, period))
        rows = []
        for panel, x in zip(panels, places, strict=True):
            state = orbit.state(time_map.theta(int(panel), float(x)))
            rows.append([float(value) for value in state])
        return np.array(rows)

    return sample
