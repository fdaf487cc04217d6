"""Decides exactly whether H is constant on the curves, for sums of real powers of the coordinates.

A term c |g1|^a |g2|^b |g3|^d, with any rational a, d and b ≥ 0, has

    2 (A - C) H = term · (2 (A - C) + A d g1²/g3² + C d - A a - C a g3²/g1²),

hence H of a sum is one too. With g2² = 1 - g1² - g3² its whole powers of g2 become 0 and 1. Its terms are
independent on an octant, and those that are constant on the curves |g3| = λ |g1|^(C/A) are those without g2
and with a A + d C = 0. If others are left, V is not admissible, as long as all powers of g2 were whole: of
the weights a A + d C of terms with g2 the largest would have to be -A (for A > C), and the smallest 0, by the
derivative along the curves. Where b is a fraction V is continuous at g2 = 0, and the energy has no g2.

Exponents are not roots of anything here, as they are in the ring of :mod:`.proof`: their denominators do not
matter. That of α = A/C has 16 digits for a moment that was drawn at random.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import product
from math import comb
from types import MappingProxyType
from typing import NamedTuple

from flint import arb, fmpq

from service.dynamics.body import RigidBody
from service.dynamics.formula.limits import MAX_BITS
from service.dynamics.formula.tape import Instruction, Tape
from service.dynamics.verdict.proofs.energy_terms import EnergyTerms
from service.dynamics.verdict.proofs.proof import Signs

MOST_TERMS = 256
"""Of a sum, before equal ones are added."""
HIGHEST = 64
"""Power of g2, or of a sum."""
_NAMED: Mapping[str, Callable[[arb], arb]] = MappingProxyType(
    {"exp": arb.exp, "sin": arb.sin, "cos": arb.cos}
)
"""Smooth functions, whose values at numbers stay as they are; a logarithm or root may be one in disguise."""

Constant = tuple[str, tuple[tuple[int, int, int], ...]]
"""A function of Σ (n/m) g2^k: its name, and the n, m and k. To H, which has no ∂V/∂g2, it is a constant."""


class NotAPowerSumError(Exception):
    """The formula is not, or not plainly, a sum of powers."""


class Term(NamedTuple):
    """coefficient · constants · |g1|^first |g2|^height |g3|^third, and signs of those that are odd."""

    coefficient: fmpq
    first: fmpq
    height: fmpq
    third: fmpq
    odd_first: int
    odd_height: int
    odd_third: int
    constants: tuple[tuple[Constant, int], ...]
    """With their exponents, in order."""


_ZERO, _ONE = fmpq(0), fmpq(1)
PowerSum = list[Term]


@dataclass(frozen=True, slots=True)
class EnergyTerm:
    """coefficient · constants · λ^power, times the signs of g1 and g3 where odd."""

    coefficient: fmpq
    power: fmpq
    odd_first: int
    odd_third: int
    constants: tuple[tuple[Constant, int], ...]


@dataclass(frozen=True, slots=True)
class CurveEnergy:
    """H of an admissible potential."""

    terms: tuple[EnergyTerm, ...]
    is_positive: tuple[bool, bool, bool]
    """Whether V has a value for g1 > 0 only, for g2 > 0, and for g3 > 0."""

    def by_octant(self) -> dict[Signs, EnergyTerms | None]:
        """Return the terms as :func:`.energy_terms` does; None where a constant is no number."""
        found: dict[Signs, EnergyTerms | None] = {}
        for first, second, third in product((1, -1), repeat=3):
            signs = first, second, third
            if all(sign > 0 or not only for sign, only in zip(signs, self.is_positive, strict=True)):
                found[signs] = self._terms(first, third)
        return found

    def _terms(self, first: int, third: int) -> EnergyTerms | None:
        terms: EnergyTerms = {}
        for each in self.terms:
            sign = (first if each.odd_first else 1) * (third if each.odd_third else 1)
            value, key = sign * _fraction(each.coefficient), (_fraction(each.power), "")
            too_large = max(value.numerator.bit_length(), value.denominator.bit_length()) > MAX_BITS
            if each.constants or too_large:
                return None
            terms[key] = terms.get(key, Fraction(0)) + value
        return {key: value for key, value in terms.items() if value}


@dataclass(frozen=True, slots=True)
class Judgement:
    """What is known of L(V) = 0: the energy if it is proved, None if not."""

    energy: CurveEnergy | None
    is_refuted: bool
    """L(V) ≠ 0 somewhere, certainly."""
    terms: PowerSum
    """Those of V."""

    def squared_momentum(self) -> PowerSum:
        """Return the terms of A (A - C)/C · p², which are term · (d - a g3²/g1²) for each term of V."""
        found: PowerSum = []
        for each in self.terms:
            if each.third:
                found.append(each._replace(coefficient=each.coefficient * each.third))
            if each.first:
                coefficient = -each.coefficient * each.first
                found.append(
                    each._replace(coefficient=coefficient, first=each.first - 2, third=each.third + 2)
                )
        return _added(found, (True, True, True))


def judge_power_sum(A: fmpq, C: fmpq, tape: Tape, numbers: Sequence[fmpq] | None = None) -> Judgement:
    """Decide L(V) = 0 for the moments A ≠ C; ``numbers`` take the places of those of the tape, in order.

    Raises
    ------
    NotAPowerSumError
        V is no sum of powers of g1, g2 and g3 without infinities at g2 = 0, as far as it is looked at.
    """
    reader = _Reader()
    terms = reader.read(tape, numbers)
    keeps = not reader.is_positive[0], not reader.is_positive[1], not reader.is_positive[2]
    # What belongs together is often 0 before g2² is replaced.
    left = _added(_energy(A, C, terms), keeps)
    if any(each.height > 1 for each in left):
        left = _added(_reduced(left), keeps)
    if any(
        each.height
        or each.odd_height
        or each.first * A != -each.third * C
        or not _are_numbers(each.constants)
        for each in left
    ):
        # Between functions of numbers, or fractional powers, may be relations that nobody has looked for.
        is_known = not any(each.constants or each.height.q != 1 for each in left)
        return Judgement(None, is_known, terms)
    scale = 2 * (A - C)
    found = tuple(
        EnergyTerm(each.coefficient / scale, each.third, each.odd_first, each.odd_third, each.constants)
        for each in left
    )
    return Judgement(CurveEnergy(found, (not keeps[0], not keeps[1], not keeps[2])), False, terms)


def prove_power_sum(body: RigidBody, tape: Tape) -> CurveEnergy | None:
    """Return the energy of a sum of powers if L(V) = 0 is proved for it, else None."""
    try:
        return judge_power_sum(_exact(body.A), _exact(body.C), tape).energy
    except NotAPowerSumError:
        return None


def _energy(A: fmpq, C: fmpq, terms: PowerSum) -> PowerSum:
    """Return the terms of 2 (A - C) H."""
    found: PowerSum = []
    twice = 2 * (A - C)
    # Terms are made from their parts: a million of them make a sweep.
    for c, a, height, d, *odd, constants in terms:
        one, two, three = odd
        found.append(Term(c * (twice + C * d - A * a), a, height, d, one, two, three, constants))
        if d:
            found.append(Term(c * A * d, a + 2, height, d - 2, one, two, three, constants))
        if a:
            found.append(Term(-c * C * a, a - 2, height, d + 2, one, two, three, constants))
    return found


def _added(terms: PowerSum, keeps: tuple[bool, bool, bool]) -> PowerSum:
    """Return the terms with equal powers added, those that are not 0; signs are kept where both are met."""
    added: dict[tuple[object, ...], Term] = {}
    first_kept, height_kept, third_kept = keeps
    for c, a, height, d, one, two, three, constants in terms:
        one, two, three = one * first_kept, two * height_kept, three * third_kept
        key = a.p, a.q, height.p, height.q, d.p, d.q, one, two, three, constants
        known = added.get(key)
        added[key] = Term(c if known is None else known[0] + c, a, height, d, one, two, three, constants)
    return [each for each in added.values() if each[0]]


def _reduced(terms: PowerSum) -> PowerSum:
    """Return the terms with g2² = 1 - g1² - g3² put in."""
    found: PowerSum = []
    for each in terms:
        half, height = divmod(int(each.height.p), 2)
        if not half or each.height.q != 1:
            found.append(each)
            continue
        for i in range(half + 1):
            for j in range(half + 1 - i):
                factor = comb(half, i) * comb(half - i, j) * (-1) ** (i + j)
                found.append(
                    each._replace(
                        coefficient=each.coefficient * factor,
                        first=each.first + 2 * i,
                        height=fmpq(height),
                        third=each.third + 2 * j,
                    )
                )
    return found


@dataclass(slots=True)
class _Reader:
    """Reads a tape as a sum of powers; equal ones are not added yet."""

    is_positive: list[bool] = field(default_factory=lambda: [False, False, False])
    """g1, g2 and g3, where a root of them is taken."""

    def read(self, tape: Tape, numbers: Sequence[fmpq] | None) -> PowerSum:
        registers: list[PowerSum] = [
            [Term(_ONE, _ONE, _ZERO, _ZERO, 1, 0, 0, ())],
            [Term(_ONE, _ZERO, _ONE, _ZERO, 0, 1, 0, ())],
            [Term(_ONE, _ZERO, _ZERO, _ONE, 0, 0, 1, ())],
        ]
        given = None if numbers is None else iter(numbers)
        for instruction in tape.instructions:
            number = None
            if instruction.number is not None:
                number = _exact(instruction.number) if given is None else next(given)
            found = self._carried_out(instruction, number, registers)
            if len(found) > MOST_TERMS:
                raise NotAPowerSumError
            registers.append(found)
        return registers[tape.result]

    def _carried_out(
        self, instruction: Instruction, number: fmpq | None, registers: list[PowerSum]
    ) -> PowerSum:
        operation, left, right, _, name = instruction
        if number is not None:
            return [_constant(number)] if operation == "constant" else self._power(registers[left], number)
        if operation == "add":
            return registers[left] + registers[right]
        if operation == "subtract":
            return registers[left] + _negated(registers[right])
        if operation == "multiply":
            return _product(registers[left], registers[right])
        if operation == "divide":
            return _product(registers[left], self._power(registers[right], fmpq(-1)))
        if operation == "negate":
            return _negated(registers[left])
        if operation == "call":
            return _called(name, registers[left])
        raise NotAPowerSumError

    def _power(self, base: PowerSum, exponent: fmpq) -> PowerSum:
        is_whole = exponent.q == 1
        if is_whole and 0 <= exponent <= HIGHEST and len(base) > 1:
            found = [_constant(_ONE)]
            for _ in range(int(exponent.p)):
                found = _product(found, base)
                if len(found) > MOST_TERMS:
                    break
            return found
        if len(base) != 1:
            raise NotAPowerSumError
        (only,) = base
        if only.coefficient == 1 and not (
            only.height or only.constants or only.odd_first or only.odd_height or only.odd_third
        ):
            # The usual case: a power of |g1| or |g3|.
            return [Term(_ONE, only.first * exponent, _ZERO, only.third * exponent, 0, 0, 0, ())]
        # What is infinite at g2 = 0, or too high a sum once g2² is replaced, is left to others.
        if only.height and not 0 <= only.height * exponent <= HIGHEST:
            raise NotAPowerSumError
        signs = only.odd_first, only.odd_height, only.odd_third
        odd = int(exponent.p) % 2 if is_whole else 0
        if is_whole and abs(exponent) <= HIGHEST and only.coefficient:
            n = int(exponent.p)
            coefficient = only.coefficient**n
            constants = tuple((constant, power * n) for constant, power in only.constants if n)
        else:
            if only.coefficient != 1 or only.constants or (not is_whole and sum(signs) > 1):
                raise NotAPowerSumError
            coefficient, constants = _ONE, ()
        if not is_whole:
            for place, sign in enumerate(signs):
                self.is_positive[place] |= bool(sign)
        first, height, third = (each * exponent for each in (only.first, only.height, only.third))
        one, two, three = (sign * odd for sign in signs)
        return [Term(coefficient, first, height, third, one, two, three, constants)]


def _called(name: str, argument: PowerSum) -> PowerSum:
    if name == "abs" and len(argument) == 1:
        c, first, height, third, *_, constants = argument[0]
        if height or constants:
            raise NotAPowerSumError
        return [Term(abs(c), first, height, third, 0, 0, 0, constants)]
    if any(each.constants for each in argument):
        raise NotAPowerSumError
    if name in _NAMED and all(not each.first and not each.third and each.height.q == 1 for each in argument):
        heights = _added(argument, (True, True, True))
        key = tuple((*_ratio(each.coefficient), int(each.height.p)) for each in heights)
        return [Term(_ONE, _ZERO, _ZERO, _ZERO, 0, 0, 0, (((name, tuple(sorted(key))), 1),))]
    raise NotAPowerSumError


def _are_numbers(constants: tuple[tuple[Constant, int], ...]) -> bool:
    """Tell whether no g2 is in them."""
    return not constants or not any(height for (_, argument), _ in constants for *_, height in argument)


def number_of(constants: tuple[tuple[Constant, int], ...]) -> arb:
    """Return the product of functions of numbers, at the current precision."""
    found = arb(1)
    for (name, argument), power in constants:
        value = sum((arb(fmpq(numerator, denominator)) for numerator, denominator, _ in argument), arb(0))
        found *= _NAMED[name](value) ** power
    return found


def _constant(number: fmpq) -> Term:
    return Term(number, _ZERO, _ZERO, _ZERO, 0, 0, 0, ())


def _negated(terms: PowerSum) -> PowerSum:
    return [each._replace(coefficient=-each.coefficient) for each in terms]


def _product(left: PowerSum, right: PowerSum) -> PowerSum:
    if len(left) * len(right) > MOST_TERMS:
        raise NotAPowerSumError
    return [
        Term(c * e, a + f, b + h, d + k, i ^ m, j ^ n, o ^ q, _together(r, t) if r or t else r)
        for c, a, b, d, i, j, o, r in left
        for e, f, h, k, m, n, q, t in right
    ]


def _together(
    left: tuple[tuple[Constant, int], ...], right: tuple[tuple[Constant, int], ...]
) -> tuple[tuple[Constant, int], ...]:
    if not left or not right:
        return left or right
    powers = dict(left)
    for constant, power in right:
        powers[constant] = powers.get(constant, 0) + power
    return tuple(sorted((constant, power) for constant, power in powers.items() if power))


def _ratio(value: fmpq) -> tuple[int, int]:
    return int(value.p), int(value.q)


def _fraction(value: fmpq) -> Fraction:
    return Fraction(int(value.p), int(value.q))


def _exact(value: Fraction) -> fmpq:
    return fmpq(value.numerator, value.denominator)
