r"""Recognises potentials on the sphere of the form V = c₀(g2) + c₁(g2) g1².

For them D = g1 V_3 − g3 V_1 = −2 g1 g3 c₁(g2): p² has its signs and zeros at the same g2 on every curve, with
the same orders. Among the admissible potentials, V = V1[F] + Q G(g2), these are the ones with a constant F.
With any other F, the sum of (V1 + F)/Q and G, of whose sign p² is, changes along each circle g2 = const: no
zero stays there for every λ.
"""

from dataclasses import dataclass, field
from fractions import Fraction

from flint import Ordering, fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from service.dynamics.formula.tape import Tape

MOST_ATOMS = 24
HIGHEST_POWER = 16
MOST_TERMS = 200

Element = fmpq_mpoly | None
"""A polynomial in g3, g1, g2 and functions of g2, with g3 once at most; None is any other function."""


def turns_by_latitude(tape: Tape, g1_sign: int, g3_sign: int) -> bool:
    """Tell whether V = c₀(g2) + c₁(g2) g1² is proved where g1 and g3 have these signs; False is no claim."""
    algebra = _OfLatitude((g1_sign, g3_sign))
    found = tape.evaluate(algebra, algebra.axes())
    if found is None:
        return False
    return all(powers[0] == 0 and powers[1] in (0, 2) for powers, _ in found.terms())


@dataclass(slots=True)
class _OfLatitude:
    """An Algebra of polynomials on the sphere in which functions of g2 alone are further variables."""

    signs: tuple[int, int]
    """Signs of g1 and g3."""
    atoms: dict[tuple[str, ...], int] = field(default_factory=dict)
    context: fmpq_mpoly_ctx = field(
        default_factory=lambda: fmpq_mpoly_ctx.get(
            ["g3", "g1", "g2", *(f"f{k}" for k in range(MOST_ATOMS))], Ordering.lex
        )
    )

    def axes(self) -> tuple[Element, Element, Element]:
        """Return g1, g2 and g3."""
        g3, g1, g2 = self.context.gens()[:3]
        return g1, g2, g3

    def constant(self, value: Fraction) -> Element:
        return self.context.constant(fmpq(value.numerator, value.denominator))

    def pi(self) -> Element:
        return self._atom("pi")

    def add(self, left: Element, right: Element) -> Element:
        return None if left is None or right is None else self._reduced(left + right)

    def subtract(self, left: Element, right: Element) -> Element:
        return None if left is None or right is None else self._reduced(left - right)

    def multiply(self, left: Element, right: Element) -> Element:
        if left is None or right is None or len(left) * len(right) > MOST_TERMS**2:
            return None
        return self._reduced(left * right)

    def negate(self, operand: Element) -> Element:
        return None if operand is None else -operand

    def divide(self, left: Element, right: Element) -> Element:
        return self.multiply(left, self.power(right, Fraction(-1)))

    def power(self, base: Element, exponent: Fraction) -> Element:
        if base is None:
            return None
        if exponent.denominator == 1 and 0 < exponent <= HIGHEST_POWER:
            power: Element = base
            for _ in range(exponent.numerator - 1):
                power = self.multiply(power, base)
            return power
        if base.is_constant() and base and exponent.denominator == 1 and abs(exponent) <= HIGHEST_POWER:
            return self.context.constant(base.leading_coefficient() ** exponent.numerator)
        return self._atom("power", base, str(exponent)) if _is_of_latitude(base) else None

    def general_power(self, base: Element, exponent: Element) -> Element:
        if base is None or exponent is None or not (_is_of_latitude(base) and _is_of_latitude(exponent)):
            return None
        return self._atom("general_power", base, exponent)

    def call(self, name: str, argument: Element) -> Element:
        if argument is None:
            return None
        if _is_of_latitude(argument):
            return self._atom(name, argument)
        sign = self._sign(argument) if name in ("abs", "sign") else 0
        if not sign:
            return None
        return self.context.constant(fmpq(sign)) if name == "sign" else argument * sign

    def _sign(self, polynomial: fmpq_mpoly) -> int:
        """Return the sign of c g1^i g3^j, 0 for any other polynomial."""
        terms = list(polynomial.terms())
        if len(terms) != 1 or any(terms[0][0][2:]):
            return 0
        (third, first, *_), coefficient = terms[0]
        sign = 1 if coefficient > 0 else -1
        return int(sign * self.signs[0] ** (first % 2) * self.signs[1] ** (third % 2))

    def _atom(self, *key: str | fmpq_mpoly) -> Element:
        """Return the variable of a function of g2; the same function of the same polynomial is one."""
        text = tuple(map(str, key))
        if text not in self.atoms and len(self.atoms) == MOST_ATOMS:
            return None
        return self.context.gens()[3 + self.atoms.setdefault(text, len(self.atoms))]

    def _reduced(self, polynomial: fmpq_mpoly) -> Element:
        g3, g1, g2 = self.context.gens()[:3]
        found = polynomial % (g3**2 - (1 - g1**2 - g2**2))
        return found if len(found) <= MOST_TERMS else None


def _is_of_latitude(polynomial: fmpq_mpoly) -> bool:
    return all(not powers[0] and not powers[1] for powers, _ in polynomial.terms())
