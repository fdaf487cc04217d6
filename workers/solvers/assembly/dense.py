"""Motions and times in pieces: the dense output of a motion, and time as series of the phase on panels.

A motion is resolved by halving pieces of time. A time map is t(u), and back u(t) by Newton's method.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from flint import arb
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from service.dynamics.errors import DynamicsError
from service.dynamics.numerics import largest
from service.dynamics.solution.dense_output import (
    Period,
    chebyshev_coefficients,
    chebyshev_points,
    chebyshev_series,
)

FloatArray = NDArray[np.float64]
Sampler = Callable[[FloatArray], FloatArray]
"""The six variables, shape (n, 6), at times of shape (n,)."""
Features = tuple[FloatArray, FloatArray]
"""Times at which something may happen, and for how long it may last, shapes (n,)."""
PIECE_DEGREE = 20
MAX_RELATIVE_FINENESS = 1e14
"""Pieces to the scale of time where they are shortest: next to a pole passed without smoothness."""
MAX_PIECES = 4000
FIRST_PIECES = 8
"""Equal ones, that are halved where they must be."""
VARIABLE_RELATIVE_ROUNDING = 4e-16
"""Rounding error of a variable, relative to its size, and of a time, relative to its scale."""
CHECKED_POINTS = (-0.93, -0.31, 0.42, 0.87)
"""Places in a piece, none a node, where the series is compared with the motion."""
NARROW_FEATURE_SHARE = 0.5
"""A feature of less than this part of a piece may fall between its nodes, and is looked at on its own."""
FEATURE_DEPARTURE_TAILS = 8.0
"""Largest departure at a feature, in parts of what the tail of a resolved series may be."""
LAST_NEWTON_STEP = 2e-15
"""A step of Newton's method in [−1, 1] that is the rounding of the series; it is still taken."""
SPEED_POINTS = (-0.6, 0.0, 0.6)
"""Places in a panel at which a function of time is looked at: a feature is about as wide as its panels."""
BALL_CHECKED_POINTS = (-0.71, 0.29)
"""Places in a piece, none a node, where the series of the variables are compared with balls."""
UNSEEN_DEPARTURE_FACTOR = 4.0
"""Largest departure between the places that are looked at, in parts of the largest departure at them."""


def integration_matrix(degree: int) -> FloatArray:
    """Return what integrates values at Chebyshev's points from −1 on, shape (degree + 1, degree + 1)."""
    series = chebyshev.chebint(chebyshev_coefficients(np.eye(degree + 1)), lbnd=-1, axis=0)
    integrals: FloatArray = chebyshev.chebvander(chebyshev_points(degree), degree + 1) @ series
    return integrals


class DenseOutputNotResolvedError(DynamicsError):
    """The motion needs more pieces than allowed."""

    code = "dense_output_not_resolved"


@dataclass(frozen=True, slots=True)
class ResolvedMotion:
    """The pieces of a dense output and what they took."""

    breaks: FloatArray
    """Shape (pieces + 1,)."""
    coefficients: FloatArray
    """Shape (pieces, PIECE_DEGREE + 1, 6)."""
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
        if by == 0.0:
            return 0.0
        lengths = np.diff(self.breaks)[:, None]
        slopes = np.abs(chebyshev.chebder(self.coefficients, axis=1)).sum(axis=1)
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
    finest: float = MAX_RELATIVE_FINENESS,
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
    done: list[tuple[float, float, FloatArray]] = []
    departure, evaluations = 0.0, 0
    while waiting:
        # One generation at a time: what is computed costs nearly the same for one piece as for many.
        narrow = [_narrow(features, *piece) for piece in waiting]
        states, between, others = _sampled(sample, waiting, narrow)
        evaluations += len(waiting) * (PIECE_DEGREE + 1 + len(CHECKED_POINTS)) + sum(len(x) for x in narrow)
        series = chebyshev_series(states)
        departures = np.abs(_between(series) - between)
        sizes = np.concatenate([states, between], axis=1)
        pieces = np.array([scale / (right - left) for left, right in waiting])
        allowed = _allowed(sizes, pieces[:, None], atol)
        is_resolved = (np.abs(series[:, -2:]).max(axis=1) <= allowed).all(axis=1)
        largest_departures = departures.max(axis=(1, 2))
        for k, x in enumerate(narrow):
            if not len(x):
                continue
            apart = np.abs(chebyshev.chebval(x, series[k]).T - others[k])
            looser = _allowed(np.concatenate([sizes[k], others[k]])[None], pieces[k : k + 1, None], atol)[0]
            is_resolved[k] = (np.abs(series[k, -2:]).max(axis=0) <= looser).all() and (
                apart <= FEATURE_DEPARTURE_TAILS * looser
            ).all()
            largest_departures[k] = largest((float(largest_departures[k]), float(apart.max())))
        following: list[tuple[float, float]] = []
        for k, (left, right) in enumerate(waiting):
            if is_resolved[k] or pieces[k] > finest:
                done.append((left, right, series[k]))
                departure = largest((departure, float(largest_departures[k])))
            else:
                middle = 0.5 * (left + right)
                following.extend([(left, middle), (middle, right)])
        waiting = following
        if len(done) + len(waiting) > MAX_PIECES:
            raise DenseOutputNotResolvedError(f"more than {MAX_PIECES} pieces would be needed for {atol:.1e}")
    done.sort(key=lambda piece: piece[0])
    edges = np.array([span[0], *(right for _, right, _ in done)])
    coefficients = np.stack([series for _, _, series in done])
    return ResolvedMotion(edges, coefficients, departure, evaluations)


