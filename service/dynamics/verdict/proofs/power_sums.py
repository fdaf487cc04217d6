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
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from types import MappingProxyType
from typing import NamedTuple

from flint import arb, fmpq

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.monomials import (
    SPHERE,
    Atom,
    Monomial,
    MonomialSum,
    NotAMonomialSumError,
    Powers,
    ReadSum,
    Rules,
    added_up,
    as_fmpq,
    as_fraction,
    ratio_of,
    read,
    reduced,
    without_zeros,
)
from service.dynamics.formula.tape import Tape
from service.dynamics.formula.tree import MAX_BITS
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.verdict.proofs.energy_terms import EnergyTerms
from service.dynamics.verdict.proofs.proof import Signs

_NAMED: Mapping[str, Callable[[arb], arb]] = MappingProxyType(
    {"exp": arb.exp, "sin": arb.sin, "cos": arb.cos}
)
"""Smooth functions, whose values at numbers stay as they are; a logarithm or root may be one in disguise."""
MAX_POWER = 64
"""Power of g2, which is replaced on the sphere."""
_RULES = Rules(
    atoms=frozenset(_NAMED),
    nests=False,
    most_terms=256,
    most_products=256,
    most_bits=2**20,
    checks_bits=False,
)

Constants = tuple[tuple[Atom, int], ...]
"""Functions of g2 or of nothing with their exponents: to H, which has no ∂V/∂g2, they are constants."""
Term = tuple[fmpq, fmpq, fmpq, fmpq, int, int, int, Constants]
"""The coefficient c and exponents a, b, d of c · constants · |g1|^a |g2|^b |g3|^d; 1 or 0 for each of g1, g2
and g3: whether it is odd there; and the constants."""


class EnergyTerm(NamedTuple):
    """coefficient · constants · λ^power, times the signs of g1 and g3 where odd."""

    coefficient: fmpq
    power: fmpq
    odd_first: int
    odd_third: int
    constants: Constants


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
        terms = list[tuple[tuple[Fraction, str], Fraction]]()
        for each in self.terms:
            sign = (first if each.odd_first else 1) * (third if each.odd_third else 1)
            value, key = sign * as_fraction(each.coefficient), (as_fraction(each.power), "")
            too_large = max(value.numerator.bit_length(), value.denominator.bit_length()) > MAX_BITS
            if each.constants or too_large:
                return None
            terms.append((key, value))
        return without_zeros(added_up(terms))


@dataclass(frozen=True, slots=True)
class Judgement:
    """The result about L(V) = 0: the energy if it is proved, None if not."""

    energy: CurveEnergy | None
    is_refuted: bool
    """L(V) ≠ 0 somewhere, certainly."""
    sums: ReadSum
    """The terms of V."""

    def squared_momentum(self) -> list[Term]:
        """Return the terms of A (A - C)/C · p², which are term · (d - a g3²/g1²) for each term of V."""
        sums, unit = self.sums, self.sums.unit
        parts = [
            part
            for (a, b, d, signs, atoms), c in sums.terms.items()
            for part in (
                ((a, b, d, signs, atoms), c * d),
                ((a - 2 * unit, b, d + 2 * unit, signs, atoms), -c * a),
            )
        ]
        return [
            (
                c / unit,
                fmpq(a, unit),
                fmpq(b, unit),
                fmpq(d, unit),
                signs & 1,
                signs >> 1 & 1,
                signs >> 2,
                _constants(sums, atoms),
            )
            for (a, b, d, signs, atoms), c in without_zeros(added_up(parts)).items()
        ]


def judge_power_sum(A: fmpq, C: fmpq, tape: Tape, numbers: Sequence[fmpq] | None = None) -> Judgement:
    """Decide L(V) = 0 for the moments A ≠ C; ``numbers`` take the places of those of the tape, in order.

    Raises
    ------
    NotAMonomialSumError
        V is no sum of powers of g1, g2 and g3 without infinities at g2 = 0, as far as it is looked at.
    """
    sums = read(tape, _RULES, numbers)
    unit = sums.unit
    if any(not 0 <= height <= MAX_POWER * unit for _, height, *_ in sums.terms):
        raise NotAMonomialSumError
    # What belongs together is often 0 before g2² is replaced.
    (a_top, a_bottom), (c_top, c_bottom) = ratio_of(A), ratio_of(C)
    first, third = a_top * c_bottom, c_top * a_bottom
    left = _energy(first, third, sums)
    if any(height > unit for _, height, *_ in left):
        left = reduced(left, SPHERE[1], unit)
    for a, height, d, signs, atoms in left:
        if height or signs & 2 or a * first + d * third or (atoms and have_g2(_constants(sums, atoms))):
            # Between functions of numbers, or fractional powers, may be relations that nobody has looked for.
            is_known = not any(each[-1] or each[1] % unit for each in left)
            return Judgement(None, is_known, sums)
    scale = 2 * (first - third) * unit
    found = tuple(
        EnergyTerm(c / scale, fmpq(d, unit), signs & 1, signs >> 2, _constants(sums, atoms))
        for (_, _, d, signs, atoms), c in left.items()
    )
    positive = bool(sums.positive & 1), bool(sums.positive & 2), bool(sums.positive & 4)
    return Judgement(CurveEnergy(found, positive), False, sums)


def prove_power_sum(body: RigidBody, tape: Tape) -> CurveEnergy | None:
    """Return the energy of a sum of powers if L(V) = 0 is proved for it, else None."""
    try:
        return judge_power_sum(as_fmpq(body.A), as_fmpq(body.C), tape).energy
    except NotAMonomialSumError:
        return None


def is_power_sum(body: RigidBody, potential: Potential) -> bool:
    """Tell whether a potential has a formula, and :func:`judge_power_sum` can decide about it."""
    try:
        judge_power_sum(as_fmpq(body.A), as_fmpq(body.C), potential.tape)
    except (NoClosedFormError, NotAMonomialSumError):
        return False
    return True


def _energy(A: int, C: int, sums: ReadSum) -> MonomialSum:
    """Return the terms of 2 (A - C) H, times the unit, without the signs of what is positive.

    Moments are in parts of each other, as integers.
    """
    found: MonomialSum = {}
    unit, kept = sums.unit, ~sums.positive
    twice, whole = 2 * unit, 2 * unit * (A - C)

    def count(key: Monomial, value: fmpq) -> None:
        known = found.get(key)
        found[key] = value if known is None else known + value

    for (a, b, d, all_signs, atoms), c in sums.terms.items():
        factor, signs = whole, all_signs & kept
        if d:
            factor = factor + C * d
            count((a + twice, b, d - twice, signs, atoms), c * (A * d))
        if a:
            factor = factor - A * a
            count((a - twice, b, d + twice, signs, atoms), -c * (C * a))
        count((a, b, d, signs, atoms), c * factor)
    return without_zeros(found)


def have_g2(constants: Constants) -> bool:
    """Tell whether g2 is in one of the functions."""
    return any(height for atom, _ in constants for (_, height, *_), *_ in atom.arguments[0])


def _constants(sums: ReadSum, atoms: Powers) -> Constants:
    return tuple((sums.atoms[number], exponent // sums.unit) for number, exponent in atoms) if atoms else ()


def number_of(constants: Constants) -> arb:
    """Return the product of functions of numbers, at the current precision."""
    found = arb(1)
    for atom, power in constants:
        value = sum((arb(fmpq(p, q)) for _, p, q in atom.arguments[0]), arb(0))
        found *= _NAMED[atom.name](value) ** power
    return found
