r"""A point of the loop from sin v and cos v, with its derivatives by v and its speed, in any arithmetic.

With s = |sin v| and u = cos² v,

.. math:: |g_1| = G s^\alpha,\quad g_2 = c\cos v,\quad g_3 = Z\sin v,\qquad
          c^2 = Z^2 + G^2 R,\qquad R = \frac{1 - s^{2\alpha}}{u},

.. math:: P = W (h - V),\quad W = \frac{2C}{A E},\quad E = C + A \frac{G^2}{Z^2} s^{2\alpha-2},\quad
          \frac{r}{p} = -\frac{A g_1}{C g_3},\quad
          \frac{dg_2}{dv} = -\frac{\sin v}{C c} (A G^2 s^{2\alpha-2} + C Z^2)

in primed axes, where A > C and α = A/C. At the equator, u = 0, both the numerator of R and u vanish. For real
v the logarithm of s is therefore taken from u where u is not near 1, and 1 − s^{2α} from that by expm1. For
complex v (:mod:`workers.solvers.complex_plane.complex_loop`) powers have branches, and which formula of them
holds is told by the half plane that a ball is in.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.formula.algebra import Arithmetic, RingElement

FloatArray = NDArray[np.float64]
T = TypeVar("T", arb, FloatArray)
R = TypeVar("R", bound=RingElement)
R_co = TypeVar("R_co", bound=RingElement, covariant=True)
N = TypeVar("N", bound=Arithmetic)

FAR = 0.75
"""The largest u from which log s is taken: for larger ones 1 − u loses digits, and s has them."""


class LoopNumbers(NamedTuple, Generic[R]):
    """The numbers of a loop."""

    first: R
    """G with the sign of the primed g1."""
    Z: R
    alpha: R
    beyond: R
    """α − 1."""
    A: R
    C: R
    mirrored: bool


class PlaceOnLoop(Protocol[R_co]):
    """A place of a loop."""

    @property
    def sine(self) -> R_co:
        """Sin v."""

    @property
    def cosine(self) -> R_co:
        """Cos v."""

    @property
    def power(self) -> R_co:
        """|sin v|^(α−1), or its opposite."""

    @property
    def turn(self) -> R_co:
        """|sin v|^α / (power · sin v): ±1."""

    @property
    def c(self) -> R_co:
        """g2 / cos v."""


class CurvePlace(NamedTuple, Generic[R]):
    """A :class:`PlaceOnLoop` and nothing else."""

    sine: R
    cosine: R
    power: R
    turn: R
    c: R


def gamma_of(curve: LoopNumbers[R], at: PlaceOnLoop[R]) -> tuple[R, R, R]:
    """Return g1, g2 and g3 in the client's axes."""
    return _in_order(curve, curve.first * at.power * at.sine * at.turn, at.c * at.cosine, curve.Z * at.sine)


def _in_order(curve: LoopNumbers[R], first: R, second: R, third: R) -> tuple[R, R, R]:
    return (third, second, first) if curve.mirrored else (first, second, third)


def steepness_at(curve: LoopNumbers[N], power: N) -> N:
    """Return E."""
    return steepness_of(curve, curve.first * power / curve.Z)


def steepness_of(curve: LoopNumbers[R], ratio: R) -> R:
    """Return E from G |sin v|^(α−1) / Z, with either sign."""
    return curve.C + curve.A * ratio * ratio


def speed_factor(curve: LoopNumbers[N], power: N) -> N:
    """Return W, the quotient of P and h − V."""
    return (curve.C + curve.C) / (curve.A * steepness_at(curve, power))


def r_over_p(curve: LoopNumbers[N], at: PlaceOnLoop[N]) -> N:
    """Return r/p in primed axes."""
    return -curve.alpha * curve.first / curve.Z * at.power * at.turn


def rates_of(curve: LoopNumbers[N], at: PlaceOnLoop[N]) -> tuple[N, N, N]:
    """Return the derivatives of g1, g2 and g3 by v, in the client's axes."""
    first = curve.alpha * curve.first * at.power * at.turn * at.cosine
    square = curve.first * at.power
    pull = curve.A * (square * square) + curve.C * curve.Z * curve.Z
    second = -at.sine * pull / (curve.C * at.c)
    return _in_order(curve, first, second, curve.Z * at.cosine)


def bends_of(curve: LoopNumbers[N], at: PlaceOnLoop[N], below: N, mean: N) -> tuple[N, N, N]:
    """Return the second derivatives of g1, g2 and g3 by v, in the client's axes.

    ``below`` is power / sin v, and ``mean`` that of (1 − tu)^(α−2) over 0 ≤ t ≤ 1 with the weight 2t.
    """
    sine, cosine, divisor = at.sine, at.cosine, curve.C * at.c
    size, square = curve.alpha * curve.first * at.turn, curve.first * at.power
    square = curve.A * (square * square)
    pull = square + curve.C * curve.Z * curve.Z
    first = size * (curve.beyond * below * cosine * cosine - at.power * sine)
    # (c²)' = G² α (α − 1) sin 2v ∫ t (1 − tu)^(α−2) dt.
    rate = curve.first * curve.first * curve.alpha * curve.beyond * sine * cosine * mean / (at.c + at.c)
    twice = curve.beyond * square
    second = sine * pull / divisor * rate / at.c - cosine * (twice + twice + pull) / divisor
    return _in_order(curve, first, second, -curve.Z * sine)


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
