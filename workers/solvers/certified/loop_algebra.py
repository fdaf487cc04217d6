r"""Complex balls on a loop that passes poles: powers of |g1| and |g3| as powers of sin v.

There |g1| = G |sin v|^α and |g3| = Z |sin v|, and |sin v|^{2k} is holomorphic
where |sin v| is not: V = |g1|^{3/2} is a polynomial in sin v for α = 4.
"""

from fractions import Fraction
from typing import NamedTuple

from flint import acb, arb, fmpq

from service.dynamics.formula.algebras.complex_ball import ComplexBallAlgebra


class Monomial(NamedTuple):
    """A ball that is known to have the absolute value scale · |sin v|^exponent on the loop."""

    value: acb
    scale: arb
    exponent: Fraction
    sign: int | None
    """The sign of the value, if it has one all along the loop."""


class LoopAlgebra(ComplexBallAlgebra):
    """Complex balls at one place; ``known`` ones are recognised by identity in abs, sign and powers."""

    def __init__(self, sine: acb, known: tuple[Monomial, ...], *, analytic: bool) -> None:
        super().__init__(analytic=analytic)
        self._sine = sine
        self._known = list(known)

    def call(self, name: str, argument: acb) -> acb:
        """Return the function of the ball."""
        found = self._recognised(argument)
        if found is None or name not in ("abs", "sign"):
            return super().call(name, argument)
        if name == "sign":
            return acb(found.sign) if found.sign else super().call(name, argument)
        value = found.sign * argument if found.sign else super().call(name, argument)
        # An even power of sin v is holomorphic where its absolute value was not seen to be.
        even = self._even_power(found, Fraction(1))
        value = value if even is None else even
        self._known.append(Monomial(value, found.scale, found.exponent, 1))
        return value

    def power(self, base: acb, exponent: Fraction) -> acb:
        """Return base^exponent."""
        found = self._recognised(base)
        is_of_size = exponent.denominator == 1 and exponent.numerator % 2 == 0
        if found is not None and (found.sign == 1 or is_of_size):
            value = self._even_power(found, exponent)
            if value is not None:
                return value
        return super().power(base, exponent)

    def _recognised(self, value: acb) -> Monomial | None:
        return next((each for each in self._known if each.value is value), None)

    def _even_power(self, monomial: Monomial, exponent: Fraction) -> acb | None:
        """Return (scale |sin v|^k)^exponent if that is an even power of sin v."""
        total = monomial.exponent * exponent
        if total.denominator != 1 or total.numerator % 2:
            return None
        scale = monomial.scale ** fmpq(exponent.numerator, exponent.denominator)
        return self._sine**total.numerator * scale
