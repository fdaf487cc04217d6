"""Proves signs of ring elements on an octant, by the signs of their terms or by balls.

Proofs, tried in turn: all terms have one sign, the generators in them being
positive; the constant outweighs all other terms, |g| being 1; terms of one sign
have the conjugate and the product with it, (1 - g2)(1 + g2) = rho; balls on
pieces of the whole sphere, or of the octant, exclude zero.
"""

from collections.abc import Iterator
from fractions import Fraction

from flint import arb, ctx, fmpq, fmpq_mpoly

from service.dynamics.formula.algebras.ball import BallAlgebra, ball
from service.dynamics.verdict.exact_ring.generators import (
    CircleConstant,
    Coordinate,
    Cosine,
    CosineOfTurn,
    Divisor,
    Element,
    Exponential,
    LayoutTooSmallError,
    Logarithm,
    Root,
    Sine,
)
from service.dynamics.verdict.exact_ring.ring import Ring

_BALLS = BallAlgebra()


class GeneratorValues:
    """A ball for each generator's value, at the current precision.

    ``gamma`` are balls of g1, g2, g3; none are needed for numbers. A value is
    not finite where the balls are too wide for a division or a logarithm.
    """

    def __init__(self, ring: Ring, gamma: tuple[arb, arb, arb] | None = None) -> None:
        self._ring = ring
        self._gamma = gamma
        self._known: dict[int, arb] = {}

    def element(self, element: Element) -> arb:
        """Return a ball of the element."""
        total = arb(0)
        for exponents, coefficient in element.numerator.terms():
            term = arb(coefficient)
            for index, (low, shift) in enumerate(zip(exponents, element.shift, strict=True)):
                exponent = int(low) + shift
                if exponent:
                    term *= _BALLS.power(self.generator(index), Fraction(exponent))
            total += term
        return total

    def generator(self, index: int) -> arb:
        """Return a ball of the generator."""
        if index not in self._known:
            self._known[index] = self._value(index)
        return self._known[index]

    def _value(self, index: int) -> arb:
        match self._ring.natures[index]:
            case Coordinate(position, degree):
                if self._gamma is None:
                    raise ValueError("a number was expected")
                return _root(self._ring.signs[position] * self._gamma[position], degree)
            case CircleConstant(degree):
                return _root(arb.pi(), degree)
            case Root(base, degree):
                return _root(self.element(base), degree)
            case Divisor(base):
                return self.element(base)
            case Exponential(exponent, degree):
                return (self.element(exponent) / degree).exp()
            case Logarithm(argument):
                return self.element(argument).log()
            case Sine(argument, _):
                return self.element(argument).sin()
            case Cosine(argument, _):
                return self.element(argument).cos()
            case CosineOfTurn(order):
                return 2 * (2 * arb.pi() / order).cos()


def coordinates_in(ring: Ring, element: Element) -> set[int]:
    """Return the positions 0, 1, 2 of the coordinates that an element depends on, by its generators too."""
    found: set[int] = set()
    seen: set[int] = set()
    pending = [element]
    while pending:
        current = pending.pop()
        for index, (degree, shift) in enumerate(zip(current.numerator.degrees(), current.shift, strict=True)):
            if index in seen or (degree <= 0 and shift == 0):
                continue
            seen.add(index)
            match ring.natures[index]:
                case Coordinate(position):
                    found.add(position)
                case Root(inner) | Divisor(inner) | Exponential(inner) | Logarithm(inner):
                    pending.append(inner)
                case Sine(inner) | Cosine(inner):
                    pending.append(inner)
    return found


def _root(ball: arb, degree: int) -> arb:
    """Return the root of a number known not to be negative, even if its ball contains negative ones."""
    if degree == 1:
        return ball
    if ball > 0:
        return _BALLS.power(ball, Fraction(1, degree))
    if not ball.is_finite() or ball.upper() < 0:
        return arb("nan")
    return arb(0).union(_BALLS.power(arb(ball.upper()), Fraction(1, degree)))


MAX_PIECES = 160
"""Pieces of the sphere on which balls are tried for one sign."""
MIN_PIECE_WIDTH = 1 / 64
PRODUCTS_OF_A_PIECE = 40
"""Cost of evaluating one term in balls, in products of terms."""
MAX_TERMS = 60
"""Most terms of an element whose sign is searched; the root of a longer one is kept."""
_BITS = 64
_PRECISIONS = (64, 512)
_POINT = (Fraction(2, 7), Fraction(6, 7), Fraction(3, 7))
Box = tuple[arb, arb, arb]
Octant = tuple[int, int, int]


