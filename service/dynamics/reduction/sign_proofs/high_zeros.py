r"""Proves a zero of P of order three or more, and that there is no other one on a stretch.

Along a curve P has the zeros and, but for a factor ±1, the signs of D = g1 V_3 − g3 V_1, a function of g2.
If the derivatives of D of orders below m are 0 at a place, exactly, and that of order m has one sign all over
a stretch about it, then D = D^{(m)}(ξ) (g2 − c)^m / m! there: one zero, of order m, and none else. On cells
beside the place Taylor's formula about their middles, with the remainder bounded on the whole cell, has a
sign where bounds of D itself, and of its first two derivatives, lose all in cancellation.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from itertools import chain
from math import pi

from flint import arb, ctx

from service.dynamics.formula.algebra import Algebra, T
from service.dynamics.formula.algebras.algebraic import (
    Algebraic,
    AlgebraicAlgebra,
    MoreBitsNeededError,
    NotAlgebraicError,
)
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.tape import Tape
from service.dynamics.formula.vanishing import VanishingPart, parts_in_g2, with_vanishing
from service.dynamics.reduction.geometry.slopes import SeriesAlgebra, along_curve
from service.dynamics.reduction.root_finding.gap import (
    POINT_BITS,
    SAME_PLACE_BITS,
    equator_point,
    exact_at,
    numbers_near,
)
from service.dynamics.reduction.root_finding.zeros import (
    MAX_ORDER,
    LoopPlace,
    Radicand,
    enclose_zero,
    exponent_at,
    lowest_place,
)
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import QUARTER_TURN
from service.dynamics.reduction.sign_proofs.cells import Half, Side

FIRST_ORDERS = 4
"""Orders that exact algebra tries before all."""
MIN_RELATIVE_DISTANCE = 2.0**-40
"""Distance from the place, against where it began, to which a stretch is narrowed at most."""
TAYLOR_HALVINGS = 6
"""Times that a cell is halved where Taylor's formula does not settle it."""
MAX_BRACKET_HALVINGS = 240
"""Most halvings of a bracket by signs: values of 2^-16000 locate a zero of order 16 to 2^-1000 only."""
ORDER_BITS = 512
KNOWN_DECIMALS = 9
"""Zeros of one function that agree in so many decimals are the same, or else are not told apart."""
ORDER_LOG2_DISTANCE = -12
"""log2 of the distance from a zero at which its order is seen, where algebra does not tell it."""


@dataclass(frozen=True, slots=True)
class HighZero:
    """A zero of high order on a stretch, and the part of that on which there may be others beside it."""

    v: arb
    order: int
    start: arb
    stop: arb
    is_proved: bool
    """It is of this order, and the only zero on the whole stretch."""

    def is_settled(self, most: float) -> bool:
        """Tell whether it is proved, or what is left is so narrow against its distance to the pole."""
        return self.is_proved or bool((self.stop - self.start) < most * self.v.sin())

    @property
    def rest(self) -> tuple[Side, Side]:
        """Return the ends of what is left."""
        first, last = map(float, (self.start, self.stop))
        start, stop = ((1.0, v) if v < QUARTER_TURN else (-1.0, pi - v) for v in (first, last))
        return start, stop


def high_zero(
    half: Half, start: Side, stop: Side, signs: tuple[int, int], radicand: Radicand
) -> HighZero | None:
    """Return the zero between two places where P has these signs; None if there is no place to begin from."""
    left, right = ((arb.pi() - arb(x)).mid() if side < 0 else arb(x) for side, x in (start, stop))

    def value(v: arb) -> arb:
        return radicand(LoopPlace("middle", v))

    v = _by_signs(value, left, right) if signs[0] != signs[1] else lowest_place(value, left, right, arb(0))
    exact = exact_order(half, v)
    if exact is None:
        seen = exponent_at(value, v.mid(), (right - left).mid() * arb(2) ** ORDER_LOG2_DISTANCE)
        order = round(seen) if 2.5 < seen < MAX_ORDER + 0.5 else 3
    else:
        v, order = exact
    if not (left < v < right):
        return None
    left, right = _narrowed(half, (left, right), v, order, signs, is_exact=exact is not None)
    is_proved = exact is not None and _sign(_coefficients(half, left, right, order)[order]) != 0
    return HighZero(v, order, left, right, is_proved)


def exact_order(half: Half, v: arb) -> tuple[arb, int] | None:
    """Return the place next to ``v``, and the order of the zero that D has there, by exact algebra.

    The place has algebraic coordinates, or a part u of the formula vanishes there, such as g2 − sin(1/3): in
    the Taylor coefficients of D those of u are exact where u is, and the first of u is 0.
    """

    def order(algebra: AlgebraicAlgebra, place: Sequence[Algebraic]) -> int | None:
        return _first_order(algebra, lambda highest: _series_of_D(algebra, half, place, highest))

    return exact_at(half.loop, v, order) or order_at_part(half, v)


