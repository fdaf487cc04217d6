r"""Functions holomorphic on a strip, as Fourier series with a proven remainder.

A 2π-periodic function on |Im θ| ≤ a is measured by the norm of the Wiener algebra

.. math:: \|f\| = \sum_k |f_k|\, e^{a|k|},\qquad \|f g\| \le \|f\|\,\|g\|,

which bounds it on the strip, and its Fourier coefficients. A function is a
trigonometric polynomial in doubles and a bound of the norm of what is left.
Products are rounded by at most so many ulp of the product of the norms,
whatever the order of summation.

Everything is real on the real axis, and coefficients say so exactly where they are
guessed: those of even functions are real numbers, others are conjugate to each other.

Formulas are evaluated on such functions. Inverses and roots are guessed by values at equidistant nodes,
and proven by their residual ρ: where ‖ρ‖ < 1, 1 − ρ has a holomorphic inverse, root and logarithm on the
whole strip, by the binomial series.
"""

from collections.abc import Callable
from fractions import Fraction
from math import exp, factorial, frexp, inf, pi

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
MAX_RESIDUAL_NORM = 0.5
MAX_ROOT_ORDER = 64
"""Denominators of powers up to this are roots; others go by the logarithm."""
TAYLOR_DEGREE = 20
MAX_EXPONENT_NORM = 500.0
"""Largest norm of an argument of exp."""


class Series:
    """Σ c_k e^{ikθ} + r with ‖r‖ ≤ rest; c_k for k = −m … m. Nothing is known of it if ``norm`` is inf.

    Not to be changed.
    """

    __slots__ = ("coefficients", "norm", "rest", "strip")

    def __init__(self, strip: "Strip", coefficients: Coefficients, rest: float, norm: float) -> None:
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


