"""The energy as a formula: h(λ), or h(nu) for A = 2C, read off the H of a proof.

H is constant on the curves, so once it is cancelled down it is a sum of terms
c g1^a g3^b with a A + b C = 0, without g2 and rho. On |g3| = λ |g1|^(C/A) the
absolute value of such a term is |c| λ^b, and λ² = |nu|.
"""

from collections.abc import Iterable
from fractions import Fraction
from itertools import product

from flint import ctx

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.errors import FormulaError
from service.dynamics.formula.limits import MAX_BITS
from service.dynamics.formula.parser import parse
from service.dynamics.formula.printer import format_tree
from service.dynamics.formula.tape import Tape, compile_tape
from service.dynamics.potentials.potential import Potential
from service.dynamics.verdict.factors import as_fraction
from service.dynamics.verdict.natures import CircleConstant, Coordinate, Logarithm, Nature, Root
from service.dynamics.verdict.points import sphere_points
from service.dynamics.verdict.proof import EnergyInOctant, Proof, Signs

_CHECK_BITS = 128
_CHECK_POINTS = 16

_Terms = dict[tuple[Fraction, str], Fraction]
"""Coefficients c of the terms c · constant · λ^b, by (b, constant as text)."""


def energy_formula(body: RigidBody, potential: Potential, proof: Proof) -> str | None:
    """Return h as a formula in ``lambda``, in ``nu`` if A = 2C, or None if it has none.

    The formula holds on every curve on which V is defined, whatever the signs
    of g1 and g3; an energy that depends on those signs otherwise than through
    nu has no formula. What is returned agrees with H in balls at sample points.
    """
    has_nu = body.A == 2 * body.C
    by_sign: dict[int, _Terms] = {}
    for signs, terms in _terms_by_octant(body, proof).items():
        sign = signs[0] if has_nu else 1
        if terms is None or by_sign.setdefault(sign, terms) != terms:
            return None
    text = _text_in_nu(by_sign) if has_nu else _text_in_lambda(by_sign[1])
    try:
        tree = parse(text)
        tape = compile_tape(tree, ("nu" if has_nu else "lambda",))
    except FormulaError:
        return None  # its numbers are beyond the limits of formulas
    return format_tree(tree) if _is_confirmed(body, potential, tape, in_nu=has_nu) else None


def _terms_by_octant(body: RigidBody, proof: Proof) -> dict[Signs, _Terms | None]:
    """Return the terms in each octant where V is defined; None where H is not a sum of such terms."""
    found: dict[Signs, _Terms | None] = {}
    octants = {energy.signs: energy for energy in proof.octants}
    for signs in product((1, -1), repeat=3):
        computed = tuple(s if i in proof.sign_dependent else 1 for i, s in enumerate(signs))
        energy = octants.get((computed[0], computed[1], computed[2]))
        if energy is not None:
            flipped = {i for i in range(3) if signs[i] != computed[i]}
            found[signs[0], signs[1], signs[2]] = _terms(body, energy, flipped)
    return found


def _terms(body: RigidBody, energy: EnergyInOctant, flipped: set[int]) -> _Terms | None:
    """Return the terms of H, where the signs of the coordinates ``flipped`` are opposite to the ring's."""
    ring, terms = energy.ring, _Terms()
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
                text = _constant_text(nature, exponent)
                if text is None:
                    return None
                constants.append(text)
        if weight != 0 or max(value.numerator.bit_length(), value.denominator.bit_length()) > MAX_BITS:
            return None
        key = (power, "*".join(constants))
        terms[key] = terms.get(key, Fraction(0)) + value
    return {key: value for key, value in terms.items() if value}


def _constant_text(nature: Nature, exponent: int) -> str | None:
    """Return a power of a generator that is a number as text, None if it is not one."""
    match nature:
        case CircleConstant(degree):
            return _power("pi", Fraction(exponent, degree))
        case Root(base, degree) if base.is_number:
            return _power(str(base.numerator), Fraction(exponent, degree))
        case Logarithm(argument) if argument.is_number:
            return _power(f"log({argument.numerator})", Fraction(exponent))
    return None


def _text_in_nu(by_sign: dict[int, _Terms]) -> str:
    """Return the sum in nu, whose sign is that of g1; the terms are in λ = |nu|^(1/2)."""
    parts: list[str] = []
    plus, minus = by_sign.get(1), by_sign.get(-1)
    for key in dict.fromkeys((*(plus or {}), *(minus or {}))):
        k = key[0] / 2
        # Where V is defined for one sign of g1 only, a whole power of nu is the simplest continuation.
        mirror = -1 if _has_parity(k, 1) else 1
        above = minus[key] * mirror if minus and plus is None else (plus or {}).get(key, Fraction(0))
        below = plus[key] * mirror if plus and minus is None else (minus or {}).get(key, Fraction(0))
        if above + below:
            base = "nu" if _has_parity(k, 0) else "abs(nu)"
            parts.append(_scaled((above + below) / 2, key, _power(base, k)))
        if above - below:
            signed = _power("nu", k) if _has_parity(k, 1) else f"nu*{_power('abs(nu)', k - 1)}"
            parts.append(_scaled((above - below) / 2, key, signed))
    return _sum(parts)


def _text_in_lambda(terms: _Terms) -> str:
    return _sum(_scaled(value, key, _power("lambda", key[0])) for key, value in terms.items())


def _has_parity(k: Fraction, parity: int) -> bool:
    return k.denominator == 1 and k.numerator % 2 == parity


def _power(base: str, exponent: Fraction) -> str:
    """Return base^exponent as text, empty for the exponent 0."""
    if exponent == 0:
        return ""
    return base if exponent == 1 else f"{base}^({exponent})"


def _scaled(coefficient: Fraction, key: tuple[Fraction, str], power: str) -> str:
    factors = "*".join(part for part in (key[1], power) if part)
    if not factors:
        return str(coefficient)
    if abs(coefficient) == 1:
        return factors if coefficient > 0 else f"-{factors}"
    return f"{coefficient}*{factors}"


def _sum(parts: Iterable[str]) -> str:
    """Return the parts joined, their leading signs made operators."""
    text = " + ".join(parts).replace("+ -", "- ")
    return text or "0"


def _is_confirmed(body: RigidBody, potential: Potential, formula: Tape, *, in_nu: bool) -> bool:
    """Whether the formula's balls meet those of H at all sample points where V is defined, at least one."""
    balls = BallAlgebra()
    confirmed = 0
    with ctx.workprec(_CHECK_BITS):
        for point in sphere_points():
            if confirmed == _CHECK_POINTS:
                break
            g1, g2, g3 = (balls.constant(coordinate) for coordinate in point)
            H = potential.H_ball(body, g1, g2, g3)
            if not H.is_finite():
                continue
            curve = g3 * g3 / g1 if in_nu else abs(g3) / balls.power(abs(g1), body.C / body.A)
            h = formula.evaluate(balls, (curve,))
            if not (h.is_finite() and h.overlaps(H)):
                return False
            confirmed += 1
    return confirmed > 0
