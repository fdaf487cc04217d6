"""Balls, real and complex: rigorous enclosures with python-flint, at the current ``flint.ctx.prec``."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction

from flint import acb, arb, ctx, fmpq

from service.dynamics.formula.algebra import OperatorAlgebra

_FUNCTIONS: dict[str, Callable[[arb], arb]] = {
    "exp": arb.exp,
    "log": arb.log,
    "sin": arb.sin,
    "cos": arb.cos,
    "tan": arb.tan,
    "abs": arb.__abs__,
    "sign": arb.sgn,
}


def ball(value: Fraction) -> arb:
    """Return the ball of a rational at the current precision."""
    return arb(fmpq(value.numerator, value.denominator))


@contextmanager
def series_of(terms: int) -> Iterator[None]:
    """Let flint's series have so many terms."""
    before = ctx.cap
    ctx.cap = terms
    try:
        yield
    finally:
        ctx.cap = before


class BallAlgebra(OperatorAlgebra[arb]):
    """``arb`` balls; NaN as soon as the argument's ball leaves the domain.

    Constants are enclosed at the precision in force when they are asked for.
    """

    def constant(self, value: Fraction) -> arb:
        """Return the ball of the number: exact if it is dyadic and short enough."""
        numerator, denominator = value.as_integer_ratio()
        return arb(numerator) if denominator == 1 else arb(fmpq(numerator, denominator))

    def pi(self) -> arb:
        """Return a ball of π."""
        return arb.pi()

    def divide(self, left: arb, right: arb) -> arb:
        """Return left / right."""
        return left / right

    def power(self, base: arb, exponent: Fraction) -> arb:
        """Return base^exponent; with a fraction the whole ball of the base must be ≥ 0."""
        numerator, denominator = exponent.as_integer_ratio()
        if denominator == 1:
            if numerator == 2:
                return base * base
            if numerator == -2:
                return 1 / (base * base)
            return whole_power(base, numerator)
        if denominator == 2:
            if numerator == 1:
                return base.sqrt()
            if numerator == -1:
                return base.rsqrt()
        return base ** fmpq(numerator, denominator)

    def general_power(self, base: arb, exponent: arb) -> arb:
        """Return exp(exponent · log(base)), NaN unless the whole ball of the base is > 0."""
        return (exponent * base.log()).exp()

    def call(self, name: str, argument: arb) -> arb:
        """Return the function of the ball."""
        return _FUNCTIONS[name](argument)


class DomainBalls(BallAlgebra):
    """Balls that remember whether a root or a logarithm was taken of what is certainly negative."""

    is_undefined = False

    def power(self, base: arb, exponent: Fraction) -> arb:
        """Return base^exponent."""
        self.is_undefined |= exponent.denominator > 1 and base < 0
        return super().power(base, exponent)

    def general_power(self, base: arb, exponent: arb) -> arb:
        """Return exp(exponent · log(base))."""
        self.is_undefined |= base < 0
        return super().general_power(base, exponent)

    def call(self, name: str, argument: arb) -> arb:
        """Return the function of the ball."""
        self.is_undefined |= name == "log" and argument < 0
        return super().call(name, argument)


def whole_power(base: arb, exponent: int) -> arb:
    """Return base^exponent for an integer."""
    power = base**exponent
    # Flint gives NaN for a ball whose midpoint is 0.
    return _product(base, exponent) if exponent > 0 and power.is_nan() else power


def _product(base: arb, count: int) -> arb:
    """Return base^count for count ≥ 1, by squaring."""
    result: arb | None = None
    while True:
        if count & 1:
            result = base if result is None else result * base
        count >>= 1
        if not count:
            return arb(1) if result is None else result
        base = base * base


_ENTIRE: dict[str, Callable[[acb], acb]] = {"exp": acb.exp, "sin": acb.sin, "cos": acb.cos, "tan": acb.tan}


class ComplexBallAlgebra(OperatorAlgebra[acb]):
    """``acb`` balls; on the real axis the functions are those of BallAlgebra.

    With ``analytic`` a value is finite only where the formula is holomorphic on
    the whole ball: what ``acb.integral`` has to know. Functions with cuts (log
    and fractional powers along the negative axis, abs and sign along the
    imaginary one) are then not finite on a ball that meets a cut.
    """

    def __init__(self, *, analytic: bool) -> None:
        self._analytic = analytic

    def constant(self, value: Fraction) -> acb:
        """Return the ball of the number."""
        return acb(fmpq(value.numerator, value.denominator))

    def pi(self) -> acb:
        """Return a ball of π."""
        return acb.pi()

    def divide(self, left: acb, right: acb) -> acb:
        """Return left / right."""
        return left / right

    def power(self, base: acb, exponent: Fraction) -> acb:
        """Return base^exponent; with a fraction the principal branch."""
        numerator, denominator = exponent.as_integer_ratio()
        if denominator == 1:
            return base**numerator
        if denominator == 2 and abs(numerator) == 1:
            return base.sqrt(self._analytic) if numerator == 1 else base.rsqrt(self._analytic)
        return base.pow(acb(fmpq(numerator, denominator)), analytic=self._analytic)

    def general_power(self, base: acb, exponent: acb) -> acb:
        """Return exp(exponent · log(base))."""
        return (exponent * base.log(self._analytic)).exp()

    def call(self, name: str, argument: acb) -> acb:
        """Return the function of the ball."""
        if name == "log":
            return argument.log(self._analytic)
        if name == "abs":
            return argument.real_abs(self._analytic)
        if name == "sign":
            return argument.real_sgn(self._analytic)
        return _ENTIRE[name](argument)