def _first_order(algebra: AlgebraicAlgebra, series: Callable[[int], list[Algebraic]]) -> int | None:
    """Return the order of the first coefficient that is not 0; None if it is the 0th, or all seem to be 0."""
    for highest in (FIRST_ORDERS, MAX_ORDER):
        first = next((k for k, each in enumerate(series(highest)) if not algebra.is_zero(each)), None)
        if first is not None:
            return first or None
    return None


def order_at_part(half: Half, v: arb) -> tuple[arb, int] | None:
    """Return the place next to ``v`` where a part of the formula vanishes, and the order of D there."""
    nearest = arb(2) ** -SAME_PLACE_BITS * v.sin()
    for part in parts_in_g2(half.tape):

        def value(x: arb, part: VanishingPart = part) -> arb:
            return part.part.evaluate(BallAlgebra(), _place_at(half, x))

        low, high = value((v - nearest).mid()), value((v + nearest).mid())
        if not low * high < 0:
            continue
        with ctx.workprec(POINT_BITS):
            x = enclose_zero(value, v - nearest, v + nearest)
            try:
                order = _order_of(half, part, x)
            except (MoreBitsNeededError, NotAlgebraicError):
                continue
        if order is not None:
            return x, order
    return None


def _order_of(half: Half, part: VanishingPart, v: arb) -> int | None:
    """Return the order of the zero of D at the place in a ball where a part of the formula vanishes."""
    algebra = AlgebraicAlgebra()
    g1, g2, g3 = (algebra.transcendental(x) for x in _place_at(half, v))
    place = [g1, _solution(algebra, part.part, g2.ball) or g2, g3]

    def series(highest: int) -> list[Algebraic]:
        powers = SeriesAlgebra(algebra, highest)
        g = along_curve(algebra, (half.body.A, half.body.C), place, highest)
        _, *rates = part.part.evaluate(powers, g)
        return _turned(powers, part.whole, g, [algebra.constant(Fraction(0)), *rates])

    return _first_order(algebra, series)


@dataclass(frozen=True, slots=True)
class ExactPlace:
    """A g2 at which parts of a formula that depend on it alone vanish, exactly."""

    g2: arb
    whole: Tape
    """The formula with the parts as further inputs."""
    vanishing: tuple[tuple[Tape, int], ...]
    """These parts, and the orders of their zeros."""


def exact_place(tape: Tape, part: Tape, near: arb) -> ExactPlace | None:
    """Return the place next to a g2 where a part of a formula vanishes, by exact algebra; None if unknown.

    It is a root of a small polynomial, or what makes 0 of a part that is linear in g2.
    """
    found: dict[tuple[Tape, float], ExactPlace | None] = tape.derived.setdefault(exact_place, {})
    # The same for all cells and curves on which the part vanishes there.
    key = part, round(float(near), KNOWN_DECIMALS)
    if key not in found:
        with ctx.workprec(max(ctx.prec, ORDER_BITS)):
            found[key] = _exact_place(tape, part, near)
    return found[key]


def _exact_place(tape: Tape, part: Tape, near: arb) -> ExactPlace | None:
    algebra = AlgebraicAlgebra()
    linear = (_solution(algebra, each.part, near) for each in parts_in_g2(tape))
    for number in chain(numbers_near(algebra, near), linear):
        if number is not None and _order_at(algebra, number, part):
            return ExactPlace(number.ball, *with_vanishing(tape, partial(_order_at, algebra, number)))
    return None


def _order_at(algebra: AlgebraicAlgebra, g2: Algebraic, part: Tape) -> int | None:
    """Return the order of the zero of a function at an exact g2; None if it is none, or not known."""
    try:
        if taylor_of_function(BallAlgebra(), part, g2.ball, 0)[0].contains(0):
            return _first_order(algebra, partial(taylor_of_function, algebra, part, g2))
    except (MoreBitsNeededError, NotAlgebraicError):
        pass
    return None


def taylor_of_function(algebra: Algebra[T], part: Tape, g2: T, order: int) -> list[T]:
    """Return the Taylor coefficients of a function of g2 about a number, up to an order."""
    zero = algebra.constant(Fraction(0))
    if order == 0:
        return [part.evaluate(algebra, [zero, g2, zero])]
    series = SeriesAlgebra(algebra, order)
    nothing = series.series([])
    return part.evaluate(series, [nothing, series.series([g2, algebra.constant(Fraction(1))]), nothing])


def _solution(algebra: AlgebraicAlgebra, part: Tape, near: arb) -> Algebraic | None:
    """Return the number that makes 0 of a part that is linear in g2, such as g2 − sin(1/3)."""
    try:
        # No rule of algebra makes an exact slope of what is not linear about a number that is not known.
        _, slope = taylor_of_function(algebra, part, algebra.transcendental(near), 1)
        if not slope.exact:
            return None
        (at_nothing,) = taylor_of_function(algebra, part, algebra.constant(Fraction(0)), 0)
        found = algebra.divide(algebra.negate(at_nothing), slope)
        return found if algebra.is_zero(taylor_of_function(algebra, part, found, 0)[0]) else None
    except (MoreBitsNeededError, NotAlgebraicError):
        return None


