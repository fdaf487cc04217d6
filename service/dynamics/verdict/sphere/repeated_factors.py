"""Factors polynomials in g1, g2, g3 inside a formula over the rationals, on the sphere."""

from dataclasses import dataclass
from fractions import Fraction

from flint import fmpq, fmpq_mpoly

from service.dynamics.formula.register_polynomials import RegisterPolynomials
from service.dynamics.formula.rewriting import TapeBuilder
from service.dynamics.formula.tape import Instruction

_ORDER = (1, 0, 2)


@dataclass(frozen=True, slots=True)
class Factor:
    """An irreducible factor, as a register, and its multiplicity."""

    register: int
    power: int


@dataclass(frozen=True, slots=True)
class Split:
    """constant · Π factor^power."""

    constant: Fraction
    factors: tuple[Factor, ...]


class Polynomials:
    """The registers that are small polynomials."""

    def __init__(self, builder: TapeBuilder) -> None:
        self._builder = builder
        self._polynomials = RegisterPolynomials(builder, _ORDER)
        self._registers: dict[str, tuple[int, Fraction]] = {}
        """For each irreducible factor met, by its text: a register, and the ratio of that to the factor."""

    def factors(self, register: int) -> Split | None:
        """Return the factors of a register, None if it is no small polynomial or a number.

        A polynomial is taken as it stands, and with g2² = 1 - g1² - g3² if no factor shows so.
        """
        polynomial = self._polynomials.of(register)
        if polynomial is None or polynomial.is_constant():
            return None
        reduced = self._polynomials.on_sphere(polynomial)
        if reduced.is_constant():
            return None
        constant, found = polynomial.factor()
        if len(found) == 1 and found[0][1] == 1:
            constant, found = reduced.factor()
        total, factors = _fraction(constant), list[Factor]()
        for factor, multiplicity in found:
            leading = factor.leading_coefficient()
            monic, power = factor / leading, int(multiplicity)
            total *= _fraction(leading) ** power
            place, scale = self._register_of(
                monic, register if len(found) == 1 and power == 1 else None, total
            )
            total /= scale**power
            factors.append(Factor(place, power))
        return Split(total, tuple(factors))

    def _register_of(self, monic: fmpq_mpoly, own: int | None, constant: Fraction) -> tuple[int, Fraction]:
        """Return a register for a factor, and what it is times the factor; ``own`` is constant · factor."""
        key = str(self._polynomials.on_sphere(monic))
        if key not in self._registers:
            if own is not None:
                self._registers[key] = own, constant
            else:
                self._registers[key] = self._written(monic), Fraction(1)
        return self._registers[key]

    def _written(self, polynomial: fmpq_mpoly) -> int:
        builder, total = self._builder, -1
        for exponents, coefficient in polynomial.terms():
            term = builder.constant(_fraction(coefficient))
            for variable, exponent in zip(_ORDER, exponents, strict=True):
                if exponent:
                    term = builder.multiply(term, builder.power(variable, Fraction(int(exponent))))
            total = term if total < 0 else builder.emit(Instruction("add", total, term))
        return total


def _fraction(value: fmpq) -> Fraction:
    return Fraction(int(value.p), int(value.q))
