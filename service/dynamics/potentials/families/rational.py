"""The rational potentials of bodies with A = 2C: Laurent polynomials with H = Σ powers of nu = g3²/g1.

With v = 1 + g3²/g1² and Gauss's terminating series,

    U_n = g1^(2n-1) 2F1(1/2-n, 2-2n; 5/2-n; v),             H[U_n] = (n-3/2) nu^(2n-1),
    W_n = g1^(2n-2) g3^-(4n-2) 2F1(2, 1-n; 2+n; v),         H[W_n] = -(n+1) nu^(-2n).
"""

from collections.abc import Sequence
from fractions import Fraction
from math import comb

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.monomials import weighted_sum
from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.terms.powers import (
    MAX_TERMS,
    Exponents,
    SeriesTooLongError,
    about_one,
    monomial_sum,
)

FAMILY = "rational"
Laurent = dict[Exponents, Fraction]


class RationalBodyError(DynamicsError):
    """The rational family needs A = 2C."""

    code = "rational_needs_double_moment"


def require_rational_body(body: RigidBody) -> None:
    """Raise RationalBodyError unless A = 2C."""
    if body.A != 2 * body.C:
        raise RationalBodyError(
            f"A = {body.A} and C = {body.C}: the rational family needs A = 2C", pointer="/body"
        )


def rational_potential(a: Sequence[Fraction], b: Sequence[Fraction], c: Sequence[Fraction]) -> Potential:
    """Return V = Σ a_n-terms + Σ b_n-terms + Σ c_k-terms, indices from 1.

    a_n multiplies U_n, a_3 multiplies -U_3 (the paper's sign, with its misprint
    in g3^8/g1^3 corrected); b_n multiplies Catalan(n) W_n; c_1 multiplies
    g1² - g2², and c_k for k ≥ 2 multiplies g2^(2k-2) (2 g1² + g3²).

    Raises
    ------
    SeriesTooLongError
        A list is longer than MAX_TERMS; the pointer names it.
    """
    terms: list[tuple[Fraction, Laurent]] = []
    for name, coefficients, term in (("a", a, _a_term), ("b", b, _b_term), ("c", c, _c_term)):
        if len(coefficients) > MAX_TERMS:
            raise SeriesTooLongError(name, len(coefficients))
        terms += [(weight, term(n)) for n, weight in enumerate(coefficients, start=1) if weight]
    return Potential.from_tree(monomial_sum(weighted_sum(terms)), FAMILY)


def U_term(n: int) -> Laurent:
    """Return U_n, n ≥ 1: degree 2n-1."""
    factors = about_one(Fraction(1, 2) - n, 2 - 2 * n, Fraction(5, 2) - n, 2 * n - 1, Fraction(1))
    return {(2 * n - 1 - 2 * k, 0, 2 * k): factor for k, factor in enumerate(factors)}


def W_term(n: int) -> Laurent:
    """Return W_n, n ≥ 1: degree -2n."""
    factors = about_one(2, 1 - n, 2 + n, n, Fraction(1))
    return {(2 * n - 2 - 2 * k, 0, 2 * k - 4 * n + 2): factor for k, factor in enumerate(factors)}


def _a_term(n: int) -> Laurent:
    sign = -1 if n == 3 else 1
    return {exponents: sign * factor for exponents, factor in U_term(n).items()}


def _b_term(n: int) -> Laurent:
    catalan = comb(2 * n, n) // (n + 1)
    return {exponents: catalan * factor for exponents, factor in W_term(n).items()}


def _c_term(k: int) -> Laurent:
    if k == 1:
        return {(2, 0, 0): Fraction(1), (0, 2, 0): Fraction(-1)}
    return {(2, 2 * k - 2, 0): Fraction(2), (0, 2 * k - 2, 2): Fraction(1)}
