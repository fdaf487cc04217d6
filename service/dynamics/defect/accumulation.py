r"""The integrated defect of a function of time: what it leaves of the differential equations.

.. math:: D(t) = y_p(t) - y_p(t_0) - \int_{t_0}^t F(y_p)\,dt .

Nothing is differentiated, so the rounding of D is that of y_p and of F, where that of y_p' − F(y_p) would be
larger by the square of the degree over the length of a piece. F(y_p) is interpolated in N + 1 points of every
stretch and integrated exactly; what that leaves out is bounded by :mod:`.stretches`, so the bound of |D|
holds on the whole of every settled stretch.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from service.dynamics.defect.stretches import Cutter, Stretches, intervals_for
from service.dynamics.solution.dense_output import DenseOutput, chebyshev_coefficients, chebyshev_points

FloatArray = NDArray[np.float64]

_PIECES_TOGETHER = 1024  # pieces whose nodes are in memory at once

Evaluate = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Returns F, shape (n, 6), and the three integrals, shape (n, 3), at states, shape (n, 6)."""
Bound = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class StretchBatch:
    """Stretches of some pieces with the states at their nodes."""

    stretches: Stretches
    times: FloatArray
    """Half the length of each stretch in time, shape (n,)."""
    states: FloatArray
    """At the nodes, from the end of a stretch to its beginning, shape (n, N + 1, 6)."""
    rates: FloatArray
    """F of the states."""
    integrals: FloatArray
    """Energy, areas integral and γ·γ of the states, shape (n, N + 1, 3)."""


@dataclass(frozen=True, slots=True)
class Accumulated:
    """D along the stretches; shapes (n,) and (n, 6)."""

    starts: FloatArray
    """Times at which the stretches begin, and the last one's end, shape (n + 1,)."""
    before: FloatArray
    """D at the beginning of each stretch, rounded."""
    within: FloatArray
    """Bound of how far D goes from there on the stretch."""
    is_settled: NDArray[np.bool_]
    truncation: float
    """Bound of what truncation adds to the bounds at most."""

    @property
    def sizes(self) -> FloatArray:
        """Bounds of the largest |D| of any column on each stretch, shape (n,)."""
        sizes: FloatArray = (np.abs(self.before) + self.within).max(axis=1, initial=0.0)
        return sizes

    @property
    def settled_share(self) -> float:
        """Share of the time for which the bounds hold."""
        spans = np.diff(self.starts)
        whole = float(spans.sum())
        return float(spans[self.is_settled].sum()) / whole if whole != 0.0 else 1.0


class Blocks:
    """The pieces of ``dense``, some at a time; without a ``bound`` they stay whole and without one."""

    def __init__(self, dense: DenseOutput, evaluate: Evaluate, bound: Bound | None) -> None:
        self._dense, self._evaluate, self._bound = dense, evaluate, bound
        self._lengths = np.diff(dense.breaks)
        self._cutters: dict[int, Cutter] = {}
        self._found: dict[int, tuple[Stretches, StretchBatch]] = {}

    def cut(self, goal: float) -> Iterator[StretchBatch]:
        """Yield the stretches for a goal; those cut as for the goal before are not evaluated anew."""
        whole = float(self._lengths.sum())
        for first in range(0, len(self._lengths), _PIECES_TOGETHER):
            found = self._stretches(first, goal, whole)
            known = self._found.get(first)
            if known is None or not _are_equal(known[0], found):
                known = self._found[first] = found, self._batch(first, found)
            # Bounds are finite only where the goal is met.
            stretches = replace(known[1].stretches, tail=found.tail)
            yield replace(known[1], stretches=stretches)

    def _stretches(self, first: int, goal: float, whole: float) -> Stretches:
        part = slice(first, first + _PIECES_TOGETHER)
        spans = self._lengths[part]
        if self._bound is None:
            count = len(spans)
            none = np.full((count, 6), np.nan)
            return Stretches(np.arange(count), np.zeros(count), np.ones(count), none)
        if first not in self._cutters:
            self._cutters[first] = Cutter(self._dense.coefficients[part], spans, self._bound)
        return self._cutters[first].cut(goal * float(spans.sum()) / whole)

    def _batch(self, first: int, found: Stretches) -> StretchBatch:
        part = slice(first, first + _PIECES_TOGETHER)
        states = _states(self._dense.coefficients[part], found)
        halves = 0.5 * self._lengths[part][found.piece] * found.half
        rates, integrals = self._evaluate(states.reshape(-1, 6))
        moved = Stretches(found.piece + first, found.middle, found.half, found.tail)
        shape = states.shape[:2]
        rates = rates.reshape(*shape, 6)
        if self._bound is None:
            rates = _with_known_ends(rates)
        return StretchBatch(moved, halves, states, rates, integrals.reshape(*shape, 3))


def _with_known_ends(rates: FloatArray) -> FloatArray:
    """Return the rates; where they are unknown at one end of a stretch alone, continued from its other nodes.

    A motion through a pole is smooth on either side of it, and at the pole itself F has no value.
    """
    for end in (0, -1):
        others = np.delete(np.arange(rates.shape[1]), end)
        lost = ~np.isfinite(rates[:, end]).all(axis=1) & np.isfinite(rates[:, others]).all(axis=(1, 2))
        if lost.any():
            weights = _continuation(rates.shape[1] - 1)
            known = rates[lost][:, others if end == 0 else others[::-1]]
            rates[lost, end] = np.einsum("k,nkc->nc", weights, known)
    return rates


