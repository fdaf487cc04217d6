"""The integrable and the particular cases of the heavy body that have names, by the moments and the field."""

from dataclasses import dataclass
from fractions import Fraction

from service.dynamics.body import RigidBody
from service.dynamics.identity_cache import IdentityCache
from service.dynamics.inverse.polynomials import as_polynomial
from service.dynamics.potentials.potential import NoClosedFormError, Potential

MAX_INSTRUCTIONS = 100
"""Length of a formula that is looked at: a linear function is written shorter."""


@dataclass(frozen=True, slots=True)
class KnownCase:
    """A case by its name, and who found it."""

    name: str
    source: str


EULER = KnownCase("euler", "L. Euler, 1758")
LAGRANGE = KnownCase("lagrange", "J.-L. Lagrange, 1788")
KOVALEVSKAYA = KnownCase("kovalevskaya", "S. Kovalevskaya, 1889")
BOBYLEV_STEKLOV = KnownCase("bobylev_steklov", "D. K. Bobylev and V. A. Steklov, 1896")
GORIACHEV_CHAPLYGIN = KnownCase("goriachev_chaplygin", "D. N. Goriachev, 1900; S. A. Chaplygin, 1901")


def known_cases(body: RigidBody, potential: Potential) -> tuple[KnownCase, ...]:
    """Return the cases of a body in a linear field, however it is written, the earliest first.

    Conditions are met exactly. That of Bobylev and Steklov is about motions with q = 0; those that need
    B are not told where it was left out.
    """
    # The problems of a list have one potential, or few.
    centre = _LINEAR_PARTS(potential)
    if centre is None:
        return ()
    a, b, c = centre
    if not any(centre):
        return (EULER,)
    found: list[KnownCase] = []
    if (body.A == 2 * body.C and not (b or c)) or (body.C == 2 * body.A and not (a or b)):
        found.append(BOBYLEV_STEKLOV)
    moments = (body.A, body.A if body.B is None else body.B, body.C)
    for axis in range(3) if body.B is not None else ():
        i, j = (axis + 1) % 3, (axis + 2) % 3
        if moments[i] != moments[j]:
            continue
        if not (centre[i] or centre[j]):
            found.append(LAGRANGE)
        elif not centre[axis] and moments[i] in (2 * moments[axis], 4 * moments[axis]):
            found.append(KOVALEVSKAYA if moments[i] == 2 * moments[axis] else GORIACHEV_CHAPLYGIN)
    order = (LAGRANGE, KOVALEVSKAYA, BOBYLEV_STEKLOV, GORIACHEV_CHAPLYGIN)
    return tuple(case for case in order if case in found)


def _linear_part(potential: Potential) -> tuple[Fraction, Fraction, Fraction] | None:
    """Return a, b, c of V = a g1 + b g2 + c g3 plus a constant; None of another potential."""
    try:
        if len(potential.tape.instructions) > MAX_INSTRUCTIONS:
            return None
    except NoClosedFormError:
        return None
    polynomial = as_polynomial(potential)
    if polynomial is None or any(sum(exponents) > 1 for exponents in polynomial):
        return None
    zero = Fraction(0)
    return polynomial.get((1, 0, 0), zero), polynomial.get((0, 1, 0), zero), polynomial.get((0, 0, 1), zero)


_LINEAR_PARTS = IdentityCache(_linear_part)
