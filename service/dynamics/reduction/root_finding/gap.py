r"""Measures the gap of p² from zero at a near-double zero, and proves a double one.

Along the curve let τ be the parameter with dγ/dτ = X = (A g1 g2, −Q, C g3 g2), Q = A g1² + C g3²
(primed axes). Then

.. math:: P = R f,\quad R = \frac{2 C g_3^2}{A Q},\quad f = h - V,\qquad
          \frac{dv}{d\tau} = \mu = C c \sin v ,

and f' = −∇V·X, f'' = −(XᵀV''X + ∇V·X') are known from V's derivatives at any place. From a place b
next to the critical place m, where f'(m) = 0, the value there is

.. math:: f(m) = f(b) - \frac{f'(b)^2}{2 f''(\xi)} ,

which Newton's method makes as sharp as f(b) itself.

On the curve |g3| = λ |g1|^{C/A} p² has a zero of order two or more where

.. math:: D = g_1 V_3 - g_3 V_1 = 0, \qquad \nabla V\cdot X = 0, \quad X = (A g_1 g_2, -Q, C g_3 g_2).

Both are tested exactly at a place with algebraic coordinates: on the equator, or where g2, g1 or g3
is recognised as a root of a small polynomial. With C/A = m/n in lowest terms and g1² = σ^n, g3² = λ² σ^m

.. math:: σ^n + λ^2 σ^m = 1 - g_2^2 .
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from math import log2
from typing import Literal, TypeVar

from flint import arb, ctx, fmpz_mat

from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.algebraic import (
    Algebraic,
    AlgebraicAlgebra,
    MoreBitsNeededError,
    NotAlgebraicError,
)
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.potentials.potential import Potential
from service.dynamics.reduction.geometry.loop import Loop, LoopPoint

T = TypeVar("T")

MAX_GAP_BITS = 1 << 18
"""Largest precision in bits: enough to distinguish exp(−100000) from 0."""
MAX_BIT_INSTRUCTIONS = 1 << 25
"""Bits times instructions of the formula: some seconds on one core."""
KNOWN_BITS = 64
"""Required relative accuracy of a gap."""
INTEGRAL_INSTRUCTIONS = 1 << 16
"""Assumed number of instructions of a V that is given by an integral."""
EQUATOR_LOG2_DISTANCE = -24
"""log2 of the distance from the equator within which that itself is tried as the critical place."""


class SeparatrixUndecidedError(DynamicsError):
    """p² at a near rest of the motion is proved neither zero nor nonzero."""

    code = "separatrix_undecided"


@dataclass(frozen=True, slots=True)
class NearRest:
    """A place where P is least, or largest, and next to zero: P ≈ K ((v − v_m)² + gap) there."""

    v: arb
    """The critical place of f."""
    square: arb
    """f(m) in units of ½ f''(m)/μ²: the square of ``reach`` where P/K > 0 at ``v``, minus that else."""
    K: arb
    """½ P'' at the place, with no error but that of rounding and of the place."""
    at: LoopPoint

    @property
    def reach(self) -> arb:
        """Return the distance, in v, at which P is twice what it is at the place, or vanishes."""
        return abs(self.square).sqrt()


def effort_of(potential: Potential) -> int:
    """Return how much there is to compute for one value of V."""
    return len(potential.tape.instructions) + 1 if potential.has_formula else INTEGRAL_INSTRUCTIONS


def ladder(loop: Loop, first: int) -> Iterator[int]:
    """Return numbers of bits, each twice the one before, as long as V is computed with them in seconds."""
    bits = first
    while bits <= MAX_GAP_BITS and bits * effort_of(loop.potential) <= MAX_BIT_INSTRUCTIONS:
        yield bits
        bits *= 2


def near_rest(loop: Loop, v: arb) -> NearRest | None:
    """Return the place next to ``v`` where P is critical, at the current precision.

    ``v`` lies in −π < v < π, no pole. None if Newton's method does not come to such a place with
    P'' ≠ 0. The square may be a ball that contains 0: then nothing is known of its sign.
    """
    loop = loop.refined()
    at, place = _equator_or(loop, v)
    for _ in range(8 + ctx.prec.bit_length()):
        first, second = slopes(loop, at)
        if not (second > 0 or second < 0) or not first.is_finite():
            return None
        step = -(first / second).mid()
        size = abs(-first / second).upper()
        # The error of f is the square of this. Next to a pole the scale is the distance from it.
        if size < arb(2) ** (16 - ctx.prec // 2) * abs(at.g3).mid().min(arb(1)):
            return _described(loop, at, place, first, size)
        place = (place + step * _mu(loop, at, place)).mid()
        at = loop.point(place)
        if not at.P.is_finite():
            return None
    return None


def slopes(loop: Loop, at: LoopPoint) -> tuple[arb, arb]:
    """Return f' and f'' along τ at a point, or on a box of points."""
    A, C = ball(loop.A), ball(loop.C)
    g1, g2, g3 = at.g1, at.g2, at.g3
    X = (A * g1 * g2, -(A * g1 * g1 + C * g3 * g3), C * g3 * g2)
    bend = (A * (X[0] * g2 + g1 * X[1]), -2 * (A * g1 * X[0] + C * g3 * X[2]), C * (X[2] * g2 + g3 * X[1]))
    place = (g1, g2, g3)
    if loop.mirrored:
        place, X, bend = place[::-1], X[::-1], bend[::-1]
    _, gradient, hessian = loop.potential.jet_ball(*place)
    first = sum((slope * rate for slope, rate in zip(gradient, X, strict=True)), arb(0))
    second = sum((slope * rate for slope, rate in zip(gradient, bend, strict=True)), arb(0))
    for row, rate in zip(hessian, X, strict=True):
        for entry, other in zip(row, X, strict=True):
            second += entry * rate * other
    return -first, -second


