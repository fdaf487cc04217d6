"""Recognises potentials of three terms, whose motions are elliptic functions of time."""

from dataclasses import dataclass
from fractions import Fraction

from flint import fmpq

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.monomials import as_fraction
from service.dynamics.potentials.potential import FormulaPotential, Potential
from service.dynamics.potentials.terms.laurent import laurent


@dataclass(frozen=True, slots=True)
class ThreeTerms:
    """V = a1 g1 + c1 (g1² − g2²) + b1 / g3² + constant, for A = 2C.

    For C = 2A the first and third axes are exchanged: g1 and g3 here are the
    client's g3 and g1.
    """

    a1: Fraction
    b1: Fraction
    c1: Fraction
    constant: Fraction = Fraction(0)


def recognise(
    body: RigidBody, potential: Potential, g1_sign: int = 1, *, most_products: int | None = None
) -> ThreeTerms | None:
    """Return ``potential`` as three terms if it equals them on |g| = 1, else None.

    ``g1_sign`` is the sign of g1 there (of the client's g3 for C = 2A), which
    matters to a formula with abs in it. Exact: the formula is expanded in rational
    numbers. One with π, irrational constants or other functions is not recognised,
    nor one that takes more than ``most_products`` products of terms.
    """
    is_exchanged = body.C == 2 * body.A
    if not (is_exchanged or body.A == 2 * body.C) or not isinstance(potential, FormulaPotential):
        return None
    expanded = laurent(potential.tape, g1_sign, is_exchanged=is_exchanged, most_products=most_products)
    if expanded is None:
        return None

    def coefficient(i: int, j: int) -> Fraction:
        return as_fraction(expanded.get((i, j, 0, 0), fmpq(0)))

    # c1 (g1² − g2²) = c1 (2 g1² + g3²) − c1.
    c1 = coefficient(0, 2)
    expected = {(1, 0, 0, 0), (0, -2, 0, 0), (2, 0, 0, 0), (0, 2, 0, 0), (0, 0, 0, 0)}
    if coefficient(2, 0) != 2 * c1 or not expected.issuperset(expanded):
        return None
    return ThreeTerms(g1_sign * coefficient(1, 0), coefficient(0, -2), c1, coefficient(0, 0) + c1)
