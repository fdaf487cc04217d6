"""Writes the energy as a formula h(λ), or h(nu) with λ² = |nu| for A = 2C, from its terms in octants."""

from collections.abc import Mapping
from fractions import Fraction
from types import MappingProxyType

from flint import ctx

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.errors import FormulaError
from service.dynamics.formula.parameters import bind
from service.dynamics.formula.parser import parse
from service.dynamics.formula.printer import format_tree
from service.dynamics.formula.tape import Tape, compile_tape
from service.dynamics.potentials.families.general_solution import SIGNS, Quadrant
from service.dynamics.potentials.potential import Potential
from service.dynamics.verdict.proofs.energy_terms import (
    EnergyTerms,
    power_text,
    sum_text,
    term_text,
)
from service.dynamics.verdict.proofs.proof import Signs
from service.dynamics.verdict.sphere.points import sphere_points

_CHECK_BITS = 128
_CHECK_POINTS = 16

OctantTerms = Mapping[Signs, EnergyTerms | None]
"""The terms of the energy by the signs of g1, g2, g3; None where it is no sum of such terms."""
NO_NAMES: Mapping[str, Fraction] = MappingProxyType({})


def formula_of(
    body: RigidBody, potential: Potential, octants: OctantTerms, names: Mapping[str, Fraction] = NO_NAMES
) -> str | None:
    """Return h as a formula in ``lambda``, in ``nu`` if A = 2C, or None if it has none.

    It is found from the terms of the energy in every octant, whose constants may hold ``names``, and holds
    on every curve on which V is defined, whatever the signs of g1 and g3; an energy that depends on those
    signs otherwise than through nu has no formula. What is returned agrees with H in balls at sample points.
    """
    has_nu = body.A == 2 * body.C
    by_sign: dict[int, EnergyTerms] = {}
    for signs, terms in octants.items():
        sign = signs[0] if has_nu else 1
        if terms is None or by_sign.setdefault(sign, terms) != terms:
            return None
    return _confirmed(body, potential, _text(body, by_sign), names) if by_sign else None


def signed_formulas_of(
    body: RigidBody, potential: Potential, octants: OctantTerms, names: Mapping[str, Fraction] = NO_NAMES
) -> dict[Quadrant, str] | None:
    """Return h on each quadrant where V is defined, as :func:`formula_of` does for all of them.

    None if a quadrant has no formula, or none has V.
    """
    texts: dict[Quadrant, str] = {}
    for quadrant, (first, third) in SIGNS.items():
        found = [octants[signs] for s in (1, -1) if (signs := (first, s, third)) in octants]
        if not found:
            continue
        terms = found[0]
        if terms is None or terms != found[-1]:
            return None
        text = _text(body, {first if body.A == 2 * body.C else 1: terms})
        confirmed = _confirmed(body, potential, text, names, (first, third))
        if confirmed is None:
            return None
        texts[quadrant] = confirmed
    return texts or None


def _text(body: RigidBody, by_sign: dict[int, EnergyTerms]) -> str:
    return _text_in_nu(by_sign) if body.A == 2 * body.C else _text_in_lambda(by_sign[1])


def _confirmed(
    body: RigidBody,
    potential: Potential,
    text: str,
    names: Mapping[str, Fraction],
    quadrant: tuple[int, int] | None = None,
) -> str | None:
    """Return the formula as printed, or None if it exceeds the limits or disagrees with balls of H."""
    curve = ("nu" if body.A == 2 * body.C else "lambda",)
    try:
        tree = parse(text)
        tape = compile_tape(bind(tree, names, variables=curve), curve)
    except FormulaError:
        return None
    return format_tree(tree) if _agrees(body, potential, tape, quadrant) else None


def _text_in_nu(by_sign: dict[int, EnergyTerms]) -> str:
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
            parts.append(term_text((above + below) / 2, key[1], power_text(base, k)))
        if above - below:
            signed = power_text("nu", k) if _has_parity(k, 1) else f"nu*{power_text('abs(nu)', k - 1)}"
            parts.append(term_text((above - below) / 2, key[1], signed))
    return sum_text(parts)


def _text_in_lambda(terms: EnergyTerms) -> str:
    return sum_text(term_text(value, key[1], power_text("lambda", key[0])) for key, value in terms.items())


def _has_parity(k: Fraction, parity: int) -> bool:
    return k.denominator == 1 and k.numerator % 2 == parity


def _agrees(body: RigidBody, potential: Potential, formula: Tape, quadrant: tuple[int, int] | None) -> bool:
    """Tell whether the formula's balls meet those of H at the sample points where V is defined, at least one.

    Only points of the ``quadrant``, signs of g1 and g3, are taken if one is given.
    """
    in_nu = body.A == 2 * body.C
    balls = BallAlgebra()
    confirmed = 0
    with ctx.workprec(_CHECK_BITS):
        for point in sphere_points():
            if confirmed == _CHECK_POINTS:
                break
            if quadrant is not None and (point[0] * quadrant[0] < 0 or point[2] * quadrant[1] < 0):
                continue
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
