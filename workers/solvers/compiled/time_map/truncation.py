r"""Bounds on whole panels what the series of dt/du leave out.

With f = dt/du and Q = 1/f², let p and q be the polynomials of degree NODES − 1 that have the values of f and
Q at the nodes. Then p² q − 1 vanishes at all of them: it is T_16 R, and R, of degree 3 · 15 − 16 = 29, is
known by its values at 32 other nodes, where |T_16| = √½. Q is c² K/(π Z)², with no root and no division
by what may be small: where |Q| ≤ M in the ellipse ρ of the panel,

.. math:: |Q - q| \le 4 M ρ^{-15}/(ρ - 1), \qquad |p/f - 1| \le \sqrt{1 + η} - 1,
          \quad η = \sum |R_k| + \max p² \max|Q - q|.

The ellipse lies in a disc of radius (ρ + 1/ρ)/2 about the middle of the panel, on which the formula is
bounded (:mod:`compiled.discs.on_loop`). Between rest points v = m − h cos θ, θ = πu, and K = P/(h² sin² θ):
by the maximum principle |h² sin² θ| counts on the circle only, also where it vanishes inside.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.discs.on_loop import derivatives_on_discs, put_disc, put_squares
from workers.solvers.compiled.discs.rows import SAME_POWER
from workers.solvers.compiled.evaluation.curve import place
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import Formula, Loop
from workers.solvers.compiled.workspace import LANES, DiscWorkspace

FloatArray = NDArray[np.float64]

DEGREE = 15
ELLIPSES = np.array([4.5, 6.0, 8.0, 11.0])
PANELS_TOGETHER = LANES // len(ELLIPSES)
"""Number of panels that are bounded together."""
ROUNDING_FACTOR = 1.0 + 2.0**-40
"""Factor that covers the roundings of a few bounds that are multiplied."""
LARGEST_ETA = 0.25
"""The largest η of which the theorem is used."""
SERIES_ROUNDING = 2.0**-51
"""Relative, of a series at a place. Coefficients below it are rounding, which is counted once; that of dt/du
itself is bounded elsewhere (:mod:`.error`)."""

_HALF = 16
_NODES = np.sin(np.pi * (2 * np.arange(_HALF) + 1) / 64)
"""The positive zeros of T_32, growing."""
_T = np.polynomial.chebyshev.chebvander(_NODES, 31)
EVEN = np.ascontiguousarray(_T[:, 0:16:2].T)
ODD = np.ascontiguousarray(_T[:, 1:16:2].T)
"""T_k at the nodes, for even and for odd k < 16: shape (8, 16)."""
_TO_R = _T / (8.0 * _T[:, 16:17])
_TO_R[:, 0] *= 0.5
TO_EVEN = np.ascontiguousarray(_TO_R[:, 0::2])
TO_ODD = np.ascontiguousarray(_TO_R[:, 1::2])
"""Matrices from even and odd parts of T_16 R at the nodes to coefficients of R: shape (nodes 16, 16)."""


@kernel
def seen_between(p: FloatArray, q: FloatArray) -> float:
    """Return Σ|R_k| of two series of degree DEGREE, and what rounding may do to it."""
    a, b, c, d = np.zeros(_HALF), np.zeros(_HALF), np.zeros(_HALF), np.zeros(_HALF)
    for k in range(8):
        s, t, u, w = p[2 * k], p[2 * k + 1], q[2 * k], q[2 * k + 1]
        for i in range(_HALF):
            a[i] += EVEN[k, i] * s
            b[i] += ODD[k, i] * t
            c[i] += EVEN[k, i] * u
            d[i] += ODD[k, i] * w
    for i in range(_HALF):
        right, left = a[i] + b[i], a[i] - b[i]
        right, left = right * right * (c[i] + d[i]) - 1.0, left * left * (c[i] - d[i]) - 1.0
        a[i], b[i] = 0.5 * (right + left), 0.5 * (right - left)
        c[i], d[i] = 0.0, 0.0
    for i in range(_HALF):
        s, t = a[i], b[i]
        for k in range(_HALF):
            c[k] += TO_EVEN[i, k] * s
            d[k] += TO_ODD[i, k] * t
    total = 0.0
    for k in range(_HALF):
        total += max(abs(c[k]) - SERIES_ROUNDING, 0.0) + max(abs(d[k]) - SERIES_ROUNDING, 0.0)
    return total + 4.0 * SERIES_ROUNDING


@inlined
def _least_sine(theta: float, radius: float) -> float:
    """Return a lower bound of |sin| on the circle around a real centre, 0 if it is not known."""
    least = math.inf
    for k in range(-1, 3):
        # |sin δ| ≥ sin |δ| for |δ| ≤ π/2, and more further off.
        least = min(least, abs(abs(theta - k * math.pi) - radius))
    return math.sin(min(least, 0.5 * math.pi)) if radius < 3.0 else 0.0


@kernel
def _size_by_roots(loop: Loop, square: float, square_r: float) -> float:
    """Return a bound of |P| from its roots in x = G sin² v; see :func:`.factor_by_roots`."""
    size = loop.g
    x, wide = size * square, size * square_r
    kind, mu = loop.ends, loop.mu
    first, second = size * loop.s_lower**2, size * loop.s_upper**2
    low, high = (min(first, second), max(first, second)) if kind else (0.0, size)
    if kind == 1:
        high = size
    elif kind == 2:
        low = 0.0
    value = loop.leading
    if kind == 1 or kind >= 3:
        value *= abs(x - low) + wide
    if kind >= 2:
        value *= abs(x - high) + wide
    if mu > 0.0:
        value *= (x - wide) ** -mu if x > wide else math.nan
    elif mu < 0.0:
        value *= (x + wide) ** -mu
    for k in range(loop.reals):
        away = loop.roots[k, 1]
        root = low - away if loop.roots[k, 0] < 0.0 else high + away
        value *= abs(x - root) + wide
    for k in range(loop.reals, loop.reals + loop.pairs):
        away = abs(x - loop.roots[k, 0]) + wide
        value *= away * away + loop.roots[k, 1] * loop.roots[k, 1]
    return float(value)


@kernel
def bound_left_out(
    formula: Formula, loop: Loop, middles: FloatArray, count: int, discs: DiscWorkspace, left_out: FloatArray
) -> None:
    """Fill in a bound of |Q − q| on panels given by rows (anchor, w in the middle, half width); inf: none."""
    number = len(ELLIPSES)
    rotates, by_roots = loop.rotates, loop.by_roots
    least = np.ones(LANES)
    for n in range(count):
        anchor, w = int(middles[n, 0]), middles[n, 1]
        _, _, sine, cosine, _ = place(loop, anchor, w)
        theta = math.pi * (0.5 * anchor + w)
        for k in range(number):
            rho = ELLIPSES[k]
            radius = 0.5 * (rho + 1.0 / rho) * math.pi * middles[n, 2] * ROUNDING_FACTOR
            lane = number * n + k
            if not rotates:
                h = loop.half_width
                sine_least = h * _least_sine(theta, radius)
                least[lane] = sine_least * sine_least
                even = 2.0 * math.sinh(0.5 * radius) ** 2
                radius = (
                    h
                    * (abs(math.cos(theta)) * even + abs(math.sin(theta)) * math.sinh(radius))
                    * ROUNDING_FACTOR
                )
            put_disc(discs, lane, sine, cosine, radius)
    lanes = number * count
    row = 0
    leading = 0.0
    if by_roots:
        put_squares(loop, discs, lanes)
    else:
        row = derivatives_on_discs(formula, loop, discs, lanes)
        leading = formula.discs.powers[row] + 1.0 - loop.alpha
    unit = 1.0 / (math.pi * loop.z) ** 2
    for n in range(count):
        best = math.inf
        for k in range(number):
            m = number * n + k
            if by_roots:
                s = discs.s_centre[m]
                size = _size_by_roots(loop, s * s, discs.t_radius[m])
            else:
                size = (abs(formula.discs.centres[row, m]) + formula.discs.radii[row, m]) * _scale(
                    discs.s_centre[m], discs.s_radius[m], leading
                )
                size *= loop.factor * loop.z / loop.g
            size *= (discs.square[m] + discs.square_radius[m]) * unit / least[m] * ROUNDING_FACTOR
            rho = ELLIPSES[k]
            bound = 4.0 * size * rho**-DEGREE / (rho - 1.0)
            if bound < best:
                best = bound
        left_out[n] = best


@inlined
def _scale(s: float, radius: float, exponent: float) -> float:
    """Return a bound of |s^exponent| on a disc, NaN where it is not analytic."""
    if abs(exponent) <= SAME_POWER:
        return 1.0
    if exponent > 0.0:
        return (s + radius) ** exponent if radius < s or exponent == math.floor(exponent) else math.nan
    return (s - radius) ** exponent if radius < s else math.nan
