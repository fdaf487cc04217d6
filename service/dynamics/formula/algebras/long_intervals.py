r"""Intervals in multiple precision, one at a time, where doubles are too coarse or underflow.

As in :mod:`.intervals`, an element is the set of c · s^e with lo ≤ c ≤ hi, where the scale s is between
the bounds that the algebra was made with. Unlike a ball, an interval keeps the sign of what is known up to
a factor only, as of exp(-1/x²) next to x = 0.
"""

from dataclasses import dataclass
from fractions import Fraction

from flint import arb, fmpq

from service.dynamics.formula.algebra import DerivedOperations
from service.dynamics.formula.algebras.ball import BallAlgebra

FLAT_POWER = Fraction(16)

_NOTHING, _ALL, _UNKNOWN = arb(0), arb.pos_inf(), arb.nan()


@dataclass(frozen=True, slots=True)
class LongInterval:
    """lo ≤ c ≤ hi, beside the power ``exponent`` of the scale; nothing is known where either is NaN."""

    lo: arb
    hi: arb
    exponent: Fraction = Fraction(0)
    known_sign: int = 0
    """The sign of c where a bound may be 0 although c never is, as for e^x; else 0."""

    @property
    def sign(self) -> int:
        """Return the certain sign of c, 0 if it is not known."""
        if not self.lo <= self.hi:
            return 0
        return 1 if self.lo > 0 else -1 if self.hi < 0 else self.known_sign

    @property
    def is_bounded(self) -> bool:
        """Tell whether c has finite bounds."""
        return bool(self.lo.is_finite() and self.hi.is_finite())


class LongIntervalAlgebra(DerivedOperations[LongInterval]):
    """Intervals rounded outwards at the current ``flint.ctx.prec``; NaN where a value may be undefined.

    Parameters
    ----------
    lowest, highest
        Bounds of the scale s, 0 < s < 1; ``lowest`` may be 0, where powers are limits.
    log_power
        ε > 0: logarithms of powers of s are s^-ε times something bounded, in place of something that
        grows to ∞ as s → 0. So what they are added to may outweigh them. And what falls to 0 as
        e^(−1/s) does is s^16 times something bounded.
    skips_undefined
        Bounds are of what has a value: 1/x and log x are bounded where x ≥ 0 may be 0 at places.
    """

    def __init__(
        self, lowest: arb, highest: arb, log_power: Fraction = Fraction(0), *, skips_undefined: bool = False
    ) -> None:
        self._lowest, self._highest, self._log_power = lowest, highest, log_power
        self._skips_undefined = skips_undefined
        self._balls = BallAlgebra()

    def constant(self, value: Fraction) -> LongInterval:
        """Return the number."""
        return _of(self._balls.constant(value))

    def pi(self) -> LongInterval:
        """Return π."""
        return _of(arb.pi())

    def add(self, left: LongInterval, right: LongInterval) -> LongInterval:
        """Return left + right, beside the lower power of the scale."""
        exponent = min(left.exponent, right.exponent)
        left, right = self._beside(left, exponent), self._beside(right, exponent)
        sign = left.sign if left.sign == right.sign else 0
        return LongInterval((left.lo + right.lo).lower(), (left.hi + right.hi).upper(), exponent, sign)

    def multiply(self, left: LongInterval, right: LongInterval) -> LongInterval:
        """Return left · right."""
        return LongInterval(*_product(left, right), left.exponent + right.exponent, left.sign * right.sign)

    def divide(self, left: LongInterval, right: LongInterval) -> LongInterval:
        """Return left / right, NaN where right may change its sign."""
        return self.multiply(left, self._inverse(right))

    def negate(self, operand: LongInterval) -> LongInterval:
        """Return -operand."""
        return LongInterval(-operand.hi, -operand.lo, operand.exponent, -operand.known_sign)

    def power(self, base: LongInterval, exponent: Fraction) -> LongInterval:
        """Return base^exponent; with a fraction the base must be ≥ 0."""
        if exponent < 0:
            return self._inverse(self.power(base, -exponent))
        power = base.exponent * exponent
        if exponent.denominator == 1 and exponent.numerator % 2:
            lo, hi = (x**exponent.numerator for x in (base.lo, base.hi))
            return LongInterval(lo.lower(), hi.upper(), power, base.sign)
        size = _size(base) if exponent.denominator == 1 else base
        if not size.lo >= 0:
            return LongInterval(_UNKNOWN, _UNKNOWN, power)
        ends = _root(size.lo, exponent).lower(), _root(size.hi, exponent).upper()
        return LongInterval(*ends, power, size.sign)

    def call(self, name: str, argument: LongInterval) -> LongInterval:
        """Return the function."""
        if name == "abs":
            return _size(argument)
        if name == "sign":
            return LongInterval(_sign(argument.lo), _sign(argument.hi))
        if name == "log" and argument.exponent != 0:
            return self._logarithm(argument)
        if name == "exp" and self._log_power:
            flat = self._flat(argument)
            if flat is not None:
                return flat
        x = self._beside(argument, Fraction(0))
        if name == "exp":
            return LongInterval(x.lo.exp().lower(), x.hi.exp().upper(), known_sign=1)
        if name == "log":
            x = self._not_zero(x)
            return LongInterval(_log(x.lo).lower() if x.sign > 0 else _UNKNOWN, _log(x.hi).upper())
        if not (x.lo.is_finite() and x.hi.is_finite()):
            bound = arb(1) if name in ("sin", "cos") and x.lo <= x.hi else _UNKNOWN
            return LongInterval(-bound, bound)
        return _of(self._balls.call(name, x.lo.union(x.hi)))

    def _inverse(self, x: LongInterval) -> LongInterval:
        return _inverse(self._not_zero(x))

    def _not_zero(self, x: LongInterval) -> LongInterval:
        """Return the element without 0 at the end of its bounds, if what is undefined there is skipped."""
        if not self._skips_undefined or x.sign:
            return x
        sign = 1 if x.lo >= 0 and x.hi > 0 else -1 if x.hi <= 0 and x.lo < 0 else 0
        return LongInterval(x.lo, x.hi, x.exponent, sign)

    def _flat(self, x: LongInterval) -> LongInterval | None:
        """Return e^(−c s^−m), m > 0, as s^N times something bounded: it is s^−N e^(−c s^−m).

        That grows with s where s^m < c m/N. None for another element.
        """
        m, c = -x.exponent, -x.hi
        if not (m > 0 and c > 0):
            return None
        power = _root(self._highest, m)
        if not power * FLAT_POWER.numerator < c * self._balls.constant(m):
            return None
        largest = (-c / power).exp() / _root(self._highest, FLAT_POWER)
        return LongInterval(_NOTHING, largest.upper(), FLAT_POWER, 1)

    def _logarithm(self, x: LongInterval) -> LongInterval:
        """Return log(c s^e) = log c + e log s."""
        constant = self.call("log", LongInterval(x.lo, x.hi, known_sign=x.known_sign))
        low, high = _log(self._lowest), _log(self._highest)
        if self._log_power:
            # s^ε log s falls from 0 to −1/(ε e), at s = e^(−1/ε), and grows from there on.
            epsilon = self._balls.constant(self._log_power)
            least = -(arb(-1).exp() / epsilon)
            of_scale = LongInterval(least.lower(), _NOTHING, -self._log_power)
        else:
            of_scale = LongInterval(low.lower(), high.upper())
        return self.add(constant, self.multiply(self.constant(x.exponent), of_scale))

    def _beside(self, element: LongInterval, exponent: Fraction) -> LongInterval:
        """Return the element beside another power of the scale."""
        left = element.exponent - exponent
        if left == 0:
            return element
        low, high = _root(self._lowest, abs(left)), _root(self._highest, abs(left))
        factor = LongInterval(low.lower(), high.upper(), known_sign=1)
        ends = _product(element, factor if left > 0 else _inverse(factor))
        return LongInterval(*ends, exponent, element.sign)


