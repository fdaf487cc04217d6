r"""The sign of p² on whole stretches of many loops at once, proved in doubles rounded outwards.

A cell is a stretch 0 ≤ v₋ < v ≤ v₊ ≤ π/2 of the northern or southern quarter of a half loop. On it
|g3| = Z s and |g1| = G s^α are powers of s = sin v, and g2 falls as v grows: their bounds are those at
the ends. D = g1 V_3 − g3 V_1, whose sign is that of p² up to the signs of g1 and g3, is evaluated in
:class:`.IntervalAlgebra` with s as a scale. So a cell may begin at the pole itself, where D is known by
its leading power. What the bounds leave open is halved.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.intervals import Interval, IntervalAlgebra
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.tape import Tape
from service.dynamics.problem import PlanarMotion

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
Bounds = tuple[FloatArray, FloatArray]

QUARTER = 0.5 * np.pi
"""The equator, just below π/2; a cell that ends here includes it."""
ULPS = 2.0**-49
HEIGHTS = 2.0**-45
"""More than the relative error of |g2|: 2α log s is off by some 2^-50 of it, hence 1 − s^2α by no more."""
NARROWEST = 1e-11
"""Relative width of a cell that is not halved any more."""
NEAREST = 1e-60
"""A cell at the pole that ends here is not cut again: no single term of D leads there."""
MOST_CELLS = 2048
"""Of one loop at a time."""


@dataclass(frozen=True, slots=True)
class Shape:
    """What the loops of a body and the signs of a motion have in common; primed axes, as in :mod:`.loop`."""

    alpha: Fraction
    is_mirrored: bool
    first_sign: int
    """That of the primed g1."""
    third_sign: int
    """That of the primed g3."""


@dataclass(frozen=True, slots=True)
class Loops:
    """Bounds of Z and G of each loop, and of the inputs that its formula has beside g1, g2, g3."""

    shape: Shape
    Z: Bounds
    G: Bounds
    inputs: tuple[FloatArray, ...] = ()
    """Numbers, each the double nearest to the one meant, shape (loops,)."""


@dataclass(frozen=True, slots=True)
class Cells:
    """Stretches of loops, as arrays of one shape."""

    owner: IntArray
    """The number of the loop."""
    hemisphere: FloatArray
    """The sign of g2."""
    low: FloatArray
    high: FloatArray

    def at(self, chosen: BoolArray) -> "Cells":
        """Return some of them."""
        return Cells(self.owner[chosen], self.hemisphere[chosen], self.low[chosen], self.high[chosen])

    def halves(self) -> "Cells":
        """Return both parts of each; next to a pole the nearer one is much the smaller."""
        at_pole, is_wide = self.low == 0.0, self.high > 2.0 * self.low
        middle = np.where(is_wide, np.sqrt(self.low) * np.sqrt(self.high), 0.5 * (self.low + self.high))
        middle = np.where(at_pole, self.high / 16.0, middle)
        return Cells(
            np.concatenate([self.owner, self.owner]),
            np.concatenate([self.hemisphere, self.hemisphere]),
            np.concatenate([self.low, middle]),
            np.concatenate([middle, self.high]),
        )


def shape_of(body: RigidBody, motion: PlanarMotion) -> Shape:
    """Return the shape of the loops on the half that ``motion`` names; A ≠ C."""
    if body.A < body.C:
        return Shape(body.C / body.A, True, motion.g3_sign, motion.sign_of_g1)
    return Shape(body.alpha, False, motion.sign_of_g1, motion.g3_sign)


def equators(alpha: Fraction, low: FloatArray, high: FloatArray) -> tuple[Bounds, Bounds]:
    """Return bounds of Z and G for every λ (primed) with ``low`` ≤ log λ ≤ ``high``; NaN if not found.

    F(u) = e^{2u} + e^{2α(u − log λ)} − 1 grows with u = log Z: its signs on both sides of a zero
    that Newton's steps found enclose it.
    """
    (z_low, g_high), (z_high, g_low) = _equator(alpha, low), _equator(alpha, high)
    return (z_low[0], z_high[1]), (g_low[0], g_high[1])


def radicand_signs(tape: Tape, loops: Loops, cells: Cells) -> IntArray:
    """Return for each cell the sign that p² certainly has all over it, 0 if that is not known.

    The inputs of the tape are g1, g2, g3 and ``loops.inputs``.
    """
    sine, height = _sines(cells), _heights(loops, cells)
    algebra = IntervalAlgebra([sine])
    shape, of = loops.shape, cells.owner
    first = _signed(algebra, loops.G, of, shape.alpha, shape.first_sign)
    third = _signed(algebra, loops.Z, of, Fraction(1), shape.third_sign)
    g1, g3 = (third, first) if shape.is_mirrored else (first, third)
    inputs = [algebra.about(numbers[of]) for numbers in loops.inputs]
    bounds = derivative_bounds(algebra, tape, (g1, algebra.interval(*height), g3), inputs)
    if bounds is None:
        return np.zeros(len(of), dtype=np.int64)
    lo, hi = bounds
    sign = shape.first_sign * shape.third_sign * (-1 if shape.is_mirrored else 1)
    known: IntArray = ((lo > 0.0) & (hi >= lo)).astype(np.int64) - ((hi < 0.0) & (lo <= hi))
    return sign * known


def derivative_bounds(
    algebra: IntervalAlgebra, tape: Tape, g: tuple[Interval, Interval, Interval], inputs: Sequence[Interval]
) -> Bounds | None:
    """Return bounds of D without its powers of the scales; None where D is 0."""
    g1, g2, g3 = g
    jets = FirstOrderJets(algebra, 1)
    seeds = [jets.seed(g1, (algebra.negate(g3),)), jets.seed(g2, (None,)), jets.seed(g3, (g1,))]
    with np.errstate(all="ignore"):
        found = tape.evaluate(jets, [*seeds, *(jets.seed(each, (None,)) for each in inputs)]).first[0]
    if found is None:
        return None
    shape = g2.lo.shape
    return np.broadcast_to(found.lo, shape), np.broadcast_to(found.hi, shape)


def have_no_motion(tape: Tape, loops: Loops) -> BoolArray:
    """Say of each loop whether p² < 0 on the whole half is proved.

    False is no claim: there may be a motion, or the bounds do not tell.
    """
    count = len(loops.Z[0])
    open_loops = np.isfinite(loops.Z[0]) & np.isfinite(loops.G[0]) & (loops.Z[0] > 0.0) & (loops.G[0] > 0.0)
    cells = _quarters(np.flatnonzero(open_loops))
    while len(cells.owner):
        signs = radicand_signs(tape, loops, cells)
        undecided = signs == 0
        given_up = undecided & np.where(
            cells.low > 0.0, cells.high - cells.low < NARROWEST * cells.high, cells.high < NEAREST
        )
        open_loops[cells.owner[(signs > 0) | given_up]] = False
        crowded = np.bincount(cells.owner[undecided], minlength=count) > MOST_CELLS
        open_loops[crowded] = False
        cells = cells.at(undecided & open_loops[cells.owner]).halves()
    return open_loops


def _quarters(owners: IntArray) -> Cells:
    """Return the quarters of half loops, north and south, each a cell."""
    both = np.concatenate([owners, owners])
    hemisphere = np.repeat([1.0, -1.0], len(owners))
    return Cells(both, hemisphere, np.zeros(len(both)), np.full(len(both), QUARTER))


def _sines(cells: Cells) -> Bounds:
    low = np.sin(cells.low) * (1.0 - ULPS)
    return low, np.where(cells.high >= QUARTER, 1.0, np.minimum(np.sin(cells.high) * (1.0 + ULPS), 1.0))


def _signed(algebra: IntervalAlgebra, size: Bounds, of: IntArray, power: Fraction, sign: int) -> Interval:
    element = algebra.interval(size[0][of], size[1][of], (power,))
    return element if sign > 0 else algebra.negate(element)


def _heights(loops: Loops, cells: Cells) -> Bounds:
    """Return bounds of g2: |g2| = cos v √(Z² + G² R), R = (1 − s^2α)/cos² v, falls as v grows."""
    alpha = float(loops.shape.alpha)
    of = cells.owner
    with np.errstate(all="ignore"):
        low = _height(alpha, loops.Z[0][of], loops.G[0][of], cells.high) * (1.0 - HEIGHTS)
        high = _height(alpha, loops.Z[1][of], loops.G[1][of], cells.low) * (1.0 + HEIGHTS)
    low = np.where(cells.high >= QUARTER, 0.0, np.maximum(low, 0.0))
    high = np.where(cells.low == 0.0, 1.0, np.minimum(high, 1.0))
    north = cells.hemisphere > 0.0
    return np.where(north, low, -high), np.where(north, high, -low)


def _height(alpha: float, Z: FloatArray, G: FloatArray, v: FloatArray) -> FloatArray:
    sine, cosine = np.sin(v), np.cos(v)
    square = cosine * cosine
    log_sine = np.where(square < 0.5, 0.5 * np.log1p(-square), np.log(sine))
    found: FloatArray = np.sqrt(Z * Z * square - G * G * np.expm1(2.0 * alpha * log_sine))
    return found


def _equator(alpha: Fraction, logarithm: FloatArray) -> tuple[Bounds, Bounds]:
    """Return bounds of Z and of G for one λ each."""
    a = float(alpha)
    with np.errstate(all="ignore"):
        u = np.minimum(0.0, logarithm)
        for _ in range(100):
            first, second = np.exp(2.0 * u), np.exp(2.0 * a * (u - logarithm))
            step = (first + second - 1.0) / (2.0 * first + 2.0 * a * second)
            u = u - step
            if np.all(~(np.abs(step) > 1e-15 * np.maximum(1.0, np.abs(u)))):
                break
        first, second = np.exp(2.0 * u), np.exp(2.0 * a * (u - logarithm))
        # Errors of the exponents: those of their parts, relative 2^-51, and one of e^x itself.
        one = 2.0**-49 * (1.0 + np.abs(u))
        two = 2.0**-49 * (1.0 + 2.0 * a * (np.abs(u) + np.abs(logarithm)))
        slope = 2.0 * first + 2.0 * a * second
        radius = 8.0 * (first * one + second * two + 2.0**-50) / slope + 2.0**-50 * np.abs(u)
        below, above = _defect(a, u - radius, logarithm, 1.0), _defect(a, u + radius, logarithm, -1.0)
        is_proved = (below < 0.0) & (above > 0.0)
        spread = radius + one
        Z = np.exp(u) * np.exp(-spread), np.minimum(np.exp(u) * np.exp(spread), 1.0)
        spread = a * radius + two
        size = np.exp(a * (u - logarithm))
        G = size * np.exp(-spread), np.minimum(size * np.exp(spread), 1.0)
    unknown = np.where(is_proved, 0.0, np.nan)
    return (Z[0] + unknown, Z[1] + unknown), (G[0] + unknown, G[1] + unknown)


def _defect(alpha: float, u: FloatArray, logarithm: FloatArray, side: float) -> FloatArray:
    """Return an upper (side 1) or lower (-1) bound of e^{2u} + e^{2α(u − log λ)} − 1."""
    one = 2.0**-49 * (1.0 + np.abs(u))
    two = 2.0**-49 * (1.0 + 2.0 * alpha * (np.abs(u) + np.abs(logarithm)))
    found: FloatArray = (
        np.exp(2.0 * u) * (1.0 + side * one)
        + np.exp(2.0 * alpha * (u - logarithm)) * (1.0 + side * two)
        - 1.0
        + side * 2.0**-50
    )
    return found
