r"""Functions holomorphic on a strip, as Fourier series with a proven remainder.

A 2π-periodic function on |Im θ| ≤ a is measured by the norm of the Wiener algebra

.. math:: \|f\| = \sum_k |f_k|\, e^{a|k|},\qquad \|f g\| \le \|f\|\,\|g\|,

which bounds it on the strip, and its Fourier coefficients. A function is a
trigonometric polynomial in doubles and a bound of the norm of what is left.
Products are rounded by at most so many ulp of the product of the norms,
whatever the order of summation.

Everything is real on the real axis, and coefficients say so exactly where they are
guessed: those of even functions are real numbers, others are conjugate to each other.
"""

from fractions import Fraction
from math import inf, pi

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.solution.dense_output import EPSILON

FloatArray = NDArray[np.float64]
Coefficients = FloatArray | NDArray[np.complex128]

NORM_ROUND_UP = 1.0 + 2.0**-38
"""Covers the roundings of a norm: sums of up to 2^12 terms, weights of up to 4000 ulp."""
UNDERFLOW = 1e-200
"""More than all underflows of a product, weights being below 1e90."""
MAX_LOG_WEIGHT = 200.0
"""Logarithm of the largest weight."""
MIN_WEIGHTED_DEGREE = 80
"""Weights go so far at least."""
NOISE_RELATIVE_SIZE = 2.0**-51
"""Coefficients of a guess below this, of the largest, are not believed."""


class Series:
    """Σ c_k e^{ikθ} + r with ‖r‖ ≤ rest; c_k for k = −m … m. Nothing is known of it if ``norm`` is inf.

    Not to be changed.
    """

    __slots__ = ("coefficients", "norm", "rest", "strip")

    def __init__(self, strip: "SeriesRing", coefficients: Coefficients, rest: float, norm: float) -> None:
        self.strip, self.coefficients, self.rest = strip, coefficients, rest
        self.norm = norm
        """Bound of the norm of the whole."""

    def __add__(self, other: "Series") -> "Series":
        return self.strip.add(self, other)

    def __sub__(self, other: "Series") -> "Series":
        return self.strip.subtract(self, other)

    def __mul__(self, other: "Series") -> "Series":
        return self.strip.multiply(self, other)

    def __neg__(self) -> "Series":
        return self.strip.negate(self)

    @property
    def is_known(self) -> bool:
        """Say whether it is proven holomorphic."""
        return self.norm < inf