def _of(ball: arb) -> LongInterval:
    return LongInterval(ball.lower(), ball.upper())


def _root(x: arb, exponent: Fraction) -> arb:
    """Return x^exponent of x ≥ 0 for an exponent > 0."""
    if x == 0 or exponent == 1 or not x.is_finite():
        return x
    return x.sqrt() if exponent == Fraction(1, 2) else x ** fmpq(exponent.numerator, exponent.denominator)


def _log(x: arb) -> arb:
    return -_ALL if x == 0 else x.log()


def _sign(x: arb) -> arb:
    return arb(1) if x > 0 else arb(-1) if x < 0 else arb(0) if x == 0 else _UNKNOWN


def _size(x: LongInterval) -> LongInterval:
    if x.lo >= 0:
        return x
    if x.hi <= 0:
        return LongInterval(-x.hi, -x.lo, x.exponent, -x.known_sign)
    return LongInterval(_NOTHING, (-x.lo).max(x.hi), x.exponent)


def _inverse(x: LongInterval) -> LongInterval:
    """Return 1 / x; where 0 is an end of the bounds that x does not reach a limit is taken."""
    if x.sign > 0:
        hi = (1 / x.lo).upper() if x.lo > 0 else _ALL
        return LongInterval((1 / x.hi).lower(), hi, -x.exponent, x.sign)
    if x.sign < 0:
        lo, hi = (1 / -x.lo).lower(), (1 / -x.hi).upper() if x.hi < 0 else _ALL
        return LongInterval(-hi, -lo, -x.exponent, x.sign)
    return LongInterval(_UNKNOWN, _UNKNOWN, -x.exponent)


def _product(x: LongInterval, y: LongInterval) -> tuple[arb, arb]:
    if x.lo >= 0 and y.lo >= 0:
        return (x.lo * y.lo).lower(), (x.hi * y.hi).upper()
    lo, *ends = [a * b for a in (x.lo, x.hi) for b in (y.lo, y.hi)]
    lo, hi = lo.lower(), lo.upper()
    for end in ends:
        # NaN stays.
        lo, hi = lo.min(end.lower()), hi.max(end.upper())
    return lo, hi
