r"""Proves that time is a holomorphic, bounded function of the phase on a strip about the real axis.

On the strip everything is a series of :mod:`.series`. Of a libration
v = m − d cos θ it takes the sine and cosine of X = d cos θ, by

.. math:: X^s = \Bigl(\frac d2\Bigr)^{\!s}\sum_j \binom{s}{j} e^{i(s-2j)\theta}.

The function q = N/(d² sin²θ) is guessed. The residual of the guess vanishes where
sin θ does, and for such functions

.. math:: \Bigl\|\frac{f}{\sin\theta}\Bigr\| \le \frac{\|f\|}{\sinh a}:

f/(z − 1/z) has the coefficients f_{k+1} + f_{k+3} + …, which are also −f_{k−1} − f_{k−3} − …;
take the former for k ≥ 0, the latter for k < 0. With s = |sin v|^{2/n} and α = m/n

.. math:: \frac{1-w^\alpha}{\cos^2 v} = \frac{1 + s + \dots + s^{m-1}}{1 + s + \dots + s^{n-1}} .
"""

from fractions import Fraction
from functools import cache
from math import cosh, exp, factorial, sinh

import numpy as np
from numpy.typing import NDArray

from service.dynamics.formula.algebras.ball import ball
from service.dynamics.formula.algebras.power_sums import PowerAlgebra, Small
from service.dynamics.reduction.geometry.point import CurvePlace, LoopNumbers, gamma_of, steepness_of
from service.dynamics.solution.dense_output import EPSILON
from workers.solvers.certified.phase import LibrationPhase, RotationPhase
from workers.solvers.certified.strips.algebra import Strip
from workers.solvers.certified.strips.series import MIN_WEIGHTED_DEGREE, NORM_ROUND_UP, Series
from workers.solvers.complex_plane.complex_loop import ComplexLoop

FloatArray = NDArray[np.float64]

POWERS = MIN_WEIGHTED_DEGREE
"""Highest power of X in the series of sine and cosine."""
MAX_ALPHA_NUMERATOR = 64
"""α = m/n with larger m or n is left to others."""


def bound_on_strip(phase: LibrationPhase | RotationPhase, height: float, degree: int) -> float:
    """Return a bound of Σ |r_k| e^{k·height}, r_k the coefficients of dt/dθ; inf if none is proven."""
    with np.errstate(all="ignore"):
        strip = Strip(height, degree, is_even=phase.is_even)
        return _of_rotation(phase, strip) if isinstance(phase, RotationPhase) else _of_libration(phase, strip)


def _of_rotation(phase: RotationPhase, strip: Strip) -> float:
    sine, cosine = map(strip.ball, phase.origin.sin_cos())
    along = strip.series(np.array([0.5, 0.0, 0.5]), 0.0)
    across = strip.series(phase.direction * np.array([0.5j, 0.0, -0.5j]), 0.0)
    found = _Curve(phase.curve, strip, sine * along + cosine * across, cosine * along - sine * across)
    return found.bound_of_rate(found.N())


def _of_libration(phase: LibrationPhase, strip: Strip) -> float:
    half, middle = (phase.upper - phase.lower) / 2, (phase.upper + phase.lower) / 2
    d = float(half.mid())
    cosine_X, sine_X = _circular(strip, d, float(abs(half - d).upper()))
    sine, cosine = map(strip.ball, middle.sin_cos())
    found = _Curve(phase.curve, strip, sine * cosine_X - cosine * sine_X, cosine * cosine_X + sine * sine_X)
    # The true q is that of d, but for a factor.
    return found.bound_of_rate(_without_turns(found.N(), d)) * float((half / d).upper()) * NORM_ROUND_UP


