"""Formulas in the ring of a proof: each function an element with its rules; two fields tangent to the sphere.

A ring that turns out too small is replaced by a larger one, and the computation begins again.

With X and D of theory 1.2 (X = A g1 g2 ∂1 + C g3 g2 ∂3 - Q ∂2 along the curves,
g1 ∂3 - g3 ∂1 around the g2 axis) the fields used are

    Ξ = g2 X,        Δ = g1 g3 (g1 ∂3 - g3 ∂1):

both send every monomial in the coordinates to itself times a polynomial. Being
tangent to the sphere they respect its relation. Then

    H = V + Q ΔV / (2 (A - C) g1² g3²),     ΞH = -(Q g2 / (2 (A - C) g1 g3)) L(V),

so L(V) = 0 on the sphere if and only if ΞH = 0.
"""

from collections.abc import Callable
from fractions import Fraction
from typing import Literal, TypeVar

from service.dynamics.body import RigidBody
from service.dynamics.verdict.exact_ring.generators import (
    CircleConstant,
    Coordinate,
    Cosine,
    CosineOfTurn,
    Divisor,
    Element,
    Exponential,
    Layout,
    LayoutTooSmallError,
    Logarithm,
    NoProofError,
    Root,
    Sine,
    Work,
)
from service.dynamics.verdict.exact_ring.products import Splitting, conjugate, factorise, irreducible_factors
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.ring_functions.algebraic_numbers import AlgebraicNumbers
from service.dynamics.verdict.ring_functions.radicals import Radicals
from service.dynamics.verdict.ring_functions.transcendental import Transcendental, Trigonometry

T = TypeVar("T")

MAX_EXPANDED_TERMS = 24
"""Powers of sums with up to this many terms are expanded; higher ones are kept as powers of their base."""


