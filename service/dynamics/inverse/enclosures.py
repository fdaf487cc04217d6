"""Tabulates functions of one variable as doubles with errors, from balls of sufficient precision."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, isfinite, nan, nextafter

import numpy as np
from flint import arb, ctx
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
BallFunction = Callable[[arb], arb]

PRECISIONS = (96, 192, 384, 768, 1536)
"""Bits, in turn, until a ball is narrow."""
_BITS_OF_ZERO = 384
"""A ball with so many bits that still has 0 in it is taken for 0: a value that is 0 is never narrow."""
_RELATIVE_RADIUS = 2.0**-56
"""Relative radius that is lost in the rounding to a double."""


@dataclass(frozen=True, slots=True)
class Values:
    """Doubles and bounds of their errors, of one shape; where there is no value, NaN ± ∞."""

    value: FloatArray
    error: FloatArray


def enclose(function: BallFunction, points: ArrayLike) -> Values:
    """Return ``function`` at doubles of any shape, each with a rigorous bound of its error."""
    points = np.asarray(points, dtype=np.float64)
    pairs = [_value_at(function, x) for x in points.ravel().tolist()]
    value, error = np.array(pairs, dtype=np.float64).reshape(-1, 2).T
    return Values(value.reshape(points.shape).copy(), error.reshape(points.shape).copy())


def _value_at(function: BallFunction, x: float) -> tuple[float, float]:
    best = nan, inf
    for bits in PRECISIONS:
        with ctx.workprec(bits):
            ball = function(arb(x))
            if not ball.is_finite():
                continue
            if bits >= _BITS_OF_ZERO and ball.contains(0):
                # The midpoint would be noise, which no quadrature of the function could resolve.
                return 0.0, _upwards(float(ball.abs_upper()))
            value = float(ball.mid())
            error = _upwards(float((ball - arb(value)).abs_upper()))
            if isfinite(value) and error < best[1]:
                best = value, error
            if ball.rad() <= _RELATIVE_RADIUS * abs(ball.mid()):
                break
    return best


def _upwards(bound: float) -> float:
    """Return a double that is no less than what was rounded to ``bound``; 0 was not rounded."""
    return nextafter(bound, inf) if bound else 0.0
