r"""Evaluates formulas on functions of a strip, by the operations of :mod:`.series`.

Inverses and roots are guessed by values at equidistant nodes, and proven by their
residual ρ: where ‖ρ‖ < 1, 1 − ρ has a holomorphic inverse, root and logarithm on the
whole strip, by the binomial series.
"""

from collections.abc import Callable
from fractions import Fraction
from math import exp, factorial, frexp

import numpy as np

from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.solution.dense_output import EPSILON
from workers.solvers.certified.strips.series import FloatArray, Series, SeriesRing

MAX_RESIDUAL_NORM = 0.5
MAX_ROOT_ORDER = 64
"""Denominators of powers up to this are roots; others go by the logarithm."""
TAYLOR_DEGREE = 20
MAX_EXPONENT_NORM = 500.0
"""Largest norm of an argument of exp."""


class Strip(SeriesRing):
    """The algebra on a strip; an Algebra of formulas."""

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