def _sampled(
    sample: Sampler, pieces: list[tuple[float, float]], narrow: list[FloatArray]
) -> tuple[FloatArray, FloatArray, list[FloatArray]]:
    """Return the states of each piece at its nodes, at CHECKED_POINTS, and at its ``narrow`` features."""
    nodes = np.concatenate([chebyshev_points(PIECE_DEGREE), CHECKED_POINTS])
    places = [np.concatenate([nodes, x]) if len(x) else nodes for x in narrow]
    times = [
        0.5 * (left + right) + 0.5 * (right - left) * x
        for (left, right), x in zip(pieces, places, strict=True)
    ]
    values = np.split(sample(np.concatenate(times)), np.cumsum([len(x) for x in places])[:-1])
    states = np.stack([each[: len(nodes)] for each in values])
    return (
        states[:, : PIECE_DEGREE + 1],
        states[:, PIECE_DEGREE + 1 :],
        [each[len(nodes) :] for each in values],
    )


def _between(series: FloatArray) -> FloatArray:
    """Return the values at CHECKED_POINTS, shape (n, len, 6), of series of shape (n, PIECE_DEGREE + 1, 6)."""
    values = chebyshev.chebval(np.array(CHECKED_POINTS), series.transpose(1, 0, 2))
    return np.asarray(values.transpose(0, 2, 1))


def _narrow(features: Features | None, left: float, right: float) -> FloatArray:
    """Return the places in [−1, 1] of the features inside a piece that are narrow for it."""
    if features is None:
        return np.zeros(0)
    times, widths = features
    is_inside = (times > left) & (times < right) & (widths < NARROW_FEATURE_SHARE * (right - left))
    inside = times[is_inside]
    return ((inside - left) - (right - inside)) / (right - left)


def _first_pieces(span: tuple[float, float], passages: FloatArray) -> list[tuple[float, float]]:
    """Return equal pieces of the span, cut at the passages as well."""
    first, last = span
    breaks = [first]
    for t in sorted({*np.linspace(first, last, FIRST_PIECES + 1).tolist(), *passages.tolist()}):
        if not first < t <= last:
            continue
        if t - breaks[-1] > 1e-9 * (last - first):
            breaks.append(t)
        elif t in passages and first < breaks[-1] < last:
            breaks[-1] = t
    breaks[-1] = last
    return list(pairwise(breaks))


def _allowed(states: FloatArray, pieces: FloatArray, atol: float) -> FloatArray:
    """Return the largest tail of each column that is resolved: ``atol`` and rounding; shape (n, 6).

    A time is known to a few ulp of its scale, which moves a column by its
    slope, here its range over the piece's share (1/``pieces``) of the scale.
    ``states`` have the shape (n, places, 6), ``pieces`` that of (n, 1).
    """
    rounding = VARIABLE_RELATIVE_ROUNDING * (np.abs(states).max(axis=1) + pieces * np.ptp(states, axis=1))
    allowed: FloatArray = atol + rounding
    return allowed


