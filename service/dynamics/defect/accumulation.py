r"""The integrated defect of a function of time, on pieces that are cut until the equations are bounded.

.. math:: D(t) = y_p(t) - y_p(t_0) - \int_{t_0}^t F(y_p)\,dt .

Nothing is differentiated, so the rounding of D is that of y_p and of F, where that of y_p' − F(y_p) would be
larger by the square of the degree over the length of a piece. F(y_p) is interpolated in N + 1 points of every
stretch and integrated exactly; what that leaves out is bounded as below, so the bound of |D|
holds on the whole of every settled stretch.

Let y_p be the polynomial of a piece and F the right-hand sides. F(y_p(t)) is analytic, and bounded by M, on
the ellipse with the foci at the ends of a stretch and the sum ρ of its semi-axes (the half length being 1),
if it is so on discs around the values that y_p takes there. Then what interpolates F(y_p) in N + 1 Chebyshev
points departs from it by at most

.. math:: \frac{4 M \rho^{-N}}{\rho - 1}

on the whole stretch (Trefethen, Approximation Theory and Approximation Practice, theorem 8.2).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from service.dynamics.solution.dense_output import DenseOutput, chebyshev_coefficients, chebyshev_points

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
DEFAULT_INTERVALS = 32
"""N, where the degree of the pieces is not higher."""
ELLIPSE_RHO = 4.0
ELLIPSE_SEMI_AXIS = 0.5 * (ELLIPSE_RHO + 1.0 / ELLIPSE_RHO)
"""The ellipse lies in the disc of this radius, in half lengths, about the middle."""
CUT_PARTS = 4
"""Number of parts into which a stretch is cut."""
MAX_CUTS = 20
"""Largest number of cuts: 2^-40 of a piece."""
PIECES_WITH_PARTS = 64
"""Pieces that are looked at together with their parts."""
MAX_STRETCHES_CUT = 512
"""Stretches of a generation that are cut: where values are lost in rounding, their number grows with each."""
SERIES_RELATIVE_ROUNDING = 2.0**-48
"""Rounding error of sums of a Chebyshev series, relative to the sum of its absolute values."""
Bound = Callable[[FloatArray, FloatArray], FloatArray]
"""Returns bounds of the six rates on discs, given centres and radii, shape (6, n) all; NaN for none."""


@dataclass(frozen=True, slots=True)
class Stretches:
    """Parts of pieces in the order of time: within ``half`` of ``middle`` in [−1, 1]."""

    piece: IntArray
    middle: FloatArray
    half: FloatArray
    tail: FloatArray
    """Bound of what interpolated rates leave out of the true ones, shape (n, 6); NaN where there is none."""

    @property
    def is_settled(self) -> NDArray[np.bool_]:
        """Mask of the stretches that have a bound, shape (n,)."""
        return np.asarray(np.isfinite(self.tail).all(axis=1))


@dataclass(frozen=True, slots=True)
class _Places:
    """Positions of stretches; see :class:`Stretches`."""

    piece: IntArray
    middle: FloatArray
    half: FloatArray

    def only(self, chosen: NDArray[np.bool_]) -> "_Places":
        return _Places(self.piece[chosen], self.middle[chosen], self.half[chosen])

    def parts(self) -> "_Places":
        """Return the parts of each, in their order."""
        smaller = self.half.repeat(CUT_PARTS) / CUT_PARTS
        places = np.tile(np.arange(1.0 - CUT_PARTS, CUT_PARTS, 2.0), len(self.piece))
        return _Places(
            self.piece.repeat(CUT_PARTS), self.middle.repeat(CUT_PARTS) + places * smaller, smaller
        )

    def and_parts(self) -> "_Places":
        """Return these, and after them the parts of each."""
        parts = self.parts()
        return _Places(
            np.concatenate([self.piece, parts.piece]),
            np.concatenate([self.middle, parts.middle]),
            np.concatenate([self.half, parts.half]),
        )


def intervals_for(degree: int) -> int:
    """Return N for pieces of this degree, which the points must resolve as well."""
    return max(DEFAULT_INTERVALS, degree + 8)


class Cutter:
    """Cuts the same pieces for one goal or for several: what does not depend on the goal is found once.

    Parameters
    ----------
    coefficients
        Of the pieces, shape (pieces, degree + 1, 6).
    lengths
        Their lengths in time, shape (pieces,).
    """

    def __init__(self, coefficients: FloatArray, lengths: FloatArray, bound: Bound) -> None:
        self._lengths, self._bound = lengths, bound
        self._factor = 4.0 * ELLIPSE_RHO ** -intervals_for(coefficients.shape[1] - 1) / (ELLIPSE_RHO - 1.0)
        self._geometry = _Geometry(coefficients)
        self._first: FloatArray | None = None

    @np.errstate(all="ignore")
    def cut(self, goal: float) -> Stretches:
        """Cut the pieces until the integral of what interpolation leaves out is below ``goal`` in all.

        The goal is shared out by length. What cannot be settled stays without a bound.
        """
        allowed = goal / float(self._lengths.sum())
        count = len(self._lengths)
        waiting = _Places(np.arange(count), np.zeros(count), np.ones(count))
        # The parts of few pieces cost next to nothing beside these.
        ahead = np.zeros((0, 6))
        done: list[Stretches] = []
        for generation in range(MAX_CUTS + 1):
            if generation == 0:
                bounds = self._first_tails(waiting)
                tail, ahead = bounds[:count].copy(), bounds[count:].copy()
            elif len(ahead):
                tail, ahead = ahead, ahead[:0]
            else:
                tail = self._tails(waiting)
            is_done = np.asarray((tail <= allowed).all(axis=1))
            is_last = generation == MAX_CUTS or np.count_nonzero(~is_done) > MAX_STRETCHES_CUT + count
            kept = np.ones_like(is_done) if is_last else is_done
            tail[~is_done] = np.nan
            done.append(Stretches(waiting.piece[kept], waiting.middle[kept], waiting.half[kept], tail[kept]))
            if kept.all():
                break
            waiting = waiting.only(~kept).parts()
            ahead = ahead[(~kept).repeat(CUT_PARTS)] if len(ahead) else ahead
        return _in_order(done)

    def _tails(self, places: _Places) -> FloatArray:
        tails: FloatArray = self._factor * self._bound(*self._geometry.discs(places)).T
        return tails

    def _first_tails(self, whole: _Places) -> FloatArray:
        """Return the tails of the whole pieces, and of few ones those of their parts too."""
        if self._first is None:
            self._first = self._tails(whole.and_parts() if len(self._lengths) <= PIECES_WITH_PARTS else whole)
        return self._first


class _Geometry:
    """Discs around what the polynomials of pieces take on the ellipses of stretches."""

    def __init__(self, coefficients: FloatArray) -> None:
        k = np.arange(coefficients.shape[1], dtype=np.float64)
        self._sizes = np.abs(coefficients)
        self._coefficients = coefficients
        self._slopes: FloatArray = np.polynomial.chebyshev.chebder(coefficients, axis=1).astype(np.float64)
        self._degrees = k
        self._total = self._sizes.sum(axis=1)
        # |T_k(z) - T_k(0)| on the ellipse of a whole piece.
        growth = 0.5 * (ELLIPSE_RHO**k + ELLIPSE_RHO**-k) + (k % 2 == 0)
        growth[0] = 0.0
        self._whole = np.einsum("k,pkc->pc", growth, self._sizes)

    def discs(self, places: _Places) -> tuple[FloatArray, FloatArray]:
        """Return centres and radii, shape (6, n) each."""
        piece, middle, half = places.piece, places.middle, places.half
        is_whole = half == 1.0
        if is_whole.all():
            even = self._coefficients[piece, ::2]
            signs = np.where(np.arange(even.shape[1]) % 2 == 0, 1.0, -1.0)
            centre, radius = np.einsum("k,pkc->pc", signs, even), self._whole[piece]
        else:
            centre, radius = _values(self._coefficients[piece], middle), self._radius(piece, middle, half)
            radius[is_whole] = self._whole[piece[is_whole]]
        return centre.T, (radius + SERIES_RELATIVE_ROUNDING * self._total[piece]).T

    def _radius(self, piece: IntArray, middle: FloatArray, half: FloatArray) -> FloatArray:
        r"""Bound |y(z) − y(m)| for |z − m| ≤ s by the value of the slope, or by slopes about the stretch.

        Within s of [−1, 1] one is inside the ellipse of ρ = a + √(a² − 1), a = 1 + s, where a polynomial
        of degree k is at most ρ^k times its bound on [−1, 1] (Bernstein); T_k' is at most k² there, and
        T_k'' at most k² (k² − 1)/3.
        """
        k, s = self._degrees, ELLIPSE_SEMI_AXIS * half[:, None]
        rho = 1.0 + s + np.sqrt(s * (2.0 + s))
        sizes = self._sizes[piece]
        first = np.einsum("nk,nkc->nc", k**2 * rho ** np.maximum(k - 1.0, 0.0), sizes)
        second = np.einsum("nk,nkc->nc", k**2 * (k**2 - 1.0) / 3.0 * rho ** np.maximum(k - 2.0, 0.0), sizes)
        slope = np.abs(_values(self._slopes[piece], middle)) + SERIES_RELATIVE_ROUNDING * np.einsum(
            "k,nkc->nc", k**2, sizes
        )
        radius: FloatArray = np.minimum(s * first, s * slope + 0.5 * s * s * second) * (
            1.0 + SERIES_RELATIVE_ROUNDING
        )
        return radius


def _values(coefficients: FloatArray, x: FloatArray) -> FloatArray:
    """Return each series at its own place, shape (n, 6)."""
    powers = np.polynomial.chebyshev.chebvander(x, coefficients.shape[1] - 1)
    values: FloatArray = np.einsum("nk,nkc->nc", powers, coefficients)
    return values


def _in_order(parts: list[Stretches]) -> Stretches:
    piece = np.concatenate([part.piece for part in parts])
    middle = np.concatenate([part.middle for part in parts])
    order = np.lexsort((middle, piece))
    return Stretches(
        piece[order],
        middle[order],
        np.concatenate([part.half for part in parts])[order],
        np.concatenate([part.tail for part in parts])[order],
    )


_PIECES_TOGETHER = 1024  # pieces whose nodes are in memory at once
Evaluate = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Returns F, shape (n, 6), and the three integrals, shape (n, 3), at states, shape (n, 6)."""


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