class Strip:
    """The algebra on |Im θ| ≤ height, by polynomials up to ``degree``; an Algebra of formulas."""

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

    def divide(self, left: Series, right: Series) -> Series:
        """Return left / right."""
        return left * self.inverse(right)

    def inverse(self, operand: Series) -> Series:
        """Return 1 / operand; unknown unless it is proven to have no zero on the strip."""
        if len(operand.coefficients) == 1:
            return self._inverse_of_constant(operand)
        guess = self._guess(np.reciprocal, operand)
        return self._improved(guess, operand * guess, 1)

    def rsqrt(self, operand: Series) -> Series:
        """Return 1/√operand, positive on the real axis."""
        return self._root(operand, 1, 2)

    def power(self, base: Series, exponent: Fraction) -> Series:
        """Return base^exponent; with a fraction the base must be positive on the real axis."""
        whole, denominator = -(-exponent.numerator // exponent.denominator), exponent.denominator
        if denominator == 1:
            return self._integer_power(base, whole)
        if denominator > MAX_ROOT_ORDER:
            return self.call("exp", self.scaled(self.call("log", base), nearest_double(exponent)))
        root = self._root(base, int((whole - exponent) * denominator), denominator)
        return root * self._integer_power(base, whole) if whole else root

    def general_power(self, base: Series, exponent: Series) -> Series:
        """Return exp(exponent · log(base))."""
        return self.call("exp", exponent * self.call("log", base))

    def call(self, name: str, argument: Series) -> Series:
        """Return the function, continued from the real axis."""
        if not argument.is_known:
            return self.unknown
        if name == "exp":
            return self._exp(argument)
        if name == "log":
            return self._log(argument)
        if name in ("abs", "sign"):
            return self._abs(argument) if name == "abs" else self._sign(argument)
        sine, cosine = self._sine_and_cosine(argument)
        return {"sin": sine, "cos": cosine}[name] if name != "tan" else sine * self.inverse(cosine)

    def geometric(self, operand: Series, count: int) -> Series:
        """Return 1 + x + … + x^(count − 1)."""
        one = self.constant(Fraction(1))
        if count == 1:
            return one
        half = self.geometric(operand, count // 2)
        total = half * (one + self._integer_power(operand, count // 2))
        return total * operand + one if count % 2 else total

    def _guess(self, function: Callable[[FloatArray], FloatArray], operand: Series) -> Series:
        if not operand.is_known:
            return self.unknown
        return self.interpolated(function(self.values(operand)))

    def _inverse_of_constant(self, operand: Series) -> Series:
        value, rest = operand.coefficients, operand.rest
        size = float(np.abs(value[0]))
        if not 2.0 * rest < size:
            return self.unknown
        # 1/(x + e) − 1/x = −e/(x (x + e)).
        return self.series(1.0 / value, 2.0 * rest / size / size + 4.0 * EPSILON / size)

    def _improved(self, guess: Series, product: Series, order: int) -> Series:
        """Return guess · product^(−1/order), where product is next to 1, by the binomial series."""
        residual = self.constant(Fraction(1)) - product
        r = residual.norm
        if not r <= MAX_RESIDUAL_NORM:
            return self.unknown
        # (1 − r)^(−1/order) has positive coefficients: the rest is less than what follows r²/order.
        factor = self.constant(Fraction(1)) + self.scaled(residual, 1.0 / order)
        return self.widened(guess * factor, 2.0 * guess.norm * r * r)

    def _root(self, operand: Series, numerator: int, denominator: int) -> Series:
        """Return operand^(−numerator/denominator), positive on the real axis."""
        exponent = -numerator / denominator
        guess = self._guess(lambda values: values**exponent, operand)
        product = self._integer_power(operand, numerator) * self._integer_power(guess, denominator)
        found = self._improved(guess, product, denominator)
        # None of the factors vanishes on the real axis: their signs are those at one place.
        return found if self._sign_of(operand) > 0 and self._sign_of(guess) > 0 else self.unknown

    def _integer_power(self, base: Series, exponent: int) -> Series:
        if exponent < 0:
            base, exponent = self.inverse(base), -exponent
        result: Series | None = None
        while exponent:
            if exponent & 1:
                result = base if result is None else result * base
            exponent >>= 1
            if exponent:
                base = base * base
        return self.constant(Fraction(1)) if result is None else result

    def _sign_of(self, operand: Series) -> int:
        """Return the certain sign at θ = 0, or else at π; 0 if neither is certain."""
        if not operand.is_known:
            return 0
        coefficients = operand.coefficients.real
        doubt = 2.0 * (operand.rest + len(coefficients) * EPSILON * float(np.abs(coefficients).sum()))
        value = float(coefficients.sum())
        if not abs(value) > doubt:
            odd = len(coefficients) // 2 + 1
            value -= 2.0 * float(coefficients[odd % 2 :: 2].sum())
        return 0 if not abs(value) > doubt else 1 if value > 0.0 else -1

    def _sign(self, operand: Series) -> Series:
        """Return the sign on the real axis, if it is everywhere the same."""
        sign = self._sign_of(operand) if self.inverse(operand).is_known else 0
        return self.constant(Fraction(sign)) if sign else self.unknown

    def _abs(self, operand: Series) -> Series:
        return self._sign(operand) * operand

    def _exp(self, operand: Series) -> Series:
        """Return exp, by the Taylor polynomial of a part of the argument and squarings."""
        reach = len(operand.coefficients) // 2
        mean = complex(operand.coefficients[reach])
        if not (operand.norm < MAX_EXPONENT_NORM):
            return self.unknown
        moving = operand.coefficients.copy()
        moving[reach] -= moving[reach].real
        squarings = max(0, frexp(operand.norm)[1])
        part = self.series(moving * 0.5**squarings, operand.rest * 0.5**squarings)
        one = self.constant(Fraction(1))
        total = one
        for k in range(TAYLOR_DEGREE, 0, -1):
            total = one + self.scaled(part * total, 1.0 / k)
        # ‖part‖ ≤ 1, or a little more.
        total = self.widened(total, 2.0 / factorial(TAYLOR_DEGREE + 1))
        for _ in range(squarings):
            total = total * total
        return self.scaled(total, exp(mean.real))

    def _log(self, operand: Series) -> Series:
        guess = self._guess(np.log, operand)
        if not guess.is_known:
            return self.unknown
        residual = self.constant(Fraction(1)) - operand * self._exp(self.negate(guess))
        r = residual.norm
        # The exponential of a real function is positive: so is the operand.
        if not r <= MAX_RESIDUAL_NORM:
            return self.unknown
        return self.widened(guess - residual, r * r)

    def _sine_and_cosine(self, operand: Series) -> tuple[Series, Series]:
        turned = (1j * operand.coefficients).astype(np.complex128)
        turning = self._exp(Series(self, turned, operand.rest, operand.norm))
        if not turning.is_known:
            return self.unknown, self.unknown
        turned = turning.coefficients.astype(np.complex128)
        reflected = turned[::-1].conj()
        rest = turning.rest + 4.0 * EPSILON * turning.norm
        both = -0.5j * (turned - reflected), 0.5 * (turned + reflected)
        sine, cosine = (self.series(self._own(each), rest) for each in both)
        return sine, cosine