class RingAlgebra:
    """An Algebra over :class:`Element`.

    One that ``keeps_kinks`` gives |f| the same form in all octants, whatever the sign of f is in one of them.

    Raises (all methods)
    --------------------
    UndefinedInOctantError
        A division by zero, or a root or logarithm of what is never positive.
    LayoutTooSmallError, NoProofError
        See :class:`Ring`.
    """

    def __init__(self, ring: Ring, *, keeps_kinks: bool = False) -> None:
        self._ring = ring
        self._numbers = AlgebraicNumbers(ring)
        self._splitting = splitting = Splitting(ring, keeps_kinks=keeps_kinks)
        self._radicals = Radicals(ring, self, self._numbers, splitting)
        self._trigonometry = Trigonometry(ring, self, self._numbers)
        self._transcendental = Transcendental(ring, self, splitting, self._radicals)
        self._powers: dict[int, tuple[Element, Element, int]] = {}

    def assume(self, operand: Element, sign: int) -> None:
        """Take it for known that ``operand`` has the sign wherever the formula is looked at.

        Raises UndefinedInOctantError if it has the other sign in the whole octant.
        """
        self._splitting.assume(operand, sign)

    @property
    def has_value_everywhere(self) -> bool:
        """Tell whether all roots and logarithms read have values in the whole octant, but on curves."""
        return not self._splitting.signs.are_assumed

    def constant(self, value: Fraction) -> Element:
        """Return an exact number."""
        return self._ring.constant(value)

    def pi(self) -> Element:
        """Return π."""
        return self._ring.pi()

    def add(self, left: Element, right: Element) -> Element:
        """Return left + right."""
        return self._ring.add(left, right)

    def subtract(self, left: Element, right: Element) -> Element:
        """Return left - right."""
        return self._ring.add(left, self._ring.negate(right))

    def negate(self, operand: Element) -> Element:
        """Return -operand."""
        return self._ring.negate(operand)

    def multiply(self, left: Element, right: Element) -> Element:
        """Return left · right."""
        return self._ring.multiply(left, right)

    def divide(self, left: Element, right: Element) -> Element:
        """Return left / right."""
        return self._ring.multiply(left, self.reciprocal(right))

    def reciprocal(self, operand: Element) -> Element:
        """Return 1 / operand: the monomial inverted, what else there is made a divisor."""
        ring = self._ring
        factors = factorise(ring, operand)
        inverse = ring.multiply(
            ring.constant(1 / factors.coefficient),
            ring.monomial({i: -e for i, e in enumerate(factors.exponents) if e}),
        )
        if factors.is_monomial:
            return inverse
        rest = ring.polynomial(factors.rest)
        if self._numbers.contains(rest):
            number = self._numbers.reciprocal(rest)
            if number is not None:
                return ring.multiply(inverse, number)
        mirrored = conjugate(ring, factors.rest)
        if mirrored is not None:
            norm = ring.multiply(rest, mirrored)
            return ring.multiply(ring.multiply(inverse, mirrored), self.reciprocal(norm))
        # Divisors made before were split off by factorise: this one is new.
        index = ring.atom(f"divisor:{factors.rest}", Divisor(rest))
        return ring.multiply(inverse, ring.monomial({index: -1}))

    def power(self, base: Element, exponent: Fraction) -> Element:
        """Return base^exponent."""
        if exponent.denominator == 1:
            if exponent < 0:
                base, exponent = self.reciprocal(base), -exponent
            return self._integer_power(base, exponent.numerator)
        # The root of a power, before it was expanded: (x²)^(1/2) is |x|.
        _, origin, times = self._powers.get(id(base), (base, base, 1))
        return self._radicals.power(origin, exponent, times)

    def general_power(self, base: Element, exponent: Element) -> Element:
        """Return exp(exponent · log(base))."""
        return self.call("exp", self._ring.multiply(exponent, self.call("log", base)))

    def call(self, name: str, argument: Element) -> Element:
        """Return the function of ``argument``."""
        match name:
            case "exp":
                return self._transcendental.exponential(argument)
            case "log":
                _, origin, times = self._powers.get(id(argument), (argument, argument, 1))
                return self._transcendental.logarithm(origin, times)
            case "sin":
                return self._trigonometry.cosine_and_sine(argument)[1]
            case "cos":
                return self._trigonometry.cosine_and_sine(argument)[0]
            case "tan":
                cosine, sine = self._trigonometry.cosine_and_sine(argument)
                return self.divide(sine, cosine)
            case "abs":
                if self._ring.normal(argument).is_zero:
                    return argument
                return self._radicals.power(argument, Fraction(1, 2), 2)
        raise NoProofError(f"no exact rules for {name}")

    def _integer_power(self, base: Element, exponent: int) -> Element:
        """Return base^exponent, exponent ≥ 0: expanded if that is short, else as a power of generators."""
        ring = self._ring
        terms = len(base.numerator)
        if exponent < 2 or terms < 2 or _terms_of_power(terms, exponent) <= MAX_EXPANDED_TERMS:
            result = ring.integer_power(base, exponent)
        else:
            # Of what the base itself is a power of, before it was expanded.
            _, base, times = self._powers.get(id(base), (base, base, 1))
            exponent *= times
            result = self._kept_power(base, exponent)
        if exponent > 1:
            self._powers[id(result)] = (result, base, exponent)
        return result

    def _kept_power(self, base: Element, exponent: int) -> Element:
        ring = self._ring
        if ring.normal(base).is_zero:
            return ring.constant(Fraction(0))
        factors = factorise(ring, base)
        monomial = ring.monomial({i: e * exponent for i, e in enumerate(factors.exponents) if e})
        number, pieces = irreducible_factors(ring, factors.rest)
        power_of_number = ring.integer_power(ring.constant(number * factors.coefficient), exponent)
        result = ring.multiply(power_of_number, monomial)
        for piece, power in pieces:
            key = f"divisor:{piece}"
            index = ring.find(key)
            if index is None:
                index = ring.atom(key, Divisor(ring.polynomial(piece)))
            result = ring.multiply(result, ring.monomial({index: power * exponent}))
        return result


def _terms_of_power(terms: int, exponent: int) -> int:
    """Return the number of terms of a power of a sum of ``terms``, cut off where it is large."""
    count = 1
    for k in range(1, terms):
        count = count * (exponent + k) // k
        if count > MAX_EXPANDED_TERMS:
            break
    return count


MAX_LARGER_RINGS = 60
"""Larger rings that are tried before the proof is abandoned."""


def in_large_enough_ring(
    layout: Layout,
    signs: tuple[int, int, int],
    compute: Callable[[Ring, RingAlgebra], T],
    work: Work | None = None,
    *,
    keeps_kinks: bool = False,
) -> tuple[Ring, T]:
    """Return the first ring, from ``layout`` on, that is large enough for ``compute``, and what it returns.

    Parameters
    ----------
    signs
        Of g1, g2, g3 in the octant of the ring.
    work
        What the proof has spent in other rings; None for one that begins here.

    keeps_kinks
        See :class:`RingAlgebra`.

    Raises
    ------
    NoProofError
        The ring keeps growing; and what ``compute`` raises.
    """
    for _ in range(MAX_LARGER_RINGS):
        ring = Ring(layout, signs, work)
        try:
            return ring, compute(ring, RingAlgebra(ring, keeps_kinks=keeps_kinks))
        except LayoutTooSmallError as error:
            layout = error.layout
    raise NoProofError("the ring keeps growing")


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
