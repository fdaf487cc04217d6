"""A ring in which a reduced motion is differentiated along itself, exactly.

Over a field K (rationals, or Q[B] modulo a minimal polynomial) and for a fixed rational x: K[u, v] modulo
u² = U(x) and v² = V(x), and over that first-order Taylor series in time. An identity that is polynomial in x
holds if it holds for more values of x than its degree.
"""

from fractions import Fraction

from flint import fmpq, fmpq_poly


class Residue:
    """A number of Q[B] modulo an irreducible polynomial."""

    def __init__(self, polynomial: fmpq_poly, modulus: fmpq_poly) -> None:
        self.modulus = modulus
        self.polynomial = polynomial % modulus

    def _of(self, other: object) -> "Residue | None":
        if isinstance(other, Residue):
            return other
        if isinstance(other, int | Fraction):
            number = Fraction(other)
            return Residue(fmpq_poly([fmpq(number.numerator, number.denominator)]), self.modulus)
        return None

    def __add__(self, other):
        there = self._of(other)
        return NotImplemented if there is None else Residue(self.polynomial + there.polynomial, self.modulus)

    def __mul__(self, other):
        there = self._of(other)
        return NotImplemented if there is None else Residue(self.polynomial * there.polynomial, self.modulus)

    def inverse(self) -> "Residue":
        divisor, factor, _ = self.polynomial.xgcd(self.modulus)
        assert divisor.degree() == 0
        return Residue(factor / divisor[0], self.modulus)

    def __truediv__(self, other):
        there = self._of(other)
        return NotImplemented if there is None else self * there.inverse()

    def __rtruediv__(self, other):
        return self.inverse() * other

    def __neg__(self):
        return self * -1

    def __sub__(self, other):
        return self + (-other)

    def __rsub__(self, other):
        return (-self) + other

    def __pow__(self, exponent: int):
        return Residue(self.polynomial**exponent, self.modulus)

    def __eq__(self, other):
        return (self - other).polynomial == fmpq_poly([])

    __radd__, __rmul__, __hash__ = __add__, __mul__, None


class OnCurve:
    """a + b u + c v + d u v with u² = U, v² = V."""

    def __init__(self, parts, U, V) -> None:
        self.parts, self.U, self.V = tuple(parts), U, V

    def _of(self, other):
        return other if isinstance(other, OnCurve) else OnCurve((other, 0, 0, 0), self.U, self.V)

    def __add__(self, other):
        pairs = zip(self.parts, self._of(other).parts, strict=True)
        return OnCurve([x + y for x, y in pairs], self.U, self.V)

    def __mul__(self, other):
        a, b, c, d = self.parts
        e, f, g, h = self._of(other).parts
        U, V = self.U, self.V
        return OnCurve(
            (
                a * e + U * (b * f) + V * (c * g) + U * V * (d * h),
                a * f + b * e + V * (c * h + d * g),
                a * g + c * e + U * (b * h + d * f),
                a * h + d * e + b * g + c * f,
            ),
            U,
            V,
        )

    def inverse(self):
        a, *rest = self.parts
        assert all(part == 0 for part in rest), "only functions of x are divided by"
        return OnCurve((1 / a if not isinstance(a, int) else Fraction(1, a), 0, 0, 0), self.U, self.V)

    def __neg__(self):
        return self * -1

    def is_zero(self) -> bool:
        return all(part == 0 for part in self.parts)

    __radd__, __rmul__ = __add__, __mul__


class InTime:
    """A value and its rate."""

    def __init__(self, now, rate) -> None:
        self.now, self.rate = now, rate

    def _of(self, other):
        return other if isinstance(other, InTime) else InTime(self.now._of(other), self.now._of(0))

    def __add__(self, other):
        there = self._of(other)
        return InTime(self.now + there.now, self.rate + there.rate)

    def __mul__(self, other):
        there = self._of(other)
        return InTime(self.now * there.now, self.now * there.rate + self.rate * there.now)

    def __truediv__(self, other):
        there = self._of(other)
        inverse = there.now.inverse()
        return self * InTime(inverse, -(inverse * inverse * there.rate))

    def __rtruediv__(self, other):
        return self._of(other) / self

    def __neg__(self):
        return self * -1

    def __sub__(self, other):
        return self + (-self._of(other))

    def __rsub__(self, other):
        return (-self) + other

    def __pow__(self, exponent: int):
        product = self._of(1)
        for _ in range(exponent):
            product = product * self
        return product

    __radd__, __rmul__ = __add__, __mul__