def factor_R(loop: Loop, at: LoopPoint) -> arb:
    """Return R = P/f at a point."""
    A, C = ball(loop.A), ball(loop.C)
    return 2 * C * at.g3 * at.g3 / (A * (A * at.g1 * at.g1 + C * at.g3 * at.g3))


def box_about(loop: Loop, at: LoopPoint, radius: arb) -> LoopPoint:
    """Return a box that holds the curve up to the distance ``radius`` in τ from a point: |X| ≤ A."""
    wide = arb(0, (ball(loop.A) * radius).abs_upper())
    # c² is g2²/cos² v, between Z² and Z² + α G² and smooth: dc/dτ ≤ 2 α A.
    slope = arb(0, (2 * ball(loop.alpha) * ball(loop.A) * radius / at.c).abs_upper())
    return LoopPoint(at.g1 + wide, at.g2 + wide, at.g3 + wide, at.c + slope, at.P)


def equator_point(loop: Loop, g3_sign: int) -> LoopPoint:
    """Return the point on the equator, exactly g2 = 0."""
    g1, g3 = loop.G * loop.g1_sign, loop.Z * g3_sign
    c = (loop.Z * loop.Z + ball(loop.alpha) * loop.G * loop.G).sqrt()
    return LoopPoint(g1, arb(0), g3, c, loop.radicand_at(g1, arb(0), g3))


