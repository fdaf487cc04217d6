"""The two vector fields of the compatibility equation, tangent to the sphere, in the ring of a proof.

With X and D of theory 1.2 (X = A g1 g2 ∂1 + C g3 g2 ∂3 - Q ∂2 along the curves,
g1 ∂3 - g3 ∂1 around the g2 axis) the fields used are

    Ξ = g2 X,        Δ = g1 g3 (g1 ∂3 - g3 ∂1):

both send every monomial in the coordinates to itself times a polynomial. Being
tangent to the sphere they respect its relation. Then

    H = V + Q ΔV / (2 (A - C) g1² g3²),     ΞH = -(Q g2 / (2 (A - C) g1 g3)) L(V),

so L(V) = 0 on the sphere if and only if ΞH = 0.
"""

from fractions import Fraction
from typing import Literal

from service.dynamics.body import RigidBody
from service.dynamics.verdict.exact_ring.generators import (
    CircleConstant,
    Coordinate,
    Cosine,
    CosineOfTurn,
    Divisor,
    Element,
    Exponential,
    Logarithm,
    Root,
    Sine,
)
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.ring_functions.ring_algebra import RingAlgebra

Field = Literal["along", "around"]
"""``along`` the curves: Ξ; ``around`` the g2 axis: Δ."""


class VectorFields:
    """Ξ and Δ for one body, acting on one ring."""

    def __init__(self, body: RigidBody, algebra: RingAlgebra, ring: Ring) -> None:
        self._ring = ring
        self._algebra = algebra
        self._body = body
        self._rates: dict[tuple[Field, int], Element] = {}
        A, C = ring.constant(body.A), ring.constant(body.C)
        g1_squared, g3_squared = ring.polynomial(ring.g1_squared), ring.polynomial(ring.g3_squared)
        self.Q = ring.add(ring.multiply(A, g1_squared), ring.multiply(C, g3_squared))
        g2_squared = ring.polynomial(ring.g2_squared)
        zero = ring.constant(Fraction(0))
        # Logarithmic derivatives of g1, g2, g3 under either field.
        self._coordinate_rates: dict[Field, tuple[Element, Element, Element]] = {
            "along": (ring.multiply(A, g2_squared), ring.negate(self.Q), ring.multiply(C, g2_squared)),
            "around": (ring.negate(g3_squared), zero, g1_squared),
        }

    def H(self, V: Element) -> Element:
        """Return H = V + Q ΔV / (2 (A - C) g1² g3²), in canonical form."""
        ring = self._ring
        bend = ring.multiply(self.Q, self.derivative("around", V))
        x1, _, x3 = ring.coordinate_index
        below = ring.monomial({x1: -2 * ring.layout.degree("g1"), x3: -2 * ring.layout.degree("g3")})
        scale = ring.constant(1 / (2 * (self._body.A - self._body.C)))
        return self.cancelled(ring.add(V, ring.multiply(ring.multiply(scale, below), bend)))

    def derivative(self, field: Field, element: Element) -> Element:
        """Return the derivative of ``element`` along the field: Σ (u ∂/∂u) times the rate of u."""
        ring = self._ring
        numerator, shift = element.numerator, element.shift
        total = ring.constant(Fraction(0))
        for index, (degree, exponent) in enumerate(zip(numerator.degrees(), shift, strict=True)):
            if degree <= 0 and exponent == 0:
                continue
            rate = self._rate(field, index)
            if rate.is_zero:
                continue
            scaled = exponent * numerator
            if degree > 0:
                scaled += ring.context.gen(index) * numerator.derivative(index)
            total = ring.add(total, ring.multiply(Element(scaled, shift), rate))
        return total

    def _rate(self, field: Field, index: int) -> Element:
        """Return the logarithmic derivative (derivative of u)/u of a generator."""
        rate = self._rates.get((field, index))
        if rate is None:
            rate = self._ring.normal(self._compute_rate(field, index))
            self._rates[field, index] = rate
        return rate

    def _compute_rate(self, field: Field, index: int) -> Element:
        ring = self._ring

        def derivative(element: Element) -> Element:
            return ring.normal(self.derivative(field, element))

        match ring.natures[index]:
            case Coordinate(position, degree):
                return self._times(Fraction(1, degree), self._coordinate_rates[field][position])
            case CircleConstant() | CosineOfTurn():
                return ring.constant(Fraction(0))
            case Root(base, degree):
                # u^degree = base gives u'/u = base' / (degree u^degree).
                below = ring.monomial({index: -degree})
                return self._times(Fraction(1, degree), ring.multiply(derivative(base), below))
            case Divisor(base):
                return ring.multiply(derivative(base), ring.monomial({index: -1}))
            case Exponential(exponent, degree):
                return self._times(Fraction(1, degree), derivative(exponent))
            case Logarithm(argument):
                rate = derivative(argument)
                if rate.is_zero:
                    return rate
                relative = self._algebra.divide(rate, argument)
                return ring.multiply(relative, ring.monomial({index: -1}))
            case Sine(argument, cosine):
                return ring.multiply(derivative(argument), ring.monomial({cosine: 1, index: -1}))
            case Cosine(argument, sine):
                return ring.negate(ring.multiply(derivative(argument), ring.monomial({sine: 1, index: -1})))

    def _times(self, factor: Fraction, element: Element) -> Element:
        return self._ring.multiply(self._ring.constant(factor), element)

    def cancelled(self, element: Element) -> Element:
        """Return the canonical form with divisors and rho cancelled where the numerator has them."""
        ring = self._ring
        element = ring.canonical(element)
        for index, nature in ring.natures.items():
            if not isinstance(nature, Root | Divisor) or any(nature.base.shift):
                continue
            base = nature.base.numerator
            while element.shift[index] <= -nature.degree and len(element.numerator) > 1:
                quotient = ring.exact_quotient(element.numerator, base)
                if quotient is None:
                    break
                shift = list(element.shift)
                shift[index] += nature.degree
                element = ring.canonical(Element(quotient, tuple(shift)))
        return element
