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

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from math import comb
from typing import NamedTuple

from flint import fmpq

from service.dynamics.body import RigidBody
from service.dynamics.formula.limits import MAX_BITS
from service.dynamics.formula.tape import Tape
from service.dynamics.verdict.proofs.energy_terms import EnergyTerms
from service.dynamics.verdict.proofs.proof import Signs
from service.dynamics.verdict.proofs.reading_powers import (
    ZERO,
    Constants,
    NotAPowerSumError,
    PowerReader,
    PowerSum,
    added,
    exact,
)


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
    """The result about L(V) = 0: the energy if it is proved, None if not."""

    energy: CurveEnergy | None
    is_refuted: bool
    """L(V) ≠ 0 somewhere, certainly."""
    terms: PowerSum
    """The terms of V."""

    def squared_momentum(self) -> PowerSum:
        """Return the terms of A (A - C)/C · p², which are term · (d - a g3²/g1²) for each term of V."""
        found: PowerSum = []
        for c, a, height, d, *odd, constants in self.terms:
            one, two, three = odd
            if d:
                found.append((c * d, a, height, d, one, two, three, constants))
            if a:
                found.append((-c * a, a - 2, height, d + 2, one, two, three, constants))
        return added(found, (True, True, True))


def judge_power_sum(A: fmpq, C: fmpq, tape: Tape, numbers: Sequence[fmpq] | None = None) -> Judgement:
    """Decide L(V) = 0 for the moments A ≠ C; ``numbers`` take the places of those of the tape, in order.

    Raises
    ------
    NotAPowerSumError
        V is no sum of powers of g1, g2 and g3 without infinities at g2 = 0, as far as it is looked at.
    """
    reader = PowerReader()
    terms = reader.read(tape, numbers)
    first, second, third = reader.is_positive
    is_positive, keeps = (first, second, third), (not first, not second, not third)
    # What belongs together is often 0 before g2² is replaced.
    left = added(_energy(A, C, terms), keeps)
    if any(each[2] is not ZERO and each[2] > 1 for each in left):
        left = added(_reduced(left), keeps)
    for _, a, height, d, _, odd_height, _, constants in left:
        if height or odd_height or a * A + d * C or not _are_numbers(constants):
            # Between functions of numbers, or fractional powers, may be relations that nobody has looked for.
            is_known = not any(each[-1] or each[2].q != 1 for each in left)
            return Judgement(None, is_known, terms)
    scale = 2 * (A - C)
    found = tuple(
        EnergyTerm(c / scale, d, one, three, constants) for c, _, _, d, one, _, three, constants in left
    )
    return Judgement(CurveEnergy(found, is_positive), False, terms)


def prove_power_sum(body: RigidBody, tape: Tape) -> CurveEnergy | None:
    """Return the energy of a sum of powers if L(V) = 0 is proved for it, else None."""
    try:
        return judge_power_sum(exact(body.A), exact(body.C), tape).energy
    except NotAPowerSumError:
        return None


def _energy(A: fmpq, C: fmpq, terms: PowerSum) -> PowerSum:
    """Return the terms of 2 (A - C) H."""
    found: PowerSum = []
    twice = 2 * (A - C)
    for c, a, height, d, one, two, three, constants in terms:
        factor = twice
        if d:
            factor = factor + C * d
            found.append((c * (A * d), a + 2, height, d - 2, one, two, three, constants))
        if a:
            factor = factor - A * a
            found.append((-c * (C * a), a - 2, height, d + 2, one, two, three, constants))
        found.append((c * factor, a, height, d, one, two, three, constants))
    return found


def _reduced(terms: PowerSum) -> PowerSum:
    """Return the terms with g2² = 1 - g1² - g3² put in."""
    found: PowerSum = []
    for each in terms:
        c, a, b, d, *odd, constants = each
        one, two, three = odd
        half, height = divmod(int(b.p), 2)
        if not half or b.q != 1:
            found.append(each)
            continue
        for i in range(half + 1):
            for j in range(half + 1 - i):
                factor = comb(half, i) * comb(half - i, j) * (-1) ** (i + j)
                left = fmpq(height) if height else ZERO
                found.append((c * factor, a + 2 * i, left, d + 2 * j, one, two, three, constants))
    return found


def _are_numbers(constants: Constants) -> bool:
    """Tell whether no g2 is in them."""
    return not constants or not any(height for (_, argument), _ in constants for *_, height in argument)


def _fraction(value: fmpq) -> Fraction:
    return Fraction(int(value.p), int(value.q))
