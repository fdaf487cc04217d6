"""Complex balls: rigorous enclosures with python-flint's ``acb``, for the integration of formulas."""

from collections.abc import Callable
from fractions import Fraction

from flint import acb, fmpq

from service.dynamics.formula.algebra import OperatorAlgebra

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
