r"""Exact proofs that H is constant along one curve \|g3\| = λ \|g1\|^(C/A) in one octant.

With C/A = c/a in lowest terms the curve is the zero of the polynomial \|g3\|^a - λ^a \|g1\|^c. H is constant
along it if X(H) is zero, or a multiple of that polynomial.
"""

from dataclasses import dataclass
from fractions import Fraction

from service.dynamics.body import RigidBody
from service.dynamics.formula.tape import Tape
from service.dynamics.verdict.exact_ring.generators import Element
from service.dynamics.verdict.exact_ring.layout import (
    Layout,
    NoProofError,
    UndefinedInOctantError,
)
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.proofs.on_lines import is_multiple
from service.dynamics.verdict.proofs.proof import Signs
from service.dynamics.verdict.ring_functions.fields import VectorFields
from service.dynamics.verdict.ring_functions.large_enough import in_large_enough_ring
from service.dynamics.verdict.ring_functions.ring_algebra import RingAlgebra

MAX_POWER = 64
"""Larger numerators of A/C make polynomials that are not divided by."""


@dataclass(frozen=True, slots=True)
class CurveOfMotion:
    """The curve of a motion: λ² and, where it is rational, λ."""

    body: RigidBody
    lambda_squared: Fraction
    lambda_: Fraction | None

    def polynomial(self, ring: Ring) -> Element | None:
        """Return the polynomial that is zero on the curve, None if it has no rational coefficients."""
        power = self.body.C / self.body.A
        a, c = power.denominator, power.numerator
        if max(a, c) > MAX_POWER or (a % 2 and self.lambda_ is None):
            return None
        scale = self.lambda_squared ** (a // 2) * ((self.lambda_ or 1) if a % 2 else 1)
        first, _, third = ring.coordinate_index
        left = ring.monomial({third: a * ring.layout.degree("g3")})
        right = ring.monomial({first: c * ring.layout.degree("g1")})
        # With exponents in the numerator: what is divided by has to be a polynomial there.
        return ring.add(_raised(ring, left), _raised(ring, ring.multiply(ring.constant(-scale), right)))


def holds_on_piece(body: RigidBody, tape: Tape, octant: Signs, curve: CurveOfMotion) -> bool:
    """Whether H of a formula is proved constant along the curve in an octant."""

    def is_constant(ring: Ring, algebra: RingAlgebra) -> bool:
        fields = VectorFields(body, algebra, ring)
        V = tape.evaluate(algebra, [ring.coordinate(position) for position in range(3)])
        slope = ring.normal(fields.derivative("along", fields.H(V)))
        if slope.is_zero:
            return True
        polynomial = curve.polynomial(ring)
        return polynomial is not None and is_multiple(ring, slope, polynomial)

    try:
        return in_large_enough_ring(Layout(), octant, is_constant)[1]
    except (UndefinedInOctantError, NoProofError):
        return False


def _raised(ring: Ring, element: Element) -> Element:
    """Return a monomial with its exponents, none of them negative, in the numerator."""
    numerator = element.numerator
    for index, exponent in enumerate(element.shift):
        if exponent:
            numerator = numerator * ring.context.gen(index) ** exponent
    return ring.polynomial(numerator)
