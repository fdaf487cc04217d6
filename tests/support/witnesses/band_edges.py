"""Where Bobylev's and Steklov's motion stops being stable, as Lamé's equation says it."""

from fractions import Fraction

from flint import arb

from service.dynamics.formula.algebras.ball import ball
from workers.solvers.stability.monodromy import equator


def band_edges(nu: Fraction) -> tuple[arb, arb | None]:
    """Return the B/C < 1 and the B/C > 1, None if there is none, where stability ends besides at B = C."""
    size = abs(nu)
    x1 = equator(size)
    double = 2 * ball(size)
    below, above = double / (double + x1), double - 1 / x1
    return below, double / above if above > 0 else None
