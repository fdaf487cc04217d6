r"""Exact sums of monomials, in which formulas are read: one algebra, and what its uses differ in as rules.

A monomial is \|g1\|^a \|g2\|^b \|g3\|^d, times the signs of some of the three, times powers of *atoms*: of
rho = g1² + g3², of logarithms of what is positive, of functions of g2 alone and of irrational numbers.
Exponents are integers in parts of one ``unit``, found while a formula is read, coefficients are flint's
rationals: neither is dearer for a denominator of many digits. Relations are optional, such as that of the
sphere, which replaces the square of one coordinate throughout and gives every polynomial one form.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import gcd, lcm
from typing import NamedTuple, TypeVar

from flint import fmpq

from service.dynamics.errors import FormulaError
from service.dynamics.formula.algebra import DerivedOperations
from service.dynamics.formula.tape import Tape
from service.dynamics.formula.tree import fold_power

Key = TypeVar("Key")
Ratio = TypeVar("Ratio", Fraction, fmpq, int)

Powers = tuple[tuple[int, int], ...]
"""Atoms by their numbers, with their exponents, in order."""
Monomial = tuple[int, int, int, int, Powers]
"""Exponents of |g1|, |g2|, |g3| in parts of the unit; the bits 1, 2, 4 of its sign in g1, g2, g3; atoms."""
MonomialSum = dict[Monomial, fmpq]
"""Coefficients, none of them 0."""

ONE: Monomial = (0, 0, 0, 0, ())
RHO, LOG_G1, LOG_G3, LOG_RHO = -4, -3, -2, -1
"""Numbers of the atoms that every sum may have; others are numbered from 0."""
_LOGARITHMS = {LOG_G1, LOG_G3, LOG_RHO}
_G2 = 2
_MAX_UNIT_BITS = 1024
"""Bits of a common denominator of exponents."""


class NotAMonomialSumError(Exception):
    """The formula is not such a sum, or too large a one."""


class _FinerUnitError(Exception):
    """An exponent is no multiple of the unit; it is one of a unit so many times finer."""

    def __init__(self, factor: int) -> None:
        super().__init__(factor)
        self.factor = factor


class Atom(NamedTuple):
    """A function of g2 alone, or of nothing: its name, and the terms of its arguments with their p/q."""

    name: str
    arguments: tuple[tuple[tuple[Monomial, int, int], ...], ...] = ()
    exponent: tuple[int, int] = (1, 1)
    """The ratio of a ``power``."""


ALL_ATOMS = frozenset(("pi", "power", "general_power", "exp", "log", "sin", "cos", "tan", "abs"))


@dataclass(frozen=True, slots=True)
class SquareRelation:
    """The square of one coordinate as a polynomial: exponents of all three, and the coefficients."""

    position: int
    square: tuple[tuple[int, int, int, int], ...]


SPHERE = (
    SquareRelation(0, ((0, 0, 0, 1), (0, 2, 0, -1), (0, 0, 2, -1))),
    SquareRelation(1, ((0, 0, 0, 1), (2, 0, 0, -1), (0, 0, 2, -1))),
    SquareRelation(2, ((0, 0, 0, 1), (2, 0, 0, -1), (0, 2, 0, -1))),
)
"""1 minus the squares of the others, by the position of the coordinate whose square is replaced."""


@dataclass(frozen=True, slots=True)
class Rules:
    """The differences between uses of the algebra; a sum beyond a limit is none."""

    signs: tuple[int, int, int] = (0, 0, 0)
    """The known signs of g1, g2, g3; 0 where both are met."""
    plain: int = 0
    """Bits of the coordinates of which no roots and absolute values are monomials."""
    relation: SquareRelation | None = None
    """Applied throughout."""
    atoms: frozenset[str] = frozenset()
    """Functions that are kept as they are, where nothing simpler is known of them."""
    nests: bool = True
    """Whether functions have other atoms and fractional powers in them."""
    has_roots: bool = True
    """Whether there are fractional exponents."""
    most_atoms: int = 1000
    most_argument_terms: int = 1000
    most_terms: int = 1000
    most_products: int = 1_000_000
    """Terms of one product before equal ones are added."""
    most_work: int | None = None
    """Products of terms in one formula."""
    most_power: int = 64
    """Power of a sum that is multiplied out."""
    most_degree: int | None = None
    most_bits: int = 8192
    """Size of a numerator or denominator."""
    checks_bits: bool = True
    """Whether this is looked at in sums and products too, and not only before powers are taken."""


@dataclass(frozen=True, slots=True)
class ReadSum:
    """A formula as a sum of monomials."""

    terms: MonomialSum
    unit: int
    """Exponents are integers in parts of it."""
    atoms: tuple[Atom, ...]
    positive: int
    """Bits of the coordinates of which roots are taken: there is no value where one of them is negative."""


def read(tape: Tape, rules: Rules, numbers: Sequence[fmpq] | None = None) -> ReadSum:
    """Return a formula in g1, g2, g3 as a sum; ``numbers`` take the places of its own, in order.

    Raises
    ------
    NotAMonomialSumError
        It is none, by the rules.
    """
    unit = 1
    if rules.has_roots:
        made = [(each.operation, each.number) for each in tape.instructions if each.number is not None]
        given: Sequence[fmpq | Fraction] = [x for _, x in made] if numbers is None else numbers
        unit = lcm(*(ratio_of(x)[1] for (name, _), x in zip(made, given, strict=True) if name == "power"))
    while unit.bit_length() <= _MAX_UNIT_BITS:
        algebra = MonomialAlgebra(rules, unit, numbers)
        try:
            terms = tape.evaluate(algebra, algebra.coordinates())
        except _FinerUnitError as error:
            if not rules.has_roots:
                break
            unit *= error.factor
        except FormulaError as error:
            raise NotAMonomialSumError from error
        else:
            return ReadSum(terms, unit, tuple(algebra.atoms), algebra.positive)
    raise NotAMonomialSumError


class MonomialAlgebra(DerivedOperations[MonomialSum]):
    """Sums of monomials by some rules; what is none of them raises NotAMonomialSumError."""

    def __init__(self, rules: Rules, unit: int = 1, numbers: Sequence[fmpq] | None = None) -> None:
        self._rules, self._unit = rules, unit
        self._numbers = None if numbers is None else iter(numbers)
        self._work = 0
        self.atoms: dict[Atom, int] = {}
        self.positive = 0

    def coordinates(self) -> list[MonomialSum]:
        """Return g1, g2 and g3."""
        unit, found = self._unit, list[MonomialSum]()
        for position, sign in enumerate(self._rules.signs):
            a, b, d = (unit * (position == k) for k in range(3))
            found.append({(a, b, d, 0 if sign else 1 << position, ()): fmpq(sign or 1)})
        return found

    def constant(self, value: Fraction) -> MonomialSum:
        """Return an exact number."""
        number = as_fmpq(value) if self._numbers is None else next(self._numbers)
        return {ONE: number} if number else {}

    def pi(self) -> MonomialSum:
        """Return π as an atom."""
        return self._atom(Atom("pi"))

    def add(self, left: MonomialSum, right: MonomialSum) -> MonomialSum:
        """Return left + right."""
        total = dict(left)
        for monomial, value in right.items():
            known = total.get(monomial)
            total[monomial] = value if known is None else known + value
            if known is not None and not total[monomial]:
                del total[monomial]
        return self._limited(total)

    def negate(self, operand: MonomialSum) -> MonomialSum:
        """Return -operand."""
        return {monomial: -value for monomial, value in operand.items()}

    def multiply(self, left: MonomialSum, right: MonomialSum) -> MonomialSum:
        """Return left · right."""
        rules, count = self._rules, len(left) * len(right)
        self._work += count
        if count > rules.most_products or (rules.most_work is not None and self._work > rules.most_work):
            raise NotAMonomialSumError
        if len(left) == 1:
            left, right = right, left
        if len(right) == 1:
            # Multiples of different monomials are different.
            (((e, f, g, t, q), y),) = right.items()
            return self._reduced(
                {
                    (a + e, b + f, d + g, s ^ t, _together(p, q) if p and q else p or q): x * y
                    for (a, b, d, s, p), x in left.items()
                }
            )
        total = added_up(
            ((a + e, b + f, d + g, s ^ t, _together(p, q) if p and q else p or q), x * y)
            for (a, b, d, s, p), x in left.items()
            for (e, f, g, t, q), y in right.items()
        )
        return self._reduced(without_zeros(total))

    def divide(self, left: MonomialSum, right: MonomialSum) -> MonomialSum:
        """Return left / right."""
        return self.multiply(left, self._power(right, -1, 1))

    def power(self, base: MonomialSum, exponent: Fraction) -> MonomialSum:
        """Return base^exponent."""
        return self._power(base, *ratio_of(exponent if self._numbers is None else next(self._numbers)))

    def general_power(self, base: MonomialSum, exponent: MonomialSum) -> MonomialSum:
        """Return base^exponent as an atom."""
        return self._atom(Atom("general_power"), base, exponent)

    def call(self, name: str, argument: MonomialSum) -> MonomialSum:
        """Return the function: of a monomial whose sign is known if it is abs or log, else as an atom."""
        monomial = self._as_monomial(argument)
        simple: MonomialSum | None = None
        if name == "abs":
            simple = argument if monomial is None and not argument else self._absolute(monomial)
        elif name == "log" and name in self._rules.atoms:
            simple = self._logarithm(monomial)
        return self._atom(Atom(name), argument) if simple is None else simple

    def _power(self, base: MonomialSum, n: int, q: int) -> MonomialSum:
        """Return base^(n/q)."""
        if len(base) == 1:
            (((a, b, d, signs, powers), c),) = base.items()
            if not (b or signs or powers) and c == 1 and not self._rules.plain:
                # The usual case: a power of |g1| or |g3|.
                return {(self._part(a * n, q) if a else 0, 0, self._part(d * n, q) if d else 0, 0, ()): c}
        if q > 1 or n < 0 or len(base) == 1:
            simple = self._power_of_monomial(self._as_monomial(base), n, q)
            if simple is None and base:
                return self._atom(Atom("power", exponent=(n, q)), base)
            if simple is None:
                raise NotAMonomialSumError
            return self._reduced(simple)
        if base and n > self._rules.most_power:
            raise NotAMonomialSumError
        result: MonomialSum = {ONE: fmpq(1)}
        for _ in range(n if base else 1):
            result = self.multiply(result, base)
        return result

    def _as_monomial(self, base: MonomialSum) -> tuple[Monomial, fmpq] | None:
        """Return the monomial and the coefficient, also of c (g1² + g3²) and c (1 - g2²), which are c rho."""
        if len(base) == 1:
            return next(iter(base.items()))
        if len(base) == 2 and "power" in self._rules.atoms:
            twice = 2 * self._unit
            first, height, third = (twice, 0, 0, 0, ()), (0, twice, 0, 0, ()), (0, 0, twice, 0, ())
            for one, other, sign in ((first, third, 1), (ONE, height, -1)):
                if one in base and base.get(other) == sign * base[one]:
                    return (0, 0, 0, 0, ((RHO, self._unit),)), base[one]
        return None

    def _power_of_monomial(self, base: tuple[Monomial, fmpq] | None, n: int, q: int) -> MonomialSum | None:
        if base is None:
            return None
        (a, b, d, signs, powers), c = base
        if powers:
            numbers = {number for number, _ in powers}
            if (q > 1 and numbers != {RHO}) or (n < 0 and numbers & _LOGARITHMS):
                return None
            powers = tuple((number, self._part(e * n, q)) for number, e in powers)
        if q > 1:
            has_plain = any(e and bit & self._rules.plain for e, bit in ((a, 1), (b, 2), (d, 4)))
            if signs not in (0, 1, 2, 4) or has_plain:
                # (g2²)^(1/2) is |g2|, which is no power of g2.
                return None
            self.positive |= signs
        number = c if c == 1 else self._power_of_number(c, n, q)
        a, b, d = (self._part(e * n, q) if e else 0 for e in (a, b, d))
        return None if number is None else {(a, b, d, signs if q == 1 and n % 2 else 0, powers): number}

    def _power_of_number(self, c: fmpq, n: int, q: int) -> fmpq | None:
        if (int(c.height_bits()) - 1) * abs(n) > self._rules.most_bits * q:
            raise NotAMonomialSumError
        if q == 1:
            return c**n
        root = fold_power(as_fraction(c), Fraction(n, q)) if c > 0 else None
        return None if root is None else as_fmpq(root)

    def _part(self, numerator: int, denominator: int) -> int:
        quotient, rest = divmod(numerator, denominator)
        if rest:
            raise _FinerUnitError(denominator // gcd(denominator, rest))
        return quotient

    def _absolute(self, monomial: tuple[Monomial, fmpq] | None) -> MonomialSum | None:
        if monomial is None:
            return None
        (a, b, d, signs, powers), c = monomial
        is_odd = any(k != RHO and (e // self._unit) % 2 for k, e in powers)
        return None if is_odd or signs & (self._rules.plain | _G2) else {(a, b, d, 0, powers): abs(c)}

    def _logarithm(self, monomial: tuple[Monomial, fmpq] | None) -> MonomialSum | None:
        if monomial is None:
            return None
        (a, b, d, signs, powers), c = monomial
        first, _, third = self._rules.signs
        is_known = all(known or not e for known, e in ((first, a), (0, b), (third, d)))
        if c != 1 or signs or not is_known or any(k != RHO for k, _ in powers):
            return None
        exponents = {LOG_G1: a, LOG_G3: d, LOG_RHO: dict(powers).get(RHO, 0)}
        return {(0, 0, 0, 0, ((k, self._unit),)): fmpq(e, self._unit) for k, e in exponents.items() if e}

    def _atom(self, atom: Atom, *arguments: MonomialSum) -> MonomialSum:
        """Return a function of g2, which is one atom wherever its arguments are the same sums."""
        if atom.name not in self._rules.atoms:
            raise NotAMonomialSumError
        made = atom._replace(arguments=tuple(self._argument(terms) for terms in arguments))
        number = self.atoms.setdefault(made, len(self.atoms))
        if number >= self._rules.most_atoms:
            raise NotAMonomialSumError
        return {(0, 0, 0, 0, ((number, self._unit),)): fmpq(1)}

    def _argument(self, terms: MonomialSum) -> tuple[tuple[Monomial, int, int], ...]:
        if len(terms) > self._rules.most_argument_terms:
            raise NotAMonomialSumError
        for a, b, d, signs, powers in terms:
            is_of_g2 = not (a or d or signs & ~_G2 or any(k in (LOG_G1, LOG_G3) for k, _ in powers))
            if not is_of_g2 or not (self._rules.nests or (not powers and b % self._unit == 0)):
                raise NotAMonomialSumError
        return tuple(sorted((monomial, *ratio_of(value)) for monomial, value in terms.items()))

    def _reduced(self, total: MonomialSum) -> MonomialSum:
        relation = self._rules.relation
        return self._limited(total if relation is None else reduced(total, relation, self._unit))

    def _limited(self, total: MonomialSum) -> MonomialSum:
        """Return the sum, if it is within the limits."""
        rules = self._rules
        if len(total) > rules.most_terms:
            raise NotAMonomialSumError
        if rules.checks_bits and any(c.height_bits() > rules.most_bits for c in total.values()):
            raise NotAMonomialSumError
        if rules.most_degree is not None:
            most = rules.most_degree * self._unit
            if any(a + b + d > most for a, b, d, *_ in total):
                raise NotAMonomialSumError
        return total


def _together(left: Powers, right: Powers) -> Powers:
    powers = dict(left)
    for number, exponent in right:
        powers[number] = powers.get(number, 0) + exponent
    return tuple(sorted((number, exponent) for number, exponent in powers.items() if exponent))


def reduced(total: MonomialSum, relation: SquareRelation, unit: int = 1) -> MonomialSum:
    """Return the sum with all squares of one coordinate replaced; powers that are not whole stay."""
    place, twice, found = relation.position, 2 * unit, dict(total)

    def power(monomial: Monomial) -> int:
        exponent = monomial[:3][place]
        return exponent if exponent >= twice and exponent % unit == 0 else 0

    # From the largest power down, so that each is met once, with all that falls to it.
    while highest := max(map(power, found), default=0):
        for key in [key for key in found if power(key) == highest]:
            value, (*exponents, signs, atoms) = found.pop(key), key
            exponents[place] -= twice
            for *change, factor in relation.square:
                a, b, d = (e + unit * by for e, by in zip(exponents, change, strict=True))
                other = a, b, d, signs, atoms
                found[other] = found[other] + factor * value if other in found else factor * value
    return without_zeros(found)


def added_up(terms: Iterable[tuple[Key, Ratio]]) -> dict[Key, Ratio]:
    """Return the sum of the terms in the order in which their keys first come; it may have zeros."""
    total: dict[Key, Ratio] = {}
    for key, value in terms:
        known = total.get(key)
        total[key] = value if known is None else known + value
    return total


def without_zeros(total: Mapping[Key, Ratio]) -> dict[Key, Ratio]:
    """Return the terms that are not zero."""
    return {key: value for key, value in total.items() if value}


def weighted_sum(parts: Iterable[tuple[Ratio, Mapping[Key, Ratio]]]) -> dict[Key, Ratio]:
    """Return Σ weight · sum, without zeros."""
    return without_zeros(added_up((key, weight * x) for weight, terms in parts for key, x in terms.items()))


def ratio_of(value: fmpq | Fraction) -> tuple[int, int]:
    """Return numerator and denominator of an exact number of either library."""
    # Whether it is a Fraction would take ten times as long to ask.
    return (int(value.p), int(value.q)) if isinstance(value, fmpq) else value.as_integer_ratio()


def as_fmpq(value: Fraction) -> fmpq:
    """Return Python's rational as flint's."""
    return fmpq(*value.as_integer_ratio())


def as_fraction(value: fmpq) -> Fraction:
    """Return flint's rational as Python's."""
    return Fraction(int(value.p), int(value.q))
