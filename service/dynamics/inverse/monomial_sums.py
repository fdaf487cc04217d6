"""Expands formulas into sums of monomials in g1, g2, g3, rho, logarithms and functions of g2."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain

from service.dynamics.exact import added_up, without_zeros
from service.dynamics.formula.folding import fold_power
from service.dynamics.formula.tape import Tape
from service.dynamics.verdict.proofs.energy_terms import power_text, sum_text, term_text

MAX_TERMS = 500
"""Terms of any sum on the way."""
MAX_WORK = 20_000
"""Terms made in one expansion."""
MAX_POWER = 60
"""Power of a sum that is multiplied out."""
MAX_COEFFICIENT_BITS = 8192
"""Bits of a numerator or a denominator on the way."""
MAX_ATOMS = 4
"""Functions of g2 and irrational constants that are kept as they are."""
MAX_ATOM_TERMS = 40
"""Terms in the argument of one of them."""

Powers = tuple[Fraction, ...]
"""Exponents of g1, g2, g3, rho = g1² + g3², log g1, log g3, log rho (g1, g3 absolute in a quadrant) and of
the atoms. Those of the logarithms are natural numbers."""
MonomialSum = dict[Powers, Fraction]
"""Coefficients by exponents, none of them 0."""

ATOMS = 7
"""Position of the first atom."""
GENERATORS = ATOMS + MAX_ATOMS
_ZERO, _ONE = Fraction(0), Fraction(1)
_CONSTANT: Powers = (_ZERO,) * GENERATORS
_RHO = 3
_LOGARITHM_OF = {0: 4, 2: 5, _RHO: 6}
"""Positions of the logarithms of the generators that may have one."""
_OF_G2 = {1: "g2", _RHO: "(1 - g2^2)", 6: "log(1 - g2^2)"}
"""A function of g2, as text."""


class NotAMonomialSumError(Exception):
    """The formula is not such a sum, or too large a one."""


@dataclass(frozen=True, slots=True)
class Expansion:
    """A sum of monomials, and what its atoms are: texts in ``g2`` alone, such as ``exp(g2)`` and ``pi``."""

    terms: MonomialSum
    atoms: tuple[str, ...]


def expand(tape: Tape) -> Expansion | None:
    """Return the formula as a sum of monomials, whatever the signs of g1 and g3; None if it is not one.

    Whole powers of sums are multiplied out; other powers are taken of
    monomials and of multiples of rho (also written 1 - g2²).
    """
    return _expand(tape, (1, 1, 1), frozenset((_RHO,)))


def expand_in_quadrant(tape: Tape, g1_sign: int, g3_sign: int) -> Expansion | None:
    """Return the formula as a sum of monomials in |g1| and |g3| where g1 and g3 have the signs given."""
    return _expand(tape, (g1_sign, 1, g3_sign), frozenset((0, 2, _RHO)))


def unit(position: int) -> Powers:
    """Return the exponents of one generator."""
    return tuple(_ONE if index == position else _ZERO for index in range(GENERATORS))


def _expand(tape: Tape, signs: Sequence[int], positive: frozenset[int]) -> Expansion | None:
    algebra = MonomialAlgebra(positive)
    inputs = [{unit(position): Fraction(sign)} for position, sign in enumerate(signs)]
    try:
        terms = tape.evaluate(algebra, inputs)
    except NotAMonomialSumError:
        return None
    return Expansion(terms, algebra.atoms)


class MonomialAlgebra:
    """Exact sums of monomials; other results raise NotAMonomialSumError.

    ``positive`` are the positions of the generators that are known to be so.
    """

    def __init__(self, positive: frozenset[int]) -> None:
        self._positive = positive
        self._atoms: list[str] = []
        self._work = 0

    @property
    def atoms(self) -> tuple[str, ...]:
        """The atoms, in the order of their positions."""
        return tuple(self._atoms)

    def constant(self, value: Fraction) -> MonomialSum:
        """Return an exact number."""
        return {_CONSTANT: value} if value else {}

    def pi(self) -> MonomialSum:
        """Return π as an atom."""
        return self._atom("pi")

    def add(self, left: MonomialSum, right: MonomialSum) -> MonomialSum:
        """Return left + right."""
        self._spend(len(left) + len(right))
        return _bounded(added_up(chain(left.items(), right.items())))

    def subtract(self, left: MonomialSum, right: MonomialSum) -> MonomialSum:
        """Return left - right."""
        return self.add(left, self.negate(right))

    def multiply(self, left: MonomialSum, right: MonomialSum) -> MonomialSum:
        """Return left · right."""
        self._spend(len(left) * len(right))
        return _bounded(
            added_up(
                (tuple(a + b if a and b else a or b for a, b in zip(one, other, strict=True)), first * second)
                for one, first in left.items()
                for other, second in right.items()
            )
        )

    def divide(self, left: MonomialSum, right: MonomialSum) -> MonomialSum:
        """Return left / right."""
        return self.multiply(left, self.power(right, Fraction(-1)))

    def negate(self, operand: MonomialSum) -> MonomialSum:
        """Return -operand."""
        return {powers: -coefficient for powers, coefficient in operand.items()}

    def power(self, base: MonomialSum, exponent: Fraction) -> MonomialSum:
        """Return base^exponent."""
        if not (_is_natural(exponent) and len(base) != 1):
            simple = self._power_of_monomial(_as_monomial(base), exponent)
            return (
                self._atom(power_text(f"({_text(base, self._atoms)})", exponent))
                if simple is None
                else simple
            )
        if base and exponent > MAX_POWER:
            raise NotAMonomialSumError
        result = self.constant(_ONE)
        for _ in range(exponent.numerator if base else 1):
            result = self.multiply(result, base)
        return result

    def general_power(self, base: MonomialSum, exponent: MonomialSum) -> MonomialSum:
        """Return base^exponent as an atom."""
        return self._atom(f"({_text(base, self._atoms)})^({_text(exponent, self._atoms)})")

    def call(self, name: str, argument: MonomialSum) -> MonomialSum:
        """Return the function: of a monomial whose sign is known if it is abs or log, else as an atom."""
        monomial = _as_monomial(argument)
        simple: MonomialSum | None = None
        if name == "abs" and not argument:
            simple = argument
        elif monomial is not None and name == "abs":
            simple = self._absolute(*monomial)
        elif monomial is not None and name == "log":
            simple = self._logarithm(*monomial)
        return self._atom(f"{name}({_text(argument, self._atoms)})") if simple is None else simple

    def _absolute(self, powers: Powers, coefficient: Fraction) -> MonomialSum | None:
        for position, exponent in enumerate(powers):
            if position not in self._positive and exponent.numerator % 2:
                return None
        return {powers: abs(coefficient)}

    def _logarithm(self, powers: Powers, coefficient: Fraction) -> MonomialSum | None:
        total: MonomialSum = {}
        for position, exponent in enumerate(powers):
            if exponent:
                if position not in self._positive:
                    return None
                total[unit(_LOGARITHM_OF[position])] = exponent
        return total if coefficient == 1 else None

    def _power_of_monomial(
        self, base: tuple[Powers, Fraction] | None, exponent: Fraction
    ) -> MonomialSum | None:
        if base is None:
            return None
        powers, coefficient = base
        if any(powers[position] for position in _LOGARITHM_OF.values()) and not _is_natural(exponent):
            return None
        bits = max(coefficient.numerator.bit_length(), coefficient.denominator.bit_length())
        if (bits - 1) * abs(exponent) > MAX_COEFFICIENT_BITS:
            raise NotAMonomialSumError
        if exponent.denominator == 1:
            value: Fraction | None = coefficient**exponent.numerator
        else:
            # A root needs a positive base: (g2²)^(1/2) is |g2|, which is no power of g2.
            known = all(power == 0 or position in self._positive for position, power in enumerate(powers))
            value = fold_power(coefficient, exponent) if known and coefficient > 0 else None
        return None if value is None else {_scaled(powers, exponent): value}

    def _atom(self, text: str) -> MonomialSum:
        if text not in self._atoms:
            if len(self._atoms) == MAX_ATOMS:
                raise NotAMonomialSumError
            self._atoms.append(text)
        return {unit(ATOMS + self._atoms.index(text)): _ONE}

    def _spend(self, work: int) -> None:
        self._work += work
        if self._work > MAX_WORK:
            raise NotAMonomialSumError


def _is_natural(exponent: Fraction) -> bool:
    return exponent.denominator == 1 and exponent >= 0


def _scaled(powers: Powers, factor: Fraction) -> Powers:
    return tuple(power * factor for power in powers)


def _as_monomial(base: MonomialSum) -> tuple[Powers, Fraction] | None:
    """Return the powers and the coefficient, also of c (g1² + g3²) and c (1 - g2²), which are c rho."""
    if len(base) == 1:
        return next(iter(base.items()))
    squares = [_scaled(unit(position), Fraction(2)) for position in range(3)]
    if len(base) == 2:
        for first, second, sign in ((squares[0], squares[2], 1), (_CONSTANT, squares[1], -1)):
            if first in base and base.get(second) == sign * base[first]:
                return unit(_RHO), base[first]
    return None


def _text(terms: MonomialSum, atoms: Sequence[str]) -> str:
    """Return a function of g2 as text; raise NotAMonomialSumError if it is none, or too long."""
    names = _OF_G2 | {ATOMS + number: f"({atom})" for number, atom in enumerate(atoms)}
    if len(terms) > MAX_ATOM_TERMS:
        raise NotAMonomialSumError
    parts: list[str] = []
    for powers in sorted(terms, reverse=True):
        if any(exponent and position not in names for position, exponent in enumerate(powers)):
            raise NotAMonomialSumError
        parts.append(term_text(terms[powers], *(power_text(names[p], powers[p]) for p in names)))
    return sum_text(parts)


def _bounded(total: MonomialSum) -> MonomialSum:
    """Return the sum without zero terms, if it is within the limits."""
    if len(total) > MAX_TERMS:
        raise NotAMonomialSumError
    for value in total.values():
        if max(value.numerator.bit_length(), value.denominator.bit_length()) > MAX_COEFFICIENT_BITS:
            raise NotAMonomialSumError
    return without_zeros(total)
