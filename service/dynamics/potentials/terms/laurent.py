"""Formulas as exact Laurent polynomials on the sphere |g| = 1, in which every function has one form."""

from collections.abc import Mapping

from flint import fmpq

from service.dynamics.formula.algebras.monomials import SPHERE, NotAMonomialSumError, Rules, read
from service.dynamics.formula.tape import Tape

Exponents = tuple[int, int, int, int]
"""Exponents of |x|, |y|, g2 and the sign of y."""
Laurent = Mapping[Exponents, fmpq]

MAX_TERMS = 200


def laurent(
    tape: Tape, sign: int, *, is_exchanged: bool = False, most_products: int | None = None
) -> Laurent | None:
    """Return the formula as a sum of |x|^i |y|^j g2^k (sgn y)^e, k ≤ 1 and e 0 or 1; None for any other.

    None too if it has no value for one sign of y, has more than MAX_TERMS terms on the way, or takes
    ``most_products`` products of terms.

    Parameters
    ----------
    sign
        The known sign of x, which is g1, or g3 if the axes are exchanged; y is the other one.
    """
    signs = (0, 0, sign) if is_exchanged else (sign, 0, 0)
    rules = Rules(
        signs, plain=2, relation=SPHERE[1], has_roots=False, most_terms=MAX_TERMS, most_work=most_products
    )
    try:
        found = read(tape, rules)
    except NotAMonomialSumError:
        return None
    if found.positive:
        return None
    if is_exchanged:
        return {(d, a, b, odd & 1): value for (a, b, d, odd, _), value in found.terms.items()}
    return {(a, d, b, odd >> 2): value for (a, b, d, odd, _), value in found.terms.items()}
