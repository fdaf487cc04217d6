r"""Chooses few times at which a function of time is drawn as a polyline, and bounds how far that is off.

Between two times at a distance h a polyline is off by at most h²/8 · max|f''|. So the
distances are made proportional to 1/√|f''|, f'' being that of the dense output's own
polynomials, for the column that is bent most in relation to its range: the same error is
spent on each stretch, which is what makes the largest of them least.

How far the polyline is off is told by a theorem about these polynomials: at points
so close that between any two neighbours (δ apart, in one piece) there is one polynomial, the difference
is evaluated; in between it is larger by at most δ²/8 · max|f''|, and |f''| is at most the sum of the
absolute coefficients of its Chebyshev series.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from service.dynamics.numerics import largest
from service.dynamics.solution.dense_output import DenseOutput, split_time

FloatArray = NDArray[np.float64]

PIXEL_SHARE = 1e-3
"""Share of the range of a column: a pixel of a picture that is 1000 high."""
_BEND_POINTS = 16
"""Places in a piece at which f'' is evaluated for the choice of times."""
_CHECKS_PER_STRETCH = 16
"""Stretches of the distance between two times, at whose ends the difference is evaluated."""
_MAX_CHECKS = 400_000
"""Beyond it, at thousands of periods, nothing is told: no preview follows these."""
_EVEN_SHARE = 0.05
"""This share of the times is spread evenly, so that no stretch is without any."""


@dataclass(frozen=True, slots=True)
class Bend:
    """Second derivatives of the pieces of a dense output."""

    at_nodes: FloatArray
    """Shape (pieces, nodes, columns), at the middles of equal parts of each piece."""
    bounds: FloatArray
    """Shape (pieces, columns): proven bounds of their absolute values."""


def bend_of(dense: DenseOutput) -> Bend:
    """Return the second derivatives of all columns."""
    series = np.moveaxis(dense.coefficients, 1, 0)
    if len(series) < 3:
        series = np.concatenate([series, np.zeros((3 - len(series), *series.shape[1:]))])
    second = np.asarray(chebyshev.chebder(series, 2), dtype=np.float64)
    # x = 2 (t − middle)/length.
    scale = (2.0 / np.diff(dense.breaks)) ** 2
    middles = (np.arange(_BEND_POINTS) + 0.5) * (2.0 / _BEND_POINTS) - 1.0
    values = np.einsum("nk,kpc->pnc", chebyshev.chebvander(middles, len(second) - 1), second)
    return Bend(values * scale[:, None, None], np.abs(second).sum(axis=0) * scale[:, None])


def preview_times(dense: DenseOutput, start: float, stop: float, count: int) -> FloatArray:
    """Return ``count`` growing times from ``start`` to ``stop``, close together where columns are bent."""
    samples = dense.only(dense.columns)(_within(dense, np.linspace(start, stop, 4 * count)))
    ranges = np.ptp(samples, axis=0)
    drawn = ranges > _flat(dense)
    if not drawn.any() or not start < stop:
        return np.linspace(start, stop, count)
    bent = np.sqrt((np.abs(bend_of(dense).at_nodes[:, :, drawn]) / ranges[drawn]).max(axis=2))
    steps = np.repeat(np.diff(dense.breaks)[:, None] / _BEND_POINTS, _BEND_POINTS, axis=1).ravel()
    weights = bent.ravel()
    weights = weights + _EVEN_SHARE * float((weights * steps).sum() / steps.sum()) + np.finfo(np.float64).tiny
    ends = np.concatenate([[dense.breaks[0]], dense.breaks[0] + np.cumsum(steps)])
    ends[-1] = dense.breaks[-1]
    grown = np.concatenate([[0.0], np.cumsum(weights * steps)])

    def grown_at(time: float) -> float:
        if dense.period is None:
            return float(np.interp(time, ends, grown))
        local, turns = split_time(np.array([time]), dense.period)
        return float(turns[0] * grown[-1] + np.interp(local[0], ends, grown))

    wanted = np.linspace(grown_at(start), grown_at(stop), count)
    turns = np.floor(wanted / grown[-1]) if dense.period is not None else np.zeros(count)
    times = np.interp(wanted - turns * grown[-1], grown, ends)
    if dense.period is not None:
        times = times + turns * dense.period.hi
    times[0], times[-1] = start, stop
    return np.maximum.accumulate(np.clip(times, start, stop))


def deviation(
    dense: DenseOutput,
    parts: Mapping[str, Sequence[str]],
    times: FloatArray,
    evaluate: Callable[[FloatArray], Mapping[str, FloatArray]],
) -> float:
    """Return a bound of how far the polyline through the values at ``times`` is from the columns.

    Parameters
    ----------
    parts
        For each drawn column those of the dense output by which its second derivative is bounded: by
        the root of the sum of their squares.
    times
        Growing.
    evaluate
        Returns the drawn columns at any times.

    Returns
    -------
    float
        The largest difference of any column as a share of its range, at most 1: no polyline between
        values of a function leaves its range. Columns that are constant within their errors do not count.
    """
    breaks = _breaks_between(dense, float(times[0]), float(times[-1]))
    if breaks is None:
        return 1.0
    fractions = np.arange(_CHECKS_PER_STRETCH) / _CHECKS_PER_STRETCH
    spread = times[:-1, None] + np.diff(times)[:, None] * fractions
    checks = np.unique(np.concatenate([spread.ravel(), times, breaks]))
    if len(checks) < 2:
        return 0.0
    local, half = checks, np.diff(checks) / 2.0
    middles = checks[:-1] + half
    if dense.period is not None:
        middles = split_time(middles, dense.period)[0]
    piece = np.clip(np.searchsorted(dense.breaks, middles, side="right") - 1, 0, len(dense.breaks) - 2)
    bounds, values = bend_of(dense).bounds, evaluate(_within(dense, local))
    at_times, found = evaluate(times), 0.0
    for name, columns in parts.items():
        extent = float(np.ptp(values[name]))
        if extent <= _flat(dense):
            continue
        own = [dense.columns.index(column) for column in columns]
        second = np.sqrt((bounds[:, own] ** 2).sum(axis=1))[piece]
        off = np.abs(values[name] - np.interp(checks, times, at_times[name]))
        between = np.maximum(off[:-1], off[1:]) + half**2 / 2.0 * second
        found = max(found, float(between.max()) / extent)
    return min(1.0, found)


def _flat(dense: DenseOutput) -> float:
    """Return the range below which a column is constant within its error."""
    return 4.0 * largest((dense.error, math.ulp(1.0)))


def _within(dense: DenseOutput, times: FloatArray) -> FloatArray:
    return times if dense.period is not None else np.clip(times, dense.breaks[0], dense.breaks[-1])


def _breaks_between(dense: DenseOutput, start: float, stop: float) -> FloatArray | None:
    """Return the ends of pieces between two times; None if there are too many of them."""
    inner = dense.breaks[(dense.breaks > start) & (dense.breaks < stop)]
    if dense.period is None:
        return inner
    first, last = math.floor(start / dense.period.hi), math.floor(stop / dense.period.hi)
    if (last - first + 1) * len(dense.breaks) > _MAX_CHECKS:
        return None
    turns = np.arange(first, last + 1, dtype=np.float64)
    every = (turns[:, None] * dense.period.hi + dense.breaks[None, :-1]).ravel()
    return every[(every > start) & (every < stop)]
