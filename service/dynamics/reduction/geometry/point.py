r"""A point of the loop from sin v and cos v: in balls, on ranges of v and in doubles, to all digits.

With s = |sin v| and u = cos² v,

.. math:: |g_1| = G s^\alpha,\quad g_2 = c\cos v,\quad g_3 = Z\sin v,\qquad
          c^2 = Z^2 + G^2 R,\qquad R = \frac{1 - s^{2\alpha}}{u},

and at the equator, u = 0, both the numerator and u vanish. The logarithm of s is therefore taken from u where
u is not near 1, and 1 − s^{2α} from that logarithm by expm1.

The complex loop (:mod:`workers.solvers.complex_plane.complex_loop`) has formulas of its own: powers have
branches there, and which formula holds is told by the half plane that a ball is in.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from flint import arb
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
T = TypeVar("T", arb, FloatArray)

FAR = 0.75
"""The largest u from which log s is taken: for larger ones 1 − u loses digits, and s has them."""


class Equator(NamedTuple, Generic[T]):
    """The numbers that all points of one loop have in common."""

    Z: T
    G: T
    Z_squared: T
    G_squared: T
    alpha: T
    twice_alpha: T


@dataclass(frozen=True, slots=True)
class LoopFunctions(Generic[T]):
    """The functions that a point is made of, in one arithmetic."""

    log_sine: Callable[[T, T], T]
    """log |sin v| from sin v and u."""
    c_squared: Callable[[Equator[T], T, T], T]
    """c² from log |sin v| and u."""
    exp: Callable[[T], T]
    sqrt: Callable[[T], T]


def make_equator(Z: T, G: T, alpha: T) -> Equator[T]:
    """Return the equator of a loop."""
    return Equator(Z, G, Z * Z, G * G, alpha, 2 * alpha)


def place_of(functions: LoopFunctions[T], sine: T, cosine: T, equator: Equator[T]) -> tuple[T, T, T, T]:
    """Return |g1|, g2, g3, and c = g2 / cos v, at a place of a loop with sin v ≠ 0."""
    square = cosine * cosine
    log_sine = functions.log_sine(sine, square)
    c = functions.sqrt(functions.c_squared(equator, log_sine, square))
    size = functions.exp(equator.alpha * log_sine)
    return equator.G * size, cosine * c, equator.Z * sine, c


def _log_sine_ball(sine: arb, square: arb) -> arb:
    return (-square).log1p() / 2 if square < FAR else abs(sine).log()


def _c_squared_ball(at: Equator[arb], log_sine: arb, square: arb) -> arb:
    return at.Z_squared - at.G_squared * (at.twice_alpha * log_sine).expm1() / square


def _c_squared_range(at: Equator[arb], log_sine: arb, square: arb) -> arb:
    if not square.contains(0):
        return _c_squared_ball(at, log_sine, square)
    edge = square.upper()
    return at.Z_squared + at.G_squared * at.alpha.union(-(at.alpha * (-edge).log1p()).expm1() / edge)


def _log_sine_real(sine: FloatArray, square: FloatArray) -> FloatArray:
    return np.where(square < FAR, 0.5 * np.log1p(-np.minimum(square, FAR)), np.log(np.abs(sine)))


def _c_squared_real(at: Equator[FloatArray], log_sine: FloatArray, square: FloatArray) -> FloatArray:
    numerator, divisor = -np.expm1(at.twice_alpha * log_sine), np.where(square > 0.0, square, 1.0)
    return at.Z_squared + at.G_squared * np.where(square > 0.0, numerator / divisor, at.alpha)


BALLS: LoopFunctions[arb] = LoopFunctions(_log_sine_ball, _c_squared_ball, arb.exp, arb.sqrt)
"""Balls at the current precision; c is not finite where the ball of u contains 0."""
RANGES: LoopFunctions[arb] = LoopFunctions(_log_sine_ball, _c_squared_range, arb.exp, arb.sqrt)
"""The same on balls of u that may contain 0: R falls from its limit α as u grows."""
REALS: LoopFunctions[FloatArray] = LoopFunctions(_log_sine_real, _c_squared_real, np.exp, np.sqrt)
"""Doubles; numpy's warnings must be off."""
