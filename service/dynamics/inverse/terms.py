"""Reads the coefficients of the known terms of a potential from its energy.

Powers of λ in H belong to the B_n, C_n and logarithmic terms, each with its own
power; what is left beside them is a constant and Q times a function of g2.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.monomials import added_up, scaled_terms
from service.dynamics.inverse.monomial_sums import GENERATORS, Expansion, MonomialSum, Powers, unit
from service.dynamics.inverse.section import section
from service.dynamics.potentials.families.homogeneous import B_term, C_term, energy_of_B, energy_of_C
from service.dynamics.potentials.terms.logarithmic import energy_of_log, log_term, multiplicity
from service.dynamics.potentials.terms.powers import MAX_TERMS, PowerSum
from service.dynamics.verdict.proofs.energy_terms import EnergyTerms

_ZERO = Fraction(0)
_G1, _G3, _RHO, _LOG_G1, _LOG_G3, _LOG_RHO = (unit(position) for position in (0, 2, 3, 4, 5, 6))


@dataclass(frozen=True, slots=True)
class Terms:
    """V = constant + Q Σ A_n g2^n + Σ B_n-terms + Σ C_n-terms + Σ log_n-terms, in one quadrant.

    The terms are those of :mod:`service.dynamics.potentials.families.homogeneous`,
    functions of |g1| and |g3|; the lists begin with n = 0.
    """

    constant: Fraction
    A: tuple[Fraction, ...]
    B: tuple[Fraction, ...]
    C: tuple[Fraction, ...]
    log: tuple[Fraction, ...]


def read_terms(body: RigidBody, expansion: Expansion | None, energy: EnergyTerms | None) -> Terms | None:
    """Return the terms of a potential expanded in a quadrant, with its energy; None if it has others."""
    if expansion is None or energy is None:
        return None
    weights: dict[str, dict[int, Fraction]] = {"B": {}, "C": {}, "log": {}}
    taken: list[tuple[Powers, Fraction]] = []
    constant = _ZERO
    for (power, factor), value in energy.items():
        if factor:
            return None
        if power == 0:
            constant = value
            taken.append(((_ZERO,) * GENERATORS, -value))
            continue
        index = _index(body.alpha, power)
        if index is None:
            return None
        name, n = index
        weight, monomials = value / _energy(body.alpha, name, n), _monomials(body.alpha, name, n)
        weights[name][n] = weight
        taken.extend(scaled_terms(monomials, -weight))
    # H of the rest is zero: it is Q G(g2), and its values on one section are enough.
    rest = added_up(chain(expansion.terms.items(), taken))
    G = section(body, Expansion(rest, expansion.atoms))
    A = None if G is None else G.polynomial()
    if A is None or len(A) > MAX_TERMS:
        return None
    return Terms(constant, tuple(A), *(_listed(weights[name]) for name in ("B", "C", "log")))


def _index(alpha: Fraction, power: Fraction) -> tuple[str, int] | None:
    """Return the list and the index of the term with the energy λ^power, None if there is none."""
    name, order = ("B", power / 2) if power > 0 else ("C", -power / (2 * alpha))
    if order.denominator != 1 or order > MAX_TERMS:
        return None
    n = order.numerator - 1
    # The series with a gap is that of the larger moment.
    has_gap = (alpha > 1) == (name == "B") and multiplicity(alpha, n) is not None
    return "log" if has_gap else name, n


def _energy(alpha: Fraction, name: str, n: int) -> Fraction:
    if name == "log":
        return energy_of_log(alpha, n)
    return energy_of_B(alpha, n) if name == "B" else energy_of_C(alpha, n)


def _monomials(alpha: Fraction, name: str, n: int) -> MonomialSum:
    if name != "log":
        return _from_power_sum(B_term(alpha, n) if name == "B" else C_term(alpha, n))
    term = log_term(alpha, n)
    moments = (Fraction(1), term.alpha) if term.is_exchanged else (term.alpha, Fraction(1))
    log_square = {_LOG_G3 if term.is_exchanged else _LOG_G1: Fraction(2), _LOG_RHO: Fraction(-1)}
    total = _from_power_sum(term.rest)
    for square, moment in zip((_G1, _G3), moments, strict=True):
        for logarithm, factor in log_square.items():
            powers = tuple(
                2 * s + term.power * r + one for s, r, one in zip(square, _RHO, logarithm, strict=True)
            )
            total[powers] = term.residue * moment * factor
    return total


def _from_power_sum(terms: PowerSum) -> MonomialSum:
    return {
        tuple(first * a + third * b for a, b in zip(_G1, _G3, strict=True)): factor
        for (first, third), factor in terms.items()
    }


def _listed(weights: Mapping[int, Fraction]) -> tuple[Fraction, ...]:
    return tuple(_values(weights))


def _values(weights: Mapping[int, Fraction]) -> Iterator[Fraction]:
    for n in range(max(weights, default=-1) + 1):
        yield weights.get(n, _ZERO)
