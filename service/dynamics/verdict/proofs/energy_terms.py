"""Finds the energy as a sum of powers of λ in each octant, from the H of a proof.

H is constant on the curves, so once it is cancelled down it is a sum of terms
c g1^a g3^b with a A + b C = 0, without g2 and rho. On |g3| = λ |g1|^(C/A) the
absolute value of such a term is |c| λ^b.
"""

from collections.abc import Iterable
from fractions import Fraction
from itertools import product

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.monomials import as_fraction
from service.dynamics.formula.limits import MAX_BITS
from service.dynamics.verdict.exact_ring.generators import (
    CircleConstant,
    Coordinate,
    Cosine,
    CosineOfTurn,
    Divisor,
    Element,
    Exponential,
    Logarithm,
    Root,
    Sine,
)
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.proofs.proof import EnergyInOctant, Proof, Signs

EnergyTerms = dict[tuple[Fraction, str], Fraction]
"""Coefficients c of the terms c · constant · λ^b, by (b, constant as text, empty for 1)."""


def energy_terms(body: RigidBody, proof: Proof) -> dict[Signs, EnergyTerms | None]:
    """Return the terms in each octant where V can have a value; None where H is not a sum of such terms."""
    found: dict[Signs, EnergyTerms | None] = {}
    octants = {energy.signs: energy for energy in proof.octants}
    for signs in product((1, -1), repeat=3):
        computed = tuple(s if i in proof.sign_dependent else 1 for i, s in enumerate(signs))
        energy = octants.get((computed[0], computed[1], computed[2]))
        if energy is not None:
            flipped = {i for i in range(3) if signs[i] != computed[i]}
            found[signs[0], signs[1], signs[2]] = _terms(body, energy, flipped)
    return found


def _terms(body: RigidBody, energy: EnergyInOctant, flipped: set[int]) -> EnergyTerms | None:
    """Return the terms of H, where the signs of the coordinates ``flipped`` are opposite to the ring's."""
    ring, terms = energy.ring, EnergyTerms()
    for monomial, coefficient in energy.H.numerator.terms():
        value, weight, power, constants = as_fraction(coefficient), Fraction(0), Fraction(0), []
        for index, (low, shift) in enumerate(zip(monomial, energy.H.shift, strict=True)):
            exponent = int(low) + shift
            if exponent == 0:
                continue
            nature = ring.natures[index]
            if isinstance(nature, Coordinate) and nature.position != 1:
                # An element whose sign does not matter to the ring has degree 1.
                value *= -1 if exponent % 2 and nature.position in flipped else 1
                moment = body.A if nature.position == 0 else body.C
                weight += moment * Fraction(exponent, nature.degree)
                power += Fraction(exponent, nature.degree) if nature.position == 2 else 0
            else:
                text = _constant_text(ring, index, exponent)
                if text is None:
                    return None
                constants.append(text)
        if weight != 0 or max(value.numerator.bit_length(), value.denominator.bit_length()) > MAX_BITS:
            return None
        key = (power, "*".join(constants))
        terms[key] = terms.get(key, Fraction(0)) + value
    return {key: value for key, value in terms.items() if value}


def _number_text(ring: Ring, element: Element) -> str | None:
    """Return an element without coordinates as text, None if it has some."""
    parts = []
    for monomial, coefficient in element.numerator.terms():
        constants = []
        for index, (low, shift) in enumerate(zip(monomial, element.shift, strict=True)):
            if int(low) + shift:
                text = _constant_text(ring, index, int(low) + shift)
                if text is None:
                    return None
                constants.append(text)
        parts.append(term_text(as_fraction(coefficient), *constants))
    return sum_text(parts)


def _constant_text(ring: Ring, index: int, exponent: int) -> str | None:
    """Return a power of a generator that is a number as text, None if it is not one."""
    match ring.natures[index]:
        case CircleConstant(degree):
            return power_text("pi", Fraction(exponent, degree))
        case CosineOfTurn(order):
            return power_text(f"(2*cos({Fraction(2, order)}*pi))", Fraction(exponent))
        case Exponential(argument, degree):
            text = _number_text(ring, argument)
            return None if text is None else f"exp({term_text(Fraction(exponent, degree), f'({text})')})"
        case Root(base, degree):
            text = str(base.numerator) if base.is_number else _in_brackets(_number_text(ring, base))
            return None if text is None else power_text(text, Fraction(exponent, degree))
        case Divisor(base):
            text = _in_brackets(_number_text(ring, base))
        case Logarithm(argument):
            text = _in_brackets(_number_text(ring, argument), "log")
        case Sine(argument):
            text = _in_brackets(_number_text(ring, argument), "sin")
        case Cosine(argument):
            text = _in_brackets(_number_text(ring, argument), "cos")
        case Coordinate():
            return None
    return None if text is None else power_text(text, Fraction(exponent))


def _in_brackets(text: str | None, function: str = "") -> str | None:
    return None if text is None else f"{function}({text})"


def power_text(base: str, exponent: Fraction) -> str:
    """Return base^exponent as text, empty for the exponent 0."""
    if exponent == 0:
        return ""
    return base if exponent == 1 else f"{base}^({exponent})"


def term_text(coefficient: Fraction, *factors: str) -> str:
    """Return coefficient · factors as text; empty factors are 1."""
    text = "*".join(factor for factor in factors if factor)
    if not text:
        return str(coefficient)
    if abs(coefficient) == 1:
        return text if coefficient > 0 else f"-{text}"
    return f"{coefficient}*{text}"


def sum_text(parts: Iterable[str]) -> str:
    """Return the parts joined, their leading signs made operators; 0 if there are none."""
    text = " + ".join(parts).replace("+ -", "- ")
    return text or "0"