def _narrowed(
    half: Half, ends: tuple[arb, arb], v: arb, order: int, signs: tuple[int, int], *, is_exact: bool
) -> tuple[arb, arb]:
    """Return the stretch without the cells next to its ends where Taylor's formula shows the sign."""
    left, right = ends
    nearest = MIN_RELATIVE_DISTANCE * (right - left)
    while not (is_exact and _sign(_coefficients(half, left, right, order)[order])):
        before = left, right
        left = _inwards(half, left, v, order, signs[0], nearest)
        right = _inwards(half, right, v, order, signs[1], nearest)
        if (left, right) == before:
            break
    return left, right


def _inwards(half: Half, end: arb, v: arb, order: int, sign: int, nearest: arb) -> arb:
    """Return a place nearer to ``v`` up to which P is proved to have the sign; the end if there is none."""
    if abs(end - v) < nearest:
        return end
    # (1 + 1/2m)^m < 2: of a zero of order m, Taylor's formula adds less than its first term to that.
    step = (abs(end - v) / (2 * order)).min(end.sin() / 8)
    for _ in range(TAYLOR_HALVINGS):
        inner = (end + step if v > end else end - step).mid()
        left, right = (end, inner) if v > end else (inner, end)
        if _sign_on(half, left, right, order + 1) == sign:
            return inner
        step = step / 2
    return end


def _sign_on(half: Half, left: arb, right: arb, order: int) -> int:
    """Return the sign of P between two places by Taylor's formula about the middle, 0 if it is not known."""
    middle = ((left + right) / 2).mid()
    place = _place_at(half, middle)
    ends = [_place_at(half, v)[1] - place[1] for v in (left, right)]
    t = ends[0].union(ends[1])
    total = _coefficients(half, left, right, order)[order]
    for coefficient in reversed(_series_of_D(BallAlgebra(), half, place, order - 1)):
        total = total * t + coefficient
    return _sign(total) * half.turn


def _coefficients(half: Half, left: arb, right: arb, order: int) -> list[arb]:
    """Return the Taylor coefficients of D in g2 about all places between two."""
    ends = [_place_at(half, v) for v in (left, right)]
    if left < arb.pi() / 2 < right:
        # The other two coordinates are largest on the equator.
        ends.append(_place_at(half, arb.pi() / 2))
    first, *others = ends
    for other in others:
        first = [one.union(each) for one, each in zip(first, other, strict=True)]
    return _series_of_D(BallAlgebra(), half, first, order)


def _series_of_D(algebra: Algebra[T], half: Half, place: Sequence[T], order: int) -> list[T]:
    """Return the Taylor coefficients of D = g1 V_3 − g3 V_1 along the curve in g2."""
    g = along_curve(algebra, (half.body.A, half.body.C), place, order)
    return _turned(SeriesAlgebra(algebra, order), half.tape, g)


def _turned(series: SeriesAlgebra[T], tape: Tape, g: Sequence[list[T]], *further: list[T]) -> list[T]:
    """Return D of a formula in g1, g2, g3, and in ``further`` functions of g2."""
    g1, g2, g3 = g
    jets = FirstOrderJets(series, 1)
    seeds = jets.seed(g1, (series.negate(g3),)), jets.seed(g2, (None,)), jets.seed(g3, (g1,))
    found = tape.evaluate(jets, [*seeds, *(jets.seed(u, (None,)) for u in further)])
    return jets.gradient(found)[0]


def _place_at(half: Half, v: arb) -> list[arb]:
    """Return g1, g2 and g3 at 0 < v < π, in the client's axes."""
    sine, cosine = v.sin_cos()
    if cosine.contains(0):
        at = equator_point(half.loop, half.g3_sign)
    else:
        at = half.loop.point_from(sine * half.g3_sign, cosine)
    return [at.g3, at.g2, at.g1] if half.loop.mirrored else [at.g1, at.g2, at.g3]


def _by_signs(value: Callable[[arb], arb], left: arb, right: arb) -> arb:
    """Return the place between two where the sign changes, by halving alone."""
    a, b = left.mid(), right.mid()
    rises = value(b) > 0
    for _ in range(MAX_BRACKET_HALVINGS):
        middle = ((a + b) / 2).mid()
        P = value(middle)
        if middle in (a, b) or not (P > 0 or P < 0):
            return middle
        a, b = (a, middle) if (P > 0) == rises else (middle, b)
    return a


def _sign(value: arb) -> int:
    return 0 if not value.is_finite() else 1 if value > 0 else -1 if value < 0 else 0
