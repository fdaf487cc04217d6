"""The known families of admissible polynomials, by their formulas."""

from fractions import Fraction

from service.dynamics.inverse.polynomials import product, quadratic
from service.dynamics.potentials.families.coefficients import B_term
from service.dynamics.potentials.terms import exchanged
from tests.dynamics.inverse.exact_polynomials import Polynomial


def known_admissible(alpha: Fraction, degree: int) -> list[Polynomial]:
    """Return the known admissible polynomials up to ``degree`` on the sphere, for A/C = α ≠ 1.

    They are 1, the products of α g1² + g3² with 1, g2, …, g2^(degree-2) and, where α or
    1/α is an even integer not greater than degree + 1, one homogeneous polynomial
    more: |B_n| with n = α/2 - 1, or its mirror.
    """
    basis: list[Polynomial] = [{(0, 0, 0): Fraction(1)}]
    larger = max(alpha, 1 / alpha)
    if larger % 2 == 0 and larger <= degree + 1:
        term = B_term(larger, larger.numerator // 2 - 1)
        terms = (term if alpha > 1 else exchanged(term)).items()
        # All coefficients of the one polynomial have the same sign.
        basis.append({(first.numerator, 0, third.numerator): abs(factor) for (first, third), factor in terms})
    basis += [product(quadratic(alpha), {(0, k, 0): Fraction(1)}) for k in range(degree - 1)]
    return basis
