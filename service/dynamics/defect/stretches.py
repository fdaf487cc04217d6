r"""Pieces of a function of time, cut until the differential equations are bounded about each stretch.

Let y_p be the polynomial of a piece and F the right-hand sides. F(y_p(t)) is analytic, and bounded by M, on
the ellipse with the foci at the ends of a stretch and the sum ρ of its semi-axes (the half length being 1),
if it is so on discs around the values that y_p takes there. Then what interpolates F(y_p) in N + 1 Chebyshev
points departs from it by at most

.. math:: \frac{4 M \rho^{-N}}{\rho - 1}

on the whole stretch (Trefethen, Approximation Theory and Approximation Practice, theorem 8.2).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
