"""A uniform field: V = a g1 + b g2 + c g3, a heavy body whose centre of mass is off the fixed point."""

from fractions import Fraction

from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.terms.powers import monomial_sum

FAMILY = "gravity"


def gravity_potential(a: Fraction, b: Fraction, c: Fraction) -> Potential:
    """Return V = a g1 + b g2 + c g3."""
    return Potential.from_tree(monomial_sum({(1, 0, 0): a, (0, 1, 0): b, (0, 0, 1): c}), FAMILY)
