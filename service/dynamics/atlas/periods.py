r"""Computes periods of many motions of one window at once, in doubles, with an error that is estimated.

Between two simple zeros of P, v = m − r cos θ makes dt = Z dv / (c √P) a smooth function of θ, and round a
whole loop it is periodic in v. The midpoint rule converges fast for both; the number of points is doubled
until two sums agree, and their difference is the estimate.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from service.dynamics.atlas.curves import PlainHalves
from service.dynamics.atlas.radicands import p_squared

FloatArray = NDArray[np.float64]

FEWEST, MOST = 16, 1024
AGREES = 1e-11
FLOOR = 1e-10
"""Relative error that rounding may bring: next to an end p² is the small difference of large terms."""
WORST = 1e-3
"""A period whose estimated relative error is larger is not told."""


def periods(
    half: PlainHalves, Z: FloatArray, G: FloatArray, lower: FloatArray, upper: FloatArray, *, is_loop: bool
) -> tuple[FloatArray, FloatArray]:
    """Return periods and their estimated errors; NaN where they are not known.

    Parameters
    ----------
    Z, G
        Of each λ, shape (λ, 1).
    lower, upper
        The ends v of the arc, shape (λ, 1), P being zero there; of a whole loop any v and v + 2π.
    """
    rate = _of_loop if is_loop else _between
    last = np.full(len(Z), np.nan)
    found, error = last.copy(), np.full(len(Z), np.inf)
    n = FEWEST
    while n <= MOST:
        with np.errstate(all="ignore"):
            now = rate(lambda v: _slowness(half, Z, G, v), lower, upper, n)
            change = np.abs(now - last)
            # NaN is no improvement.
            better = change < error
            found, error = np.where(better, now, found), np.where(better, change, error)
            if bool((error < AGREES * found).all()):
                break
        last, n = now, 2 * n
    with np.errstate(all="ignore"):
        error = error + FLOOR * found
        is_known = (error < WORST * found) & np.isfinite(found)
    return np.where(is_known, found, np.nan), np.where(is_known, error, np.nan)


def _slowness(half: PlainHalves, Z: FloatArray, G: FloatArray, v: FloatArray) -> FloatArray:
    """Return dt/dv = Z / (c √P)."""
    # The signs of a half belong to sin x; v goes round the whole loop, with the sign of g3 in sin v.
    P, c = p_squared(half, Z, G, half.shape.third_sign * np.sin(v), np.cos(v))
    slowness: FloatArray = Z / (c * np.sqrt(P))
    return slowness


def _between(
    rate: Callable[[FloatArray], FloatArray], lower: FloatArray, upper: FloatArray, n: int
) -> FloatArray:
    angle = (np.arange(n) + 0.5) * np.pi / n
    middle, radius = 0.5 * (lower + upper), 0.5 * (upper - lower)
    values = rate(middle - radius * np.cos(angle)) * radius * np.sin(angle)
    # There and back.
    total: FloatArray = 2.0 * np.pi / n * values.sum(axis=1)
    return total


def _of_loop(
    rate: Callable[[FloatArray], FloatArray], lower: FloatArray, upper: FloatArray, n: int
) -> FloatArray:
    steps = (np.arange(n) + 0.5) / n
    values = rate(lower + (upper - lower) * steps)
    total: FloatArray = ((upper - lower)[:, 0] / n) * values.sum(axis=1)
    return total