@cache
def _continuation(intervals: int) -> FloatArray:
    """Return what makes the value at the first node from the others', by the polynomial through these."""
    points = chebyshev_points(intervals)
    away = points[0] - points[1:]
    apart = points[1:, None] - points[None, 1:]
    np.fill_diagonal(apart, 1.0)
    ratios = away[None, :] / apart
    np.fill_diagonal(ratios, 1.0)
    return np.asarray(ratios.prod(axis=1))


def _are_equal(one: Stretches, other: Stretches) -> bool:
    """Tell whether pieces are cut at the same places, whatever the bounds."""
    return (
        np.array_equal(one.piece, other.piece)
        and np.array_equal(one.middle, other.middle)
        and np.array_equal(one.half, other.half)
    )


@np.errstate(all="ignore")
def defect_within(block: StretchBatch) -> tuple[FloatArray, FloatArray]:
    """Return ∫F over each stretch, and the bound of |D| on it if D is 0 at its beginning; shape (n, 6) each.

    The bound holds where the stretch is settled; elsewhere it is that of the interpolated F.
    """
    states = block.states
    transform, integral = _matrices(states.shape[1] - 1)
    gained = block.times[:, None, None] * (integral @ block.rates)
    series = -gained
    series[:, :-1] += transform @ states
    series[:, 0] -= states[:, -1]
    tail = 2.0 * block.times[:, None] * block.stretches.tail
    return gained.sum(axis=1), np.abs(series).sum(axis=1) + np.where(np.isfinite(tail), tail, 0.0)


@np.errstate(all="ignore")
def accumulate(
    dense: DenseOutput,
    blocks: list[StretchBatch],
    *,
    has_bounds: bool,
    excused: FloatArray | None = None,
) -> Accumulated:
    """Return D from t = 0 on, both ways; if there are bounds of F, of settled stretches only.

    From the growth of D on each stretch as much as is ``excused`` is left out, shape (n, 6): all of it where
    that is not finite.
    """
    ends, steps, within, settled, first = [], [], [], [], 0
    for block in blocks:
        states = block.states
        step, extent = defect_within(block)
        is_settled = block.stretches.is_settled & np.isfinite(extent).all(axis=1)
        lost = ~is_settled if has_bounds else ~np.isfinite(step).all(axis=1)
        # Where F is not known nothing is found: D stays what it is. At a kink or next to a pole F may
        # depend on the rounding of y_p, and says nothing.
        step[lost] = (states[:, 0] - states[:, -1])[lost]
        extent[lost] = 0.0
        if excused is not None:
            free = np.nan_to_num(excused[first : first + len(step)], nan=np.inf)
            step += np.clip((states[:, 0] - states[:, -1]) - step, -free, free)
            extent = np.maximum(extent - free, 0.0)
            first += len(step)
        ends.append(states[:, [-1, 0]])
        steps.append(step)
        within.append(extent)
        settled.append(is_settled)
    starts = _starts(dense, [block.stretches for block in blocks])
    tails = np.concatenate([2.0 * block.times[:, None] * block.stretches.tail for block in blocks])
    tails = np.where(np.isfinite(tails), tails, 0.0)
    gone = np.cumsum(np.concatenate(steps).astype(np.longdouble), axis=0)
    states = np.concatenate(ends)
    before = np.vstack([np.zeros((1, 6)), (states[1:, 0] - states[0, 0]) - gone[:-1]])
    origin = int(np.argmin(np.abs(starts[:-1])))
    missing = np.abs(np.cumsum(tails, axis=0) - tails - np.cumsum(tails, axis=0)[origin])
    return Accumulated(
        starts,
        (before - before[origin]).astype(np.float64),
        np.concatenate(within) + missing,
        np.concatenate(settled),
        float(tails.sum(axis=0).max()),
    )


def _starts(dense: DenseOutput, stretches: list[Stretches]) -> FloatArray:
    piece = np.concatenate([part.piece for part in stretches])
    begins = np.concatenate([part.middle - part.half for part in stretches])
    left, right = dense.breaks[piece], dense.breaks[piece + 1]
    return np.append(left + (right - left) * (0.5 * (1.0 + begins)), dense.breaks[-1])


def _states(coefficients: FloatArray, stretches: Stretches) -> FloatArray:
    degree = coefficients.shape[1] - 1
    points = chebyshev_points(intervals_for(degree))
    chosen = coefficients[stretches.piece]
    states = np.polynomial.chebyshev.chebvander(points, degree) @ chosen
    cut_ones = stretches.half < 1.0
    if cut_ones.any():
        x = stretches.middle[cut_ones, None] + stretches.half[cut_ones, None] * points
        states[cut_ones] = np.polynomial.chebyshev.chebvander(x, degree) @ chosen[cut_ones]
    return states


@cache
def _matrices(intervals: int) -> tuple[FloatArray, FloatArray]:
    """Return what makes series of values at the nodes, and series of the integrals from −1 on."""
    transform = chebyshev_coefficients(np.eye(intervals + 1))
    integral = np.polynomial.chebyshev.chebint(transform, lbnd=-1.0, axis=0).astype(np.float64)
    return transform, integral