class _Curve:
    """The curve over a strip."""

    def __init__(self, curve: ComplexLoop, strip: Strip, sine: Series, cosine: Series) -> None:
        loop = curve.loop
        self._curve, self._strip = curve, strip
        alpha = ball(loop.alpha)
        balls = loop.g1_sign * loop.G, loop.Z, alpha, alpha - 1, ball(loop.A), ball(loop.C)
        first, Z, *others = map(strip.ball, balls)
        self._numbers = LoopNumbers(first, Z, others[0], others[1], others[2], others[3], loop.mirrored)
        m, n = loop.alpha.as_integer_ratio()
        size = sine if curve.side >= 0 else strip.negate(sine)
        root = strip.power(size, Fraction(1, n)) if max(m, n) <= MAX_ALPHA_NUMERATOR else strip.unknown
        power = strip.power(root, Fraction(m - n))
        quotient = strip.geometric(root * root, m)
        if n > 1:
            quotient = quotient * strip.inverse(strip.geometric(root * root, n))
        self._c_squared = Z * Z + first * first * quotient
        c, turn = self._c_squared * strip.rsqrt(self._c_squared), strip.constant(Fraction(curve.side or 1))
        self._at = CurvePlace(sine, cosine, power, turn, c)

    def N(self) -> Series:
        """Return h − V."""
        curve, strip, at = self._curve, self._strip, self._at
        if curve.side:
            return strip.ball(curve.h) - curve.tape.evaluate(strip, gamma_of(self._numbers, at))
        loop, algebra = curve.loop, PowerAlgebra(strip, Small(at.sine, 1, 0))
        first, third = algebra.loop(strip.ball(loop.G), self._numbers.Z, loop.alpha, loop.g1_sign)
        around = algebra.of(at.c * at.cosine)
        powers = (third, around, first) if loop.mirrored else (first, around, third)
        return strip.ball(curve.h) - algebra.value(curve.tape.evaluate(algebra, powers))

    def bound_of_rate(self, K: Series) -> float:
        """Return the norm of dt/dθ from K, which is q of a libration, N of a rotation."""
        loop, strip = self._curve.loop, self._strip
        A, C = ball(loop.A), ball(loop.C)
        # P = 2 C K / (A E).
        E = steepness_of(self._numbers, strip.ball(loop.G / loop.Z) * self._at.power)
        rate = E * strip.rsqrt(E * self._c_squared * K)
        return float((loop.Z * (A / (2 * C)).sqrt()).upper()) * rate.norm * NORM_ROUND_UP


def _circular(strip: Strip, d: float, off: float) -> tuple[Series, Series]:
    """Return cos X and sin X, X = (d ± off) cos θ."""
    x = (d + off) * cosh(strip.height) * NORM_ROUND_UP
    if not x < POWERS / 2:
        return strip.unknown, strip.unknown
    left_out = 2.0 * x ** (POWERS + 1) / factorial(POWERS + 1)
    rest = (left_out + (4.0 * POWERS * EPSILON + 2.0 * off * cosh(strip.height)) * exp(x)) * NORM_ROUND_UP
    powers = (0.5 * d) ** np.arange(POWERS + 1)
    even, odd = (matrix @ powers for matrix in _taylor_coefficients())
    return strip.series(even, rest), strip.series(odd, rest)


@cache
def _taylor_coefficients() -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of (d/2)^s in those of cos X and sin X, shape (2 POWERS + 1, POWERS + 1)."""
    even, odd = np.zeros((2 * POWERS + 1, POWERS + 1)), np.zeros((2 * POWERS + 1, POWERS + 1))
    for s in range(POWERS + 1):
        for j in range(s + 1):
            sign = -1 if s // 2 % 2 else 1
            (odd if s % 2 else even)[POWERS + s - 2 * j, s] = sign / (factorial(j) * factorial(s - j))
    return even, odd


def _without_turns(N: Series, d: float) -> Series:
    """Return N / (d² sin²θ): N is even and vanishes twice at 0 and π."""
    strip = N.strip
    if not (N.is_known and d * d > 0.0):
        return strip.unknown
    # sin²θ = −(z − 1/z)²/4.
    half = -4.0 / (d * d) * _tails(_tails(N.coefficients[len(N.coefficients) // 2 :].real))
    guess = strip.series(np.concatenate((half[:0:-1], half)), 0.0)
    square = strip.scaled(strip.series(np.array([-0.25, 0.0, 0.5, 0.0, -0.25]), 0.0), d * d)
    residual = (N - square * guess).norm
    return strip.widened(guess, residual / (d * sinh(strip.height)) ** 2 * NORM_ROUND_UP)


def _tails(values: FloatArray) -> FloatArray:
    """Return v_1 + v_3 + …, v_2 + v_4 + …, …."""
    sums = values[::-1].copy()
    for start in (0, 1):
        sums[start::2] = np.cumsum(sums[start::2])
    return sums[-2::-1] if len(sums) > 1 else np.zeros(1)
