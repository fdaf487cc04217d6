r"""Time as one Fourier series of the phase, where dt/dθ is proven holomorphic on a strip.

On the strip \|Im θ\| ≤ a everything is a series of :mod:`.strip_functions`. Of a libration
v = m − d cos θ it takes the sine and cosine of X = d cos θ, by

.. math:: X^s = \Bigl(\frac d2\Bigr)^{\!s}\sum_j \binom{s}{j} e^{i(s-2j)\theta}.

The function q = N/(d² sin²θ) is guessed. The residual of the guess vanishes where
sin θ does, and for such functions

.. math:: \Bigl\|\frac{f}{\sin\theta}\Bigr\| \le \frac{\|f\|}{\sinh a}:

f/(z − 1/z) has the coefficients f_{k+1} + f_{k+3} + …, which are also −f_{k−1} − f_{k−3} − …;
take the former for k ≥ 0, the latter for k < 0. With s = |sin v|^{2/n} and α = m/n

.. math:: \frac{1-w^\alpha}{\cos^2 v} = \frac{1 + s + \dots + s^{m-1}}{1 + s + \dots + s^{n-1}} .

So dt/dθ, of the period 2π, has Fourier coefficients r_k with Σ \|r_k\| e^{a\|k\|} ≤ M. Its
mean over n equidistant phases, the trapezoidal rule, is the true one but for r_{±n}, r_{±2n}, …, hence

.. math:: |T_n - T| \le 2\pi M e^{-an} .

The phases lie halfway between multiples of 2π/n, and n is a multiple of 4: no phase is
at a turn, nor, where the motion is symmetric, at a pole or the equator.
With r_k from n such values what the other r_k alias, and what they leave out, changes dt/dθ by at most

.. math:: \varepsilon = 2 M e^{-an/2}

all over the real axis, and t(θ) by ε θ. θ(t) is enclosed by steps of the interval Newton method
from where doubles find it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from math import ceil, cosh, exp, factorial, inf, log, sinh
from typing import NamedTuple

import numpy as np
from flint import acb, acb_poly, arb, ctx
from numpy.typing import NDArray

from service.dynamics.formula.algebras.ball import ball
from service.dynamics.formula.algebras.power_sums import PowerAlgebra, Small
from service.dynamics.reduction.geometry.point import CurvePlace, LoopNumbers, gamma_of, steepness_of
from service.dynamics.solution.dense_output import EPSILON
from workers.solvers.certified.orbit import rates
from workers.solvers.certified.phase import LibrationPhase, RotationPhase
from workers.solvers.certified.strip_functions import MIN_WEIGHTED_DEGREE, NORM_ROUND_UP, Series, Strip
from workers.solvers.complex_plane.complex_loop import ComplexLoop
from workers.solvers.errors import PrecisionNeededError

FloatArray = NDArray[np.float64]
POWERS = MIN_WEIGHTED_DEGREE
"""Highest power of X in the series of sine and cosine."""
MAX_ALPHA_NUMERATOR = 64
"""α = m/n with larger m or n is left to others."""
SAMPLES = (64, 256, 1024)
"""Numbers of samples of dt/dθ in doubles that show the height of the strip; more where they do not resolve
it."""
MAX_RELATIVE_NOISE = 1e-11
"""A coefficient of this size, of the mean, is not yet noise."""
HIGHEST, LOWEST = 2.5, 0.06
"""Heights of strips that are tried: series on lower ones are longer than pieces of time are many."""
ATTEMPTS = ((0.62, 68.0), (0.6, 120.0), (0.4, 60.0))
"""Heights of the strip as shares of what the samples show, and degrees of the series times the latter."""
FIRST_PHASE_ERROR = 2.0**-46
"""Error of a phase in doubles."""
FIRST_PRECISION, SPARE = 128, 32
"""Precision of the first step; bits that others have beyond twice the digits that are there."""
WIDENING_FACTOR = 64
MAX_WIDENINGS = 5
MIN_RADIUS_RATIO = 32.0
"""Multiple of the radius that the time itself has as a phase, from which on a step is not worth it."""
MAX_NARROWING_FACTOR = 2.0**-16
"""Factor by which a step must narrow a radius, or else it is the last."""
BLOCK_SIZE = 64
"""Coefficients that are summed up at once."""
GRID_PHASES = 2048
NEWTON_STEPS = 3
NEGLIGIBLE_COEFFICIENT = 1e-18
"""Coefficients below this, of the mean, say nothing in doubles."""


class ProvenStrip(NamedTuple):
    """|Im θ| ≤ height, where dt/dθ is holomorphic, and the bound M of its norm."""

    height: float
    largest: float


def proven_strip(phase: LibrationPhase | RotationPhase) -> ProvenStrip | None:
    """Return a strip about the real axis, about as high as there is; None if none is proven."""
    shown = _shown_height(phase)
    if shown is None or shown < LOWEST:
        return None
    for share, steepness in ATTEMPTS:
        height = share * shown
        largest = _bound_on_strip(phase, height, ceil(steepness / shown))
        if largest < inf:
            return ProvenStrip(height, largest)
    return None


def time_of_turn(phase: LibrationPhase | RotationPhase, strip: ProvenStrip, bits: int) -> arb:
    """Return the period, to so many bits of it if the precision allows that."""
    size = float(next(phase.rates(4)))
    count = 4 * ceil((bits * log(2.0) + max(0.0, log(strip.largest / size))) / strip.height / 4.0)
    total = sum(phase.rates(count), arb(0))
    mean = total * (2 if phase.is_even else 1) / count
    error = arb(strip.largest) * (-arb(strip.height) * count).exp()
    return 2 * arb.pi() * (mean + arb(0, error.abs_upper()))


def _shown_height(phase: LibrationPhase | RotationPhase) -> float | None:
    """Return how fast the coefficients of dt/dθ decay, which is proven by nobody; None if they do not."""
    for count in SAMPLES:
        seen = rates(phase, count)
        if not np.all(np.isfinite(seen)):
            return None
        sizes = np.abs(np.fft.rfft(seen))
        # Even and odd ones may differ.
        sizes = np.maximum(sizes[1:-2], sizes[2:-1])
        heard = np.flatnonzero(sizes > MAX_RELATIVE_NOISE * sizes[0])
        last = int(heard[-1]) if len(heard) else 0
        if last + 2 < len(sizes):
            break
    first = last // 3
    if last - first < 2:
        return HIGHEST
    return min(HIGHEST, float(np.log(sizes[first] / sizes[last])) / (last - first))


def _bound_on_strip(phase: LibrationPhase | RotationPhase, height: float, degree: int) -> float:
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


@dataclass(frozen=True, slots=True)
class FourierTime:
    """t(θ), 0 at θ = 0, and θ(t)."""

    mean: arb
    """r_0."""
    slopes: tuple[acb_poly, ...]
    """dt/dθ = r_0 + Re Σ 2 r_k z^k, z = e^{iθ}: exact coefficients, in blocks."""
    times: tuple[acb_poly, ...]
    """t = r_0 θ + Im Σ (2 r_k / k)(z^k − 1)."""
    beginning: arb
    """The imaginary part of that sum at θ = 0."""
    rest: arb
    """0 ± ε, and what the coefficients were rounded by."""
    largest: arb
    """Bound of dt/dθ."""
    bend: arb
    """Bound of its derivative, but for the rest."""
    is_even: bool

    @property
    def period(self) -> arb:
        """Return the time of a turn."""
        return 2 * arb.pi() * (self.mean + self.rest)

    @property
    def span(self) -> arb:
        """Return the time of the whole turn, or of half of it if dt/dθ is even."""
        return self.period / 2 if self.is_even else self.period

    def time_at(self, theta: arb) -> arb:
        """Return t for 0 ≤ θ ≤ 2π, or not much beyond."""
        middle, off = theta.mid(), arb(0, (self.largest * theta.rad()).abs_upper())
        waves = self._sum(self.times, middle).imag
        return (self.mean + self.rest) * middle + waves - self.beginning + off

    def rate(self, theta: arb) -> arb:
        """Return dt/dθ."""
        off = arb(0, (self.bend * theta.rad()).abs_upper())
        return self.mean + self.rest + self._sum(self.slopes, theta.mid()).real + off

    def _sum(self, blocks: tuple[acb_poly, ...], theta: arb) -> acb:
        """Return the value at an exact θ; every product with z may widen a complex ball by √2."""
        with ctx.workprec(ctx.prec + BLOCK_SIZE // 2 + len(blocks)):
            sine, cosine = theta.sin_cos()
            z = acb(cosine, sine)
            step, total = z**BLOCK_SIZE, blocks[-1](z)
            for block in blocks[-2::-1]:
                total = total * step + block(z)
            return total

    def phases_at(self, times: Sequence[arb]) -> list[arb]:
        """Return θ at any times, up to whole turns."""
        period = self.period
        reduced = [t - (t / period).mid().floor().mid() * period for t in times]
        guesses = self._guesses(np.array([float(t) for t in reduced]))
        return [self._phase(t, arb(guess)) for t, guess in zip(reduced, guesses.tolist(), strict=True)]

    def _phase(self, t: arb, middle: arb) -> arb:
        """Return θ where the time is ``t``, from a phase next to it."""
        doubt, full = arb(FIRST_PHASE_ERROR), ctx.prec
        with ctx.workprec(min(full, FIRST_PRECISION)):
            late = self.time_at(middle) - t
            for _ in range(MAX_WIDENINGS):
                guess = arb(middle, doubt)
                found = middle - late / self.rate(guess)
                if guess.contains(found):
                    break
                doubt = WIDENING_FACTOR * doubt
            else:
                raise PrecisionNeededError("the inverse of time")
        return self._narrowed(t, found, full)

    def _narrowed(self, t: arb, theta: arb, full: int) -> arb:
        """Return the phase by steps that double its digits, at no more precision than they need."""
        least = MIN_RADIUS_RATIO * (t.rad() + self.rest.rad()) / self.mean
        while theta.rad() > least:
            precision = min(full, SPARE - 2 * int(float(theta.rad().log() / arb.const_log2())))
            with ctx.workprec(precision):
                middle = theta.mid()
                found = middle - (self.time_at(middle) - t) / self.rate(theta)
            if not found.rad() < MAX_NARROWING_FACTOR * theta.rad():
                return theta if theta.rad() < found.rad() else found
            theta = found
        return theta

    def _guesses(self, times: FloatArray) -> FloatArray:
        """Return θ in doubles."""
        mean = float(self.mean)
        r = np.zeros(BLOCK_SIZE * len(self.slopes), dtype=np.complex128)
        for n, block in enumerate(self.slopes):
            found_here = [complex(value) for value in block.coeffs()]
            r[BLOCK_SIZE * n : BLOCK_SIZE * n + len(found_here)] = found_here
        r = r[: 1 + int(np.flatnonzero(np.abs(r) > NEGLIGIBLE_COEFFICIENT * mean).max(initial=0))]
        s = (r / np.maximum(np.arange(len(r)), 1)).astype(np.complex128)
        grid = np.linspace(0.0, 2.0 * np.pi, GRID_PHASES + 1)
        beginning = float(s.sum().imag)
        found = np.interp(times, mean * grid + _horner(s, grid).imag - beginning, grid)
        for _ in range(NEWTON_STEPS):
            late = mean * found + _horner(s, found).imag - beginning - times
            found = found - late / (mean + _horner(r, found).real)
        return np.asarray(found)


def make_fourier_time(phase: LibrationPhase | RotationPhase, strip: ProvenStrip, bits: int) -> FourierTime:
    """Return the model to so many bits, at the current precision."""
    height, largest = strip.height, strip.largest
    size = float(next(phase.rates(4)))
    count = 4 * ceil((bits * log(2.0) + max(0.0, log(largest / size))) / height / 2.0)
    values = list(phase.rates(count))
    if phase.is_even:
        values += values[::-1]
    sums = acb.dft(values)
    turns = _half_steps(count)
    r = [total * turn / count for total, turn in zip(sums, turns, strict=False)]
    rest = 2 * arb(largest) * (-arb(height) * count / 2).exp()
    rest += sum((2 * (value.real.rad() + value.imag.rad()) for value in r), arb(0))
    r = [value.mid() for value in r]
    quotients = [2 * value / max(k, 1) for k, value in enumerate(r)]
    # |z^k − 1| ≤ k θ.
    rest += sum((k * (value.real.rad() + value.imag.rad()) for k, value in enumerate(quotients)), arb(0))
    times = _blocks([value.mid() for value in quotients])
    sizes = [abs(2 * value) for value in r]
    return FourierTime(
        mean=r[0].real,
        slopes=_blocks([2 * value for value in r]),
        times=times,
        beginning=sum((block(1) for block in times), acb(0)).imag,
        rest=arb(0, rest.abs_upper()),
        largest=sum(sizes, arb(0)) + rest,
        bend=sum((k * size for k, size in enumerate(sizes)), arb(0)),
        is_even=phase.is_even,
    )


def _blocks(coefficients: list[acb]) -> tuple[acb_poly, ...]:
    """Return Σ c_k z^k without c_0, as polynomials that are to be multiplied by powers of z^BLOCK_SIZE."""
    whole = [acb(0), *coefficients[1:]]
    return tuple(acb_poly(whole[n : n + BLOCK_SIZE]) for n in range(0, len(whole), BLOCK_SIZE))


def _half_steps(count: int) -> list[acb]:
    """Return e^{−ikπ/count}: the values are taken half a step from θ = 0 on."""
    return [(-arb(k) / count * acb(1)).exp_pi_i() for k in range(count // 2)]


def _horner(coefficients: NDArray[np.complex128], theta: FloatArray) -> NDArray[np.complex128]:
    z = np.exp(1j * theta)
    total = np.full(len(theta), coefficients[-1])
    for value in coefficients[-2::-1]:
        total = total * z + value
    return total
