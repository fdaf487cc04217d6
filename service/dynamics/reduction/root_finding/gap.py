r"""Measures the gap of p² from zero at a near-double zero, between a separatrix and its neighbours.

Along the curve let τ be the parameter with dγ/dτ = X = (A g1 g2, −Q, C g3 g2), Q = A g1² + C g3²
(primed axes). Then

.. math:: P = R f,\quad R = \frac{2 C g_3^2}{A Q},\quad f = h - V,\qquad
          \frac{dv}{d\tau} = \mu = C c \sin v ,

and f' = −∇V·X, f'' = −(XᵀV''X + ∇V·X') are known from V's derivatives at any place. From a place b
next to the critical place m, where f'(m) = 0, the value there is

.. math:: f(m) = f(b) - \frac{f'(b)^2}{2 f''(\xi)} ,

which Newton's method makes as sharp as f(b) itself.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from flint import arb, ctx

from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.potentials.potential import Potential
from service.dynamics.reduction.geometry.loop import Loop, LoopPoint

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
        # The error of f is the square of this.
        if size < arb(2) ** (16 - ctx.prec // 2) * _distance_scale(at):
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


def _distance_scale(at: LoopPoint) -> arb:
    # Next to a pole everything happens on the scale of the distance from it.
    return abs(at.g3).mid().min(arb(1))


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
