"""Polynomials in g1, g2, g3 with rational coefficients, as the compatibility equation needs them."""

from collections.abc import Mapping
from fractions import Fraction

from flint import fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from service.dynamics.equations.compatibility import pde_residual
from service.dynamics.verdict.sphere.boxes import Point

Polynomial = dict[tuple[int, int, int], Fraction]

_RING = fmpq_mpoly_ctx.get(("g1", "g2", "g3"), "degrevlex")


def residual(alpha: Fraction, polynomial: Polynomial) -> Polynomial:
    """Return L(V) for A = α and C = 1."""
    V = _RING.from_dict({e: fmpq(c.numerator, c.denominator) for e, c in polynomial.items()})
    first = [V.derivative(i) for i in range(3)]
    second = [[part.derivative(j) for j in range(3)] for part in first]
    A, C = (_RING.constant(fmpq(m.numerator, m.denominator)) for m in (alpha, Fraction(1)))
    return _as_dict(pde_residual(A, C, _RING.gens(), first, second))


def evaluate(polynomial: Mapping[tuple[int, int, int], Fraction], point: Point) -> Fraction:
    return sum(
        (c * point[0] ** i * point[1] ** j * point[2] ** k for (i, j, k), c in polynomial.items()),
        Fraction(0),
    )


def _as_dict(polynomial: fmpq_mpoly) -> Polynomial:
    return {
        (int(i), int(j), int(k)): Fraction(int(c.p), int(c.q))
        for (i, j, k), c in polynomial.to_dict().items()
    }