class Signs:
    """Known signs in one ring: proved, or implied because the formula needs them."""

    def __init__(self, ring: Ring) -> None:
        self._ring = ring
        self._known: dict[str, int] = {}
        self._undecided: set[str] = set()
        self.are_assumed = False
        """Whether one is known only because the formula has no value elsewhere."""

    def of(self, factor: fmpq_mpoly) -> int:
        """Return the sign of the polynomial wherever the formula has a value in the octant, 0 if unknown.

        Coordinates whose signs were used become sign dependent.
        """
        key = str(factor)
        found = self._known.get(key)
        if found is None:
            found = self._prove(factor) if len(factor) <= MAX_TERMS else 0
            self._known[key] = found
        return found or self._by_layout(factor)

    def is_everywhere(self, factor: fmpq_mpoly) -> bool:
        """Tell whether the polynomial is proved to have one sign on the whole sphere."""
        dependent = self._ring.sign_dependent
        self._ring.sign_dependent = set()
        try:
            return self._prove(factor) != 0 and not self._ring.sign_dependent
        finally:
            self._ring.sign_dependent = dependent

    def leave_undecided(self, factor: fmpq_mpoly) -> None:
        """Note that the factor's unknown sign kept a root or a logarithm from being split."""
        self._undecided.add(str(factor))

    def learn(self, factor: fmpq_mpoly, sign: int) -> None:
        """Note that the formula has a value only where the factor has the sign.

        Raises LayoutTooSmallError if that would have been of use before.
        """
        key, name = str(factor), self._name(factor)
        self._known[key], self.are_assumed = sign, True
        layout = self._ring.layout
        if key in self._undecided and name is not None and name not in layout.signs:
            raise LayoutTooSmallError(layout.with_sign(name, sign))

    def _by_layout(self, factor: fmpq_mpoly) -> int:
        """Return the sign that an earlier reading of the formula came upon, 0 if there was none."""
        signs = self._ring.layout.signs
        name = self._name(factor) if signs else None
        found = signs.get(name, 0) if name is not None else 0
        self.are_assumed |= found != 0
        return found

    def _name(self, factor: fmpq_mpoly) -> str | None:
        """Return a name that stays the same while the ring grows, None for what has atoms in it."""
        ring = self._ring
        if any(degree > 0 and index < ring.rho_index for index, degree in enumerate(factor.degrees())):
            return None
        degrees = [ring.layout.degree(ring.key(index)) for index in range(ring.rho_index, ring.width)]
        return f"{ring.signs} {degrees} {factor}"

    def _prove(self, factor: fmpq_mpoly) -> int:
        ring = self._ring
        element = ring.polynomial(factor)
        used = coordinates_in(ring, element)
        sign = self._sign_of_terms(factor)
        if sign == 0 and (constant := self._sign_of_constant(factor)):
            return constant
        sign = sign or self._by_conjugate(factor)
        if sign == 0:
            at_a_point = self._sign_at_a_point(element)
            if at_a_point == 0:
                return 0
            if not used or self._has_sign(element, at_a_point, whole=True):
                return at_a_point
            if self._has_sign(element, at_a_point, whole=False):
                sign = at_a_point
        if sign:
            ring.sign_dependent |= used
        return sign

    def _sign_of_terms(self, factor: fmpq_mpoly) -> int:
        """Return the sign that all terms share, their generators being positive, or 0."""
        ring = self._ring
        for index, degree in enumerate(factor.degrees()):
            if degree > 0 and not is_positive(ring, index):
                return 0
        coefficients = factor.coeffs()
        if all(value > 0 for value in coefficients):
            return 1
        return -1 if all(value < 0 for value in coefficients) else 0

    def _sign_of_constant(self, factor: fmpq_mpoly) -> int:
        """Return the sign of the constant term if it outweighs all others on the sphere, or 0."""
        ring = self._ring
        plain = (*ring.coordinate_index, ring.rho_index)
        if any(degree > 0 and index not in plain for index, degree in enumerate(factor.degrees())):
            return 0
        # None of these generators exceeds 1.
        *others, number = factor.coeffs()
        if factor.monoms()[-1] != ring.no_shift:
            return 0
        weight = sum((abs(value) for value in others), start=fmpq(0))
        if abs(number) <= weight:
            return 0
        return 1 if number > 0 else -1

    def _by_conjugate(self, factor: fmpq_mpoly) -> int:
        """Return the sign of f = X + Y u, u² in the ring, as that of f f̄ / f̄ with f̄ = X - Y u; or 0."""
        ring = self._ring
        for mirrored in conjugates(ring, factor):
            sign = self._sign_of_terms(mirrored)
            if not sign:
                continue
            norm = ring.normal(ring.polynomial(factor * mirrored))
            if norm.is_zero:
                continue
            sign *= self._sign_of_terms(norm.numerator)
            if sign:
                return sign
        return 0

    def _sign_at_a_point(self, element: Element) -> int:
        """Return the sign at one point inside the octant, 0 if it is not certain there."""
        for bits in _PRECISIONS:
            with ctx.workprec(bits):
                g1, g2, g3 = (sign * ball(g) for sign, g in zip(self._ring.signs, _POINT, strict=True))
                sign = _sign(GeneratorValues(self._ring, (g1, g2, g3)).element(element))
            if sign:
                return sign
        return 0

    def _has_sign(self, element: Element, sign: int, *, whole: bool) -> bool:
        """Tell whether balls show the sign everywhere on the sphere, or in the octant."""
        ring = self._ring
        if whole and any(ring.layout.degree(f"g{position + 1}") != 1 for position in range(3)):
            return False
        low = -1.0 if whole else 0.0
        with ctx.workprec(_BITS):
            return all(
                self._has_sign_on_side(element, sign, low, side, (1, 1, 1) if whole else ring.signs)
                for side in ((1, -1) if whole else (1,))
            )

    def _has_sign_on_side(self, element: Element, sign: int, low: float, side: int, flips: Octant) -> bool:
        """Say so for g1 and g3 from ``low`` to 1 and g2 of the sign ``side``, all times ``flips``."""
        pending, pieces = [((low, 1.0), (low, 1.0))], 0
        while pending:
            first, third = pending.pop()
            box = _box(first, third, side)
            if box is None:
                continue
            pieces += 1
            self._ring.work.spend(PRODUCTS_OF_A_PIECE * len(element.numerator))
            placed = (flips[0] * box[0], flips[1] * box[1], flips[2] * box[2])
            found = _sign(GeneratorValues(self._ring, placed).element(element))
            if found == sign:
                continue
            if found or pieces > MAX_PIECES or first[1] - first[0] < MIN_PIECE_WIDTH:
                return False
            pending += [(a, b) for a in _halves(first) for b in _halves(third)]
        return True


