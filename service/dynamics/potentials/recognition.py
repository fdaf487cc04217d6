"""Recognises properties of a potential that allow faster or more exact methods: symmetry, and three terms."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from fractions import Fraction

from flint import fmpq

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.monomials import SPHERE, NotAMonomialSumError, Rules, as_fraction, read
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.families.general_solution import GeneralPotential
from service.dynamics.potentials.potential import FormulaPotential, Potential


class Parity(Enum):
    """The effect of a change of signs on a value."""

    EVEN = 0
    ODD = 1
    NEITHER = 2


class ParityAlgebra:
    """An Algebra of proven parities; NEITHER means that nothing is proved."""

    def constant(self, value: Fraction) -> Parity:
        """Return that a number stays what it is."""
        return Parity.EVEN

    def pi(self) -> Parity:
        """Return that π stays what it is."""
        return Parity.EVEN

    def add(self, left: Parity, right: Parity) -> Parity:
        """Return the parity of a sum."""
        return left if left is right else Parity.NEITHER

    def subtract(self, left: Parity, right: Parity) -> Parity:
        """Return the parity of a difference."""
        return self.add(left, right)

    def multiply(self, left: Parity, right: Parity) -> Parity:
        """Return the parity of a product."""
        if Parity.NEITHER in (left, right):
            return Parity.NEITHER
        return Parity.EVEN if left is right else Parity.ODD

    def divide(self, left: Parity, right: Parity) -> Parity:
        """Return the parity of a quotient."""
        return self.multiply(left, right)

    def negate(self, operand: Parity) -> Parity:
        """Return the parity of -operand."""
        return operand

    def power(self, base: Parity, exponent: Fraction) -> Parity:
        """Return the parity of base^exponent; roots of what changes its sign have none."""
        if base is Parity.ODD:
            if exponent.denominator != 1:
                return Parity.NEITHER
            return Parity.ODD if exponent.numerator % 2 else Parity.EVEN
        return base

    def general_power(self, base: Parity, exponent: Parity) -> Parity:
        """Return the parity of base^exponent."""
        return Parity.EVEN if base is exponent is Parity.EVEN else Parity.NEITHER

    def call(self, name: str, argument: Parity) -> Parity:
        """Return the parity of a function."""
        if argument is Parity.ODD:
            if name in ("abs", "cos"):
                return Parity.EVEN
            return Parity.ODD if name in ("sin", "tan", "sign") else Parity.NEITHER
        return argument


def is_written_even(tape: Tape, position: int) -> bool:
    """Tell whether the instructions prove that the formula is even in the variable at this position."""
    known: bool | None = tape.derived.get(("even", position))
    if known is None:
        known = tape.derived["even", position] = _is_even_exponent(tape, position)
    return known


def _is_even_exponent(tape: Tape, position: int) -> bool:
    parities = [Parity.ODD if k == position else Parity.EVEN for k in range(len(tape.variables))]
    return tape.evaluate(ParityAlgebra(), parities) is Parity.EVEN


Exponents = tuple[int, int, int, int]
"""Exponents of |x|, |y|, g2 and the sign of y."""
Laurent = Mapping[Exponents, fmpq]
MAX_TERMS = 200


def laurent(
    tape: Tape, sign: int, *, is_exchanged: bool = False, most_products: int | None = None
) -> Laurent | None:
    """Return the formula as a sum of |x|^i |y|^j g2^k (sgn y)^e, k ≤ 1 and e 0 or 1; None for any other.

    None too if it has no value for one sign of y, has more than MAX_TERMS terms on the way, or takes
    ``most_products`` products of terms.

    Parameters
    ----------
    sign
        The known sign of x, which is g1, or g3 if the axes are exchanged; y is the other one.
    """
    signs = (0, 0, sign) if is_exchanged else (sign, 0, 0)
    rules = Rules(
        signs, plain=2, relation=SPHERE[1], has_roots=False, most_terms=MAX_TERMS, most_work=most_products
    )
    try:
        found = read(tape, rules)
    except NotAMonomialSumError:
        return None
    if found.positive:
        return None
    if is_exchanged:
        return {(d, a, b, odd & 1): value for (a, b, d, odd, _), value in found.terms.items()}
    return {(a, d, b, odd >> 2): value for (a, b, d, odd, _), value in found.terms.items()}


MAX_PRODUCTS_EVEN = 20_000
"""Most products of terms, before a formula counts as not even."""


def is_even_in_g2(potential: Potential) -> bool:
    """Tell whether V(g1, −g2, g3) = V(g1, g2, g3) on the sphere is proved.

    False is no claim. A V given by an integral over F is even if its G is: the integral depends on g1 and g3.
    """
    if isinstance(potential, GeneralPotential):
        return all(_is_even(piece.even.tape) for piece in potential.pieces)
    return potential.has_formula and _is_even(potential.tape)


def _is_even(tape: Tape) -> bool:
    if is_written_even(tape, 1):
        return True
    known: bool | None = tape.derived.get(_is_even)
    if known is None:
        known = tape.derived[_is_even] = _multiplies_out_even(tape)
    return known


def _multiplies_out_even(tape: Tape) -> bool:
    # Written out in powers of g1 and g3, with g2 to the first power at most.
    for sign in (1, -1):
        terms = laurent(tape, sign, most_products=MAX_PRODUCTS_EVEN)
        if terms is None or any(k for _, _, k, _ in terms):
            return False
    return True


@dataclass(frozen=True, slots=True)
class ThreeTerms:
    """V = a1 g1 + c1 (g1² − g2²) + b1 / g3² + constant, for A = 2C.

    For C = 2A the first and third axes are exchanged: g1 and g3 here are the
    client's g3 and g1.
    """

    a1: Fraction
    b1: Fraction
    c1: Fraction
    constant: Fraction = Fraction(0)


def recognise(
    body: RigidBody, potential: Potential, g1_sign: int = 1, *, most_products: int | None = None
) -> ThreeTerms | None:
    """Return ``potential`` as three terms if it equals them on |g| = 1, else None.

    ``g1_sign`` is the sign of g1 there (of the client's g3 for C = 2A), which
    matters to a formula with abs in it. Exact: the formula is expanded in rational
    numbers. One with π, irrational constants or other functions is not recognised,
    nor one that takes more than ``most_products`` products of terms.
    """
    is_exchanged = body.C == 2 * body.A
    if not (is_exchanged or body.A == 2 * body.C) or not isinstance(potential, FormulaPotential):
        return None
    expanded = laurent(potential.tape, g1_sign, is_exchanged=is_exchanged, most_products=most_products)
    if expanded is None:
        return None

    def coefficient(i: int, j: int) -> Fraction:
        return as_fraction(expanded.get((i, j, 0, 0), fmpq(0)))

    # c1 (g1² − g2²) = c1 (2 g1² + g3²) − c1.
    c1 = coefficient(0, 2)
    expected = {(1, 0, 0, 0), (0, -2, 0, 0), (2, 0, 0, 0), (0, 2, 0, 0), (0, 0, 0, 0)}
    if coefficient(2, 0) != 2 * c1 or not expected.issuperset(expanded):
        return None
    return ThreeTerms(g1_sign * coefficient(1, 0), coefficient(0, -2), c1, coefficient(0, 0) + c1)