def _equator_or(loop: Loop, v: arb) -> tuple[LoopPoint, arb]:
    """Return the equator where it is next to ``v`` and as good as critical, else the point at ``v``."""
    sign = 1 if v > 0 else -1
    quarter = sign * arb.pi() / 2
    if abs(v - quarter) < arb(2) ** EQUATOR_LOG2_DISTANCE:
        at = equator_point(loop, sign)
        first, second = slopes(loop, at)
        if (second > 0 or second < 0) and abs(first / second) < arb(2) ** (16 - ctx.prec // 2):
            return at, quarter
    place = v.mid()
    return loop.point(place), place


def _mu(loop: Loop, at: LoopPoint, place: arb) -> arb:
    return ball(loop.C) * at.c * place.sin()


def _described(loop: Loop, at: LoopPoint, place: arb, first: arb, size: arb) -> NearRest | None:
    """Return the critical place next to ``at``, proved to be within 2 ``size`` of it in τ."""
    second = slopes(loop, box_about(loop, at, 2 * size))[1]
    away = first / second
    if not ((second > 0 or second < 0) and abs(away) <= 2 * size):
        return None
    mu = _mu(loop, at, place)
    R = factor_R(loop, at)
    f = at.P / R - first * first / (2 * second)
    # μ is smooth: over so small a distance it changes by far less than a 2^-8 of itself.
    v = place - mu * away * arb(1, arb(2) ** -8)
    return NearRest(v, 2 * f * mu * mu / second, R * second / (2 * mu * mu), at)


Coordinate = Literal["g2", "g1", "g3"]
Triple = tuple[Algebraic, Algebraic, Algebraic]
FIRST_BITS = 256
MAX_POLYNOMIAL_DEGREE = 4
MAX_CURVE_DEGREE = 400
POINT_BITS = 1024
"""Bits of the place itself."""
SAME_PLACE_BITS = 24
"""A place is the one that was meant within 2^-24 of its distance from the pole."""
COEFFICIENT_BITS = 24
"""Coefficients of a polynomial that is taken for more than chance are at most so long."""


@dataclass(frozen=True, slots=True)
class _Guess:
    """A coordinate that may be a root of a polynomial with these integer coefficients, constant first."""

    coordinate: Coordinate
    coefficients: tuple[int, ...]
    near: arb


def proved_rest(loop: Loop, v: arb) -> arb | None:
    """Return the place next to ``v`` where P is proved to have a zero of order two or more, None if none is.

    ``v`` lies in −π < v < π and is no pole.
    """
    found = exact_at(loop, v, lambda algebra, place: True if _is_rest(loop, algebra, place) else None)
    return None if found is None else found[0]


def exact_at(
    loop: Loop, v: arb, question: Callable[[AlgebraicAlgebra, Triple], T | None]
) -> tuple[arb, T] | None:
    """Return the first place next to ``v`` with algebraic coordinates that has an answer, and this.

    The question is asked again with more bits as often as it takes these.
    """
    if not loop.potential.has_formula or max(loop.alpha.as_integer_ratio()) > MAX_CURVE_DEGREE:
        return None
    found = (_answer_at(loop, v, guess, question) for guess in _guesses(loop, v))
    return next((answer for answer in found if answer is not None), None)


def _guesses(loop: Loop, v: arb) -> Iterator[_Guess]:
    cosine = v.cos()
    if cosine.contains(0) or abs(cosine) < arb(2) ** -48:
        yield _Guess("g2", (0, 1), arb(0))
        if cosine.contains(0):
            return
    at = loop.point(v)
    first, third = (at.g3, at.g1) if loop.mirrored else (at.g1, at.g3)
    coordinates: list[tuple[Coordinate, arb]] = [("g2", at.g2), ("g1", first), ("g3", third)]
    for degree in range(1, MAX_POLYNOMIAL_DEGREE + 1):
        for name, value in coordinates:
            yield from (_Guess(name, found, value) for found in _small_polynomials(value, degree))


def _small_polynomials(value: arb, degree: int) -> Iterator[tuple[int, ...]]:
    """Return polynomials with small coefficients that nearly vanish at ``value``, by lattice reduction."""
    if not value.is_finite():
        return
    told = set[tuple[int, ...]]()
    known = -float(arb(value.rad()).log() / arb(2).log()) if value.rad() > 0 else float(ctx.prec)
    for bits in (32, 64, 160, 320):
        # What is less than chance needs more digits than the coefficients have.
        if bits > min(known, float(ctx.prec) - 8.0) or bits < COEFFICIENT_BITS * degree // 2:
            continue
        scale = arb(2) ** bits
        rows = []
        for k in range(degree + 1):
            image = (value.mid() ** k * scale + arb("0.5")).mid().floor().unique_fmpz()
            if image is None:
                return
            rows.append([*(int(k == j) for j in range(degree + 1)), int(image)])
        short = fmpz_mat(rows).lll()
        coefficients = tuple(int(short[0, j]) for j in range(degree + 1))
        is_small = _longest(coefficients) * (degree + 1) < bits
        # x^2 says no more than x.
        is_new = coefficients not in told and (coefficients[0] != 0 or degree == 1)
        if is_small and is_new and coefficients[-1] and _longest(coefficients) <= COEFFICIENT_BITS:
            told.add(coefficients)
            yield coefficients


def _answer_at(
    loop: Loop, v: arb, guess: _Guess, question: Callable[[AlgebraicAlgebra, Triple], T | None]
) -> tuple[arb, T] | None:
    bits, effort = FIRST_BITS, effort_of(loop.potential)
    while bits <= MAX_GAP_BITS and bits * effort <= MAX_BIT_INSTRUCTIONS:
        try:
            with ctx.workprec(bits):
                algebra = AlgebraicAlgebra()
                answer = question(algebra, ExactCurve(loop, algebra).point(v, guess))
            if answer is None:
                return None
            break
        except MoreBitsNeededError as more:
            bits = max(more.bits, 2 * bits)
        except NotAlgebraicError:
            return None
    else:
        return None
    with ctx.workprec(POINT_BITS):
        exact = _angle(loop, ExactCurve(loop, AlgebraicAlgebra()).point(v, guess), v)
    # Another zero than the one that was meant.
    return (exact, answer) if abs(exact - v) < arb(2) ** -SAME_PLACE_BITS * abs(v.sin()) else None


def _angle(loop: Loop, place: Triple, v: arb) -> arb:
    """Return v at an exact place."""
    first, second, third = place
    sine = abs((first if loop.mirrored else third).ball) / loop.refined().Z
    quarter = arb.pi() / 2 if second.exact == 0 else sine.asin()
    size = quarter if v.cos() > 0 or second.exact == 0 else arb.pi() - quarter
    return size if v > 0 else -size


def _is_rest(loop: Loop, algebra: AlgebraicAlgebra, place: Triple) -> bool:
    g1, g2, g3 = place
    jets = FirstOrderJets(algebra, 3)
    jet = loop.potential.tape.evaluate(jets, jets.variables((g1, g2, g3)))
    V_1, V_2, V_3 = jets.gradient(jet)
    times, add = algebra.multiply, algebra.add
    if not algebra.is_zero(algebra.subtract(times(g1, V_3), times(g3, V_1))):
        return False
    A, C = (loop.C, loop.A) if loop.mirrored else (loop.A, loop.C)
    a, c = algebra.constant(A), algebra.constant(C)
    Q = add(times(a, times(g1, g1)), times(c, times(g3, g3)))
    along = add(times(times(a, times(g1, g2)), V_1), times(times(c, times(g3, g2)), V_3))
    return algebra.is_zero(algebra.subtract(along, times(Q, V_2)))


class ExactCurve:
    """Places of a curve with exact coordinates, in the client's axes."""

    def __init__(self, loop: Loop, algebra: AlgebraicAlgebra) -> None:
        self._algebra, self._loop = algebra, loop
        ratio = 1 / loop.alpha
        self._ratio = 1 / ratio if loop.mirrored else ratio
        """C/A of the client's axes."""
        self._square = Fraction(loop.lambda_squared)

    def point(self, v: arb, guess: _Guess) -> Triple:
        """Return the place next to ``v`` with this coordinate."""
        algebra, loop = self._algebra, self._loop
        one = algebra.constant(Fraction(1))
        given = root_near(algebra, guess.coefficients, guess.near)
        square = algebra.multiply(given, given)
        other_sign = 1 if v.sin() > 0 else -1
        sign1, sign3 = (other_sign, loop.g1_sign) if loop.mirrored else (loop.g1_sign, other_sign)
        if guess.coordinate == "g2":
            sigma = self._sigma(algebra.subtract(one, square))
            half = algebra.power(sigma, Fraction(1, 2))
            size1 = algebra.power(half, Fraction(self._ratio.denominator))
            size3 = algebra.power(half, Fraction(self._ratio.numerator))
            size3 = algebra.multiply(algebra.power(algebra.constant(self._square), Fraction(1, 2)), size3)
            return self._signed(size1, sign1), given, self._signed(size3, sign3)
        scale = algebra.constant(self._square)
        if guess.coordinate == "g1":
            first, third = square, algebra.multiply(scale, algebra.power(square, self._ratio))
        else:
            first, third = algebra.power(algebra.divide(square, scale), 1 / self._ratio), square
        height = algebra.subtract(algebra.subtract(one, first), third)
        g2 = self._signed(algebra.power(height, Fraction(1, 2)), 1 if v.cos() > 0 else -1)
        g1 = self._signed(algebra.power(first, Fraction(1, 2)), sign1)
        return g1, g2, self._signed(algebra.power(third, Fraction(1, 2)), sign3)

    def _signed(self, size: Algebraic, sign: int) -> Algebraic:
        return size if sign > 0 else self._algebra.negate(size)

    def _sigma(self, height: Algebraic) -> Algebraic:
        """Return σ > 0 with q σ^n + p σ^m = q (1 − g2²), λ² = p/q."""
        p, q = self._square.as_integer_ratio()
        m, n = self._ratio.as_integer_ratio()
        log_p, log_q = log2(p), log2(q)
        top, low, log_top, log_low = (n, m, log_q, log_p) if n > m else (m, n, log_p, log_q)
        # With the divisor of 1 − g2² times the leading coefficient σ becomes an algebraic integer.
        lead = log_top + height.down
        largest = max(
            (log_low + height.down + (top - low - 1) * lead) / (top - low),
            (log_q + height.up + (top - 1) * lead) / top,
        )

        def equation(sigma: arb) -> arb:
            return q * sigma**n + p * sigma**m - q * height.ball.mid()

        return self._algebra.root_of(
            lambda sigma: equation(sigma) - q * arb(0, height.ball.rad()),
            self._near_sigma(height.ball, equation),
            degree=top,
            up=1.0 + max(largest, 0.0),
            down=lead,
            of=height,
        )

    def _near_sigma(self, height: arb, equation: Callable[[arb], arb]) -> arb:
        """Return σ to a few digits, by halving: the equation grows with it."""
        low, high = arb(0), arb(1).max(height)
        while equation(high) < 0:
            high = 2 * high
        for _ in range(96):
            middle = ((low + high) / 2).mid()
            low, high = (middle, high) if equation(middle) < 0 else (low, middle)
        return high


def numbers_near(algebra: AlgebraicAlgebra, near: arb) -> Iterator[Algebraic]:
    """Yield the roots of small polynomials that a number may be, of low degrees first."""
    for degree in range(1, MAX_POLYNOMIAL_DEGREE + 1):
        for coefficients in _small_polynomials(near, degree):
            # A polynomial that is small there need not have a root, or only touches zero.
            with suppress(NotAlgebraicError):
                yield root_near(algebra, coefficients, near)


def root_near(algebra: AlgebraicAlgebra, a: Sequence[int], near: arb) -> Algebraic:
    """Return the root next to a number of a polynomial with integer coefficients, constant first."""
    if len(a) == 2:
        return algebra.constant(Fraction(-a[0], a[1]))
    degree, lead = len(a) - 1, abs(a[-1])
    # Of a monic polynomial no root is larger than twice the largest root of a coefficient (Fujiwara).
    largest = max(
        (log2(abs(a[k])) + (degree - k - 1) * log2(lead)) / (degree - k) for k in range(degree) if a[k]
    )
    one = algebra.constant(Fraction(1))
    return algebra.root_of(
        _polynomial(a), near, degree=degree, up=1.0 + max(largest, 0.0), down=log2(lead), of=one
    )


def _longest(coefficients: Sequence[int]) -> int:
    return max(map(abs, coefficients)).bit_length()


def _polynomial(coefficients: Sequence[int]) -> Callable[[arb], arb]:
    def value(x: arb) -> arb:
        total = arb(0)
        for a in reversed(coefficients):
            total = total * x + a
        return total

    return value