def conjugates(ring: Ring, factor: fmpq_mpoly) -> Iterator[fmpq_mpoly]:
    """Yield X - Y u for each u with u² in the ring such that the polynomial is X + Y u, Y not zero."""
    x2 = ring.coordinate_index[1]
    for index, degree in enumerate(factor.degrees()):
        if degree <= 0 or not (isinstance(ring.natures[index], Root) or index == x2):
            continue
        power = ring.relation_power(index)
        exponents = {int(term[index]) for term in factor.monoms()}
        if power % 2 == 0 and exponents <= {0, power // 2}:
            u = ring.context.gen(index)
            yield factor - 2 * (factor.derivative(index) * u) / (power // 2)


def is_positive(ring: Ring, index: int) -> bool:
    """Tell whether the generator is positive by its nature."""
    nature = ring.natures[index]
    return index == ring.pi_index or isinstance(nature, Coordinate | Root | Exponential)


def _box(first: tuple[float, float], third: tuple[float, float], sign: int) -> Box | None:
    """Return balls of g1, g2, g3 for intervals of g1 and g3, None if these are off the sphere."""
    g1, g3 = _ball(first), _ball(third)
    nearest = sum((0.0 if low <= 0 <= high else min(low * low, high * high)) for low, high in (first, third))
    if nearest > 1:
        return None
    farthest = sum(max(low * low, high * high) for low, high in (first, third))
    # Squares of binary fractions of few digits: exact in doubles.
    ends = arb(max(1 - farthest, 0.0)).sqrt(), arb(1 - nearest).sqrt()
    return g1, sign * ends[0].union(ends[1]), g3


def _ball(interval: tuple[float, float]) -> arb:
    low, high = interval
    return arb((low + high) / 2, (high - low) / 2)


def _halves(interval: tuple[float, float]) -> tuple[tuple[float, float], tuple[float, float]]:
    low, high = interval
    middle = (low + high) / 2
    return (low, middle), (middle, high)


def _sign(ball: arb) -> int:
    """Return 1 or -1 if the ball is finite and excludes zero, else 0."""
    if not ball.is_finite() or ball.contains(0):
        return 0
    return 1 if ball > 0 else -1