@dataclass(frozen=True, slots=True)
class TimeMap:
    """t(u) on one turn; for the quadrature u is θ/π, from 0 to 2."""

    edges: FloatArray
    """u at the panels' ends, shape (panels + 1,), growing."""
    rates: FloatArray
    """Chebyshev coefficients of dt/du, shape (degree + 1, panels)."""
    integrals: FloatArray
    """Coefficients of ∫ dt/dx dx from the panel's left end, shape (degree + 2, panels)."""
    times: FloatArray
    """t at the edges."""
    period: Period
    error: float
    """Bound of the error of t(u) within the turn, beside the rounding of doubles."""
    nodes: int
    """Evaluations of the integrand."""
    unproved: int
    """Panels whose error is an estimate."""
    kinks: FloatArray
    """t at the kinks of the rate that panels were cut at."""
    rounding: float = 0.0
    """Rounding of times: where the rate is next to 0, at a pole, no phase is known better."""

    def time_at(self, u: FloatArray) -> FloatArray:
        """Return t(u) on the turn."""
        panel = np.clip(np.searchsorted(self.edges, u, side="right") - 1, 0, len(self.edges) - 2)
        left, right = self.edges[panel], self.edges[panel + 1]
        x = ((u - left) - (right - u)) / (right - left)
        return self.times[panel] + sum_series(self.integrals, panel, x)

    def phase_at(self, times: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        """Return the panel and the place x in [−1, 1] in it with t(u) = ``times``, in [0, period].

        Newton's method inside a bracket that never grows; t is monotone.
        """
        panel = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        target = times - self.times[panel]
        lengths = self.times[panel + 1] - self.times[panel]
        # A panel may be shorter than doubles tell its ends apart: any place in it will do.
        share = np.divide(target, lengths, out=np.full(len(times), 0.5), where=lengths > 0.0)
        low, high = np.full(len(times), -1.0), np.full(len(times), 1.0)
        half = 0.5 * (self.edges[panel + 1] - self.edges[panel])
        x = self._guess(panel, half, lengths, np.clip(share, 0.0, 1.0))
        # Both series at once: the rates have one coefficient less.
        both = np.stack(
            [self.integrals[:, panel], np.vstack([self.rates, 0.0 * self.times[:-1]])[:, panel]], axis=1
        )
        for _ in range(60):
            passed, rates = _sum(both, x)
            miss = passed - target
            low, high = np.where(miss <= 0.0, x, low), np.where(miss >= 0.0, x, high)
            # Where the series of an unproved panel is 0 there is no step, and the bracket is halved.
            with np.errstate(divide="ignore", invalid="ignore"):
                step = miss / (half * rates)
            is_small, is_met = np.abs(step) <= LAST_NEWTON_STEP, np.abs(miss) <= self.rounding
            newton = np.clip(x - step, -1.0, 1.0)
            # At a pole a step is rounding by rounding: what is met stays unless the step is small, too.
            other = np.where(is_met, x, 0.5 * (low + high))
            x = np.where(is_small | ((newton > low) & (newton < high)), newton, other)
            if np.all(is_small | is_met):
                break
        return panel, x

    def _guess(
        self, panel: NDArray[np.intp], half: FloatArray, lengths: FloatArray, share: FloatArray
    ) -> FloatArray:
        """Return about the place in its panel after a ``share`` of the panel's time.

        Time is taken for the power of the distance from the slower end that has the same rate at the other:
        next to a pole it is about that, and Newton's method alone would come near it by a part at a time.
        """
        even, odd = (self.rates[first::2, panel].sum(axis=0) * half for first in (0, 1))
        power = np.divide(2.0 * (even + np.abs(odd)), lengths, out=np.ones(len(share)), where=lengths > 0.0)
        is_slow_first = odd > 0.0
        since = np.where(is_slow_first, share, 1.0 - share) ** (1.0 / np.maximum(power, 1.0))
        guess: FloatArray = np.where(is_slow_first, 2.0 * since - 1.0, 1.0 - 2.0 * since)
        return guess

    def features(self) -> tuple[FloatArray, FloatArray]:
        """Return times inside every panel, and how long it takes: where a function of time may have features.

        What is narrow in time is in panels as narrow, which resolve it.
        """
        widths = np.diff(self.times)
        panels = np.repeat(np.arange(len(widths)), len(SPEED_POINTS))
        x = np.tile(np.array(SPEED_POINTS), len(widths))
        return self.times[panels] + sum_series(self.integrals, panels, x), widths[panels]

    def evidence(self) -> dict[str, float | int | str]:
        """Return what it took."""
        unproved: dict[str, float | int | str] = {"unproved_panels": self.unproved} if self.unproved else {}
        return {"nodes": self.nodes, "panels": len(self.edges) - 1, **unproved}

    def theta(self, panel: int, x: float) -> arb:
        """Return the phase θ = πu of a place, without rounding it to a double."""
        left, right = arb(float(self.edges[panel])), arb(float(self.edges[panel + 1]))
        # Sums of doubles, halved: exact, and the product nearly so.
        return arb.pi() * ((left + right) / 2 + (right - left) / 2 * x)


def sum_series(coefficients: FloatArray, panel: NDArray[np.intp], x: FloatArray) -> FloatArray:
    """Sum the series of each place's panel, of shape (terms, ..., panels)."""
    return _sum(coefficients[..., panel], x)


def _sum(series: FloatArray, x: FloatArray) -> FloatArray:
    """Sum series of shape (terms, ..., n) at places of shape (n,), by Clenshaw's recurrence."""
    first, second, twice = np.zeros(series.shape[1:]), np.zeros(series.shape[1:]), 2.0 * x
    for row in series[:0:-1]:
        next_one = twice * first
        next_one += row
        next_one -= second
        first, second = next_one, first
    result: FloatArray = series[0] + x * first - second
    return result
