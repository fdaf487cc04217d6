"""Decides whether a potential, and hence its motions, is symmetric under g2 → −g2."""

from service.dynamics.formula.parity import is_written_even
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.families.general_solution import GeneralPotential
from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.terms.laurent import laurent

MAX_PRODUCTS_EVEN = 20_000
"""Most products of terms, before a formula counts as not even."""


def is_even_in_g2(potential: Potential) -> bool:
    """Tell whether V(g1, −g2, g3) = V(g1, g2, g3) on the sphere is proved.

    False is no claim. A V given by an integral over F is even if its G is: the integral depends on g1 and g3.
    """
    if isinstance(potential, GeneralPotential):
        return all(_is_even(piece.even.tape) for piece in potential.pieces)
    return potential.has_formula and _is_even(potential.tape)


def _is_even(tape: Tape) -> bool:
    if is_written_even(tape, 1):
        return True
    known: bool | None = tape.derived.get(_is_even)
    if known is None:
        known = tape.derived[_is_even] = _multiplies_out_even(tape)
    return known


def _multiplies_out_even(tape: Tape) -> bool:
    # Written out in powers of g1 and g3, with g2 to the first power at most.
    for sign in (1, -1):
        terms = laurent(tape, sign, most_products=MAX_PRODUCTS_EVEN)
        if terms is None or any(k for _, _, k, _ in terms):
            return False
    return True