class SeriesRing:
    """Sums and products on |Im θ| ≤ height, by polynomials up to ``degree``."""

    def __init__(self, height: float, degree: int, *, is_even: bool) -> None:
        if height * 2 * degree > MAX_LOG_WEIGHT:
            degree = int(MAX_LOG_WEIGHT / (2.0 * height))
        self.height, self.degree, self.is_even = height, degree, is_even
        self._nodes = 1 << (2 * degree).bit_length()
        self._middle = max(2 * degree, MIN_WEIGHTED_DEGREE)
        self._weights = np.exp(height * np.abs(np.arange(-self._middle, self._middle + 1)))
        self._known_weights: dict[int, NDArray[np.float64]] = {}
        self.unknown = Series(self, np.zeros(1), inf, inf)

    def series(self, coefficients: Coefficients, rest: float) -> Series:
        """Return Σ c_k e^{ikθ}, cut at the degree, with a rest."""
        cut = (len(coefficients) >> 1) - self.degree
        if cut > 0:
            outer, weights = np.abs(coefficients), self._weights_of(len(coefficients))
            rest += float(outer[:cut].dot(weights[:cut])) + float(outer[-cut:].dot(weights[-cut:]))
            coefficients = coefficients[cut:-cut]
        rest = rest * NORM_ROUND_UP + UNDERFLOW
        size = float(np.abs(coefficients).dot(self._weights_of(len(coefficients))))
        norm = (size + rest) * NORM_ROUND_UP
        return Series(self, coefficients, rest, norm) if norm < inf else self.unknown

    def ball(self, value: arb) -> Series:
        """Return the constant in a ball."""
        nearest = float(value.mid())
        return self._number(nearest, float(abs(value - nearest).upper()))

    def constant(self, value: Fraction) -> Series:
        """Return an exact number."""
        nearest = nearest_double(value)
        return self._number(nearest, EPSILON * abs(nearest))

    def pi(self) -> Series:
        """Return π."""
        return self._number(pi, EPSILON * pi)

    def add(self, left: Series, right: Series) -> Series:
        """Return left + right."""
        return self._sum(left, right.coefficients, right)

    def subtract(self, left: Series, right: Series) -> Series:
        """Return left - right."""
        return self._sum(left, -right.coefficients, right)

    def negate(self, operand: Series) -> Series:
        """Return -operand."""
        return Series(self, -operand.coefficients, operand.rest, operand.norm)

    def multiply(self, left: Series, right: Series) -> Series:
        """Return left · right."""
        a, b = left.coefficients, right.coefficients
        terms = min(len(a), len(b))
        if terms == 1:
            product = a * b
        elif b.dtype.kind == "f":
            # The same convolution, with less ado; it would conjugate a complex b.
            product = np.correlate(a, b[::-1], "full")
        else:
            product = np.convolve(a, b)
        rounding = (2.0 * terms + 8.0) * EPSILON * left.norm * right.norm
        rest = left.norm * right.rest + left.rest * right.norm + rounding
        norm = left.norm * right.norm
        if len(product) > 2 * self.degree + 1 or not norm < inf:
            return self.series(product, rest)
        return Series(self, product, rest * NORM_ROUND_UP + UNDERFLOW, norm * NORM_ROUND_UP + UNDERFLOW)

    def scaled(self, operand: Series, factor: float) -> Series:
        """Return factor · operand, the factor being a few ulp off."""
        size = abs(factor)
        rest = size * (operand.rest + 4.0 * EPSILON * operand.norm)
        return self.series(operand.coefficients * factor, rest)

    def widened(self, operand: Series, rest: float) -> Series:
        """Return the series with a larger rest."""
        return self.series(operand.coefficients, operand.rest + rest)

    def values(self, operand: Series) -> NDArray[np.float64]:
        """Return approximate values at equidistant real θ, from 0 on."""
        reach = len(operand.coefficients) // 2
        padded = np.zeros(self._nodes, dtype=np.complex128)
        padded[: reach + 1] = operand.coefficients[reach:]
        if reach:
            padded[-reach:] = operand.coefficients[:reach]
        return np.fft.ifft(padded).real * self._nodes

    def interpolated(self, values: NDArray[np.float64]) -> Series:
        """Return the trigonometric polynomial next to these values, as they are returned by ``values``."""
        found = np.fft.fft(values) / self._nodes
        coefficients = np.concatenate((found[-self.degree :], found[: self.degree + 1]))
        coefficients = 0.5 * (coefficients + coefficients[::-1].conj())
        return self.trimmed(self._own(coefficients))

    def trimmed(self, coefficients: Coefficients) -> Series:
        """Return the polynomial without the noise of rounding at its ends, which has large weights."""
        sizes = np.abs(coefficients)
        reach = len(sizes) // 2
        heard = np.flatnonzero(sizes[reach:] > NOISE_RELATIVE_SIZE * sizes.max())
        cut = reach - int(heard[-1]) if len(heard) else 0
        return self.series(coefficients[cut : len(sizes) - cut], 0.0)

    def _own(self, coefficients: NDArray[np.complexfloating]) -> Coefficients:
        """Return the real parts where those are the coefficients."""
        return np.asarray(coefficients.real.copy() if self.is_even else coefficients, order="C")

    def _weights_of(self, count: int) -> NDArray[np.float64]:
        """Return the weights of so many coefficients."""
        found = self._known_weights.get(count)
        if found is None:
            reach = count >> 1
            found = self._weights[self._middle - reach : self._middle + reach + 1]
            self._known_weights[count] = found
        return found

    def _number(self, value: float, off: float) -> Series:
        rest = off * NORM_ROUND_UP + UNDERFLOW
        norm = (abs(value) + rest) * NORM_ROUND_UP
        return Series(self, np.array([value]), rest, norm) if norm < inf else self.unknown

    def _sum(self, left: Series, right: Coefficients, of: Series) -> Series:
        if not (left.is_known and of.is_known):
            return self.unknown
        longer, shorter = left.coefficients, right
        if len(longer) < len(shorter):
            longer, shorter = shorter, longer
        total = longer.copy() if longer.dtype == shorter.dtype else longer.astype(np.complex128)
        offset = (len(longer) - len(shorter)) >> 1
        total[offset : len(longer) - offset] += shorter
        return self.series(total, left.rest + of.rest + EPSILON * (left.norm + of.norm))
