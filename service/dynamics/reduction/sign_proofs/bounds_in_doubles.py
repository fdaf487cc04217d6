r"""Proves the sign of p² on whole stretches of many loops at once, in outward-rounded doubles.

A cell is a stretch 0 ≤ v₋ < v ≤ v₊ ≤ π/2 of the northern or southern quarter of a half loop. On it
|g3| = Z s and |g1| = G s^α are powers of s = sin v, and g2 falls as v grows: their bounds are those at
the ends. D = g1 V_3 − g3 V_1, whose sign is that of p² up to the signs of g1 and g3, is evaluated in
:class:`.IntervalAlgebra` with s as a scale. So a cell may begin at the pole itself, where D is known by
its leading power. What the bounds leave open is halved.

Z and G are bounded from where loops cross the equator, for single λ and for stretches of λ.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.intervals import (
    Bounds,
    Interval,
    IntervalAlgebra,
    power_error,
    real_power,
    widened,
)
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.tape import Tape
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.point import REALS, make_equator, place_of

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
QUARTER_TURN = 0.5 * np.pi
"""The equator, just below π/2; a cell that ends here includes it."""
VALUE_RELATIVE_ERROR = 2.0**-49
HEIGHT_RELATIVE_ERROR = 2.0**-45
"""More than the relative error of |g2|: 2α log s is off by some 2^-50 of it, hence 1 − s^2α by no more."""
CELL_MIN_RELATIVE_WIDTH = 1e-11
"""Relative width of a cell that is not halved any more."""
NEAREST_POLE_DISTANCE = 1e-60
"""A cell at the pole that ends here is not cut again: no single term of D leads there."""
MAX_CELLS = 2048
"""Largest number of cells of one loop at a time."""
NUMBERS_IN_MEMORY = 4_000_000
"""Largest number of numbers in memory at a time."""


@dataclass(frozen=True, slots=True)
class Shape:
    """The common data of the loops of a body and the signs of a motion; primed axes, as in :mod:`.loop`."""

    alpha: Fraction
    is_mirrored: bool
    first_sign: int
    """Sign of the primed g1."""
    third_sign: int
    """Sign of the primed g3."""


@dataclass(frozen=True, slots=True)
class Scaled:
    """Z and G as powers of a scale, λ or 1/λ, beside bounds of their coefficients: for stretches of λ."""

    scale: Bounds
    """Shape (loops,), as all the others; the lower one may be 0."""
    Z: Bounds
    G: Bounds
    Z_power: Fraction
    G_power: Fraction


@dataclass(frozen=True, slots=True)
class Loops:
    """Bounds of Z and G of each loop, and of the inputs that its formula has beside g1, g2, g3."""

    shape: Shape
    Z: Bounds
    G: Bounds
    inputs: tuple[FloatArray, ...] = ()
    """Numbers, each the double nearest to the one meant, shape (loops,)."""
    scaled: Scaled | None = None
    """Z and G for stretches of λ, if each loop represents one."""

    def at(self, chosen: IntArray) -> "Loops":
        """Return some of them."""

        def part(bounds: Bounds) -> Bounds:
            return bounds[0][chosen], bounds[1][chosen]

        scaled = self.scaled
        if scaled is not None:
            scaled = replace(scaled, scale=part(scaled.scale), Z=part(scaled.Z), G=part(scaled.G))
        inputs = tuple(numbers[chosen] for numbers in self.inputs)
        return Loops(self.shape, part(self.Z), part(self.G), inputs, scaled)


@dataclass(frozen=True, slots=True)
class Cells:
    """Stretches of loops, as arrays of one shape."""

    owner: IntArray
    """The number of the loop."""
    hemisphere: FloatArray
    """The sign of g2."""
    low: FloatArray
    high: FloatArray

    def at(self, chosen: BoolArray | IntArray | slice) -> "Cells":
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


def radicand_bounds(tape: Tape, loops: Loops, cells: Cells) -> Bounds:
    """Return bounds of p² on each cell, up to positive factors that vary there; NaN if there are none.

    The inputs of the tape are g1, g2, g3 and ``loops.inputs``.
    """
    # Every instruction leaves bounds of a value and of a slope behind.
    most = min(max(NUMBERS_IN_MEMORY // (4 * len(tape.instructions) + 4), 64), 8192)
    count = len(cells.owner)
    lo, hi = np.full(count, np.nan), np.full(count, np.nan)
    for start in range(0, count, most):
        here = slice(start, start + most)
        bounds = _radicand_bounds(tape, loops, cells.at(here))
        if bounds is not None:
            lo[here], hi[here] = bounds
    is_turned = (loops.shape.first_sign * loops.shape.third_sign < 0) != loops.shape.is_mirrored
    return (-hi, -lo) if is_turned else (lo, hi)


def _radicand_bounds(tape: Tape, loops: Loops, cells: Cells) -> Bounds | None:
    algebra = IntervalAlgebra(scales(loops, cells))
    first, third = axes(algebra, loops, cells)
    g1, g3 = (third, first) if loops.shape.is_mirrored else (first, third)
    inputs = [algebra.about(numbers[cells.owner]) for numbers in loops.inputs]
    return derivative_bounds(algebra, tape, (g1, algebra.interval(*heights(loops, cells)), g3), inputs)


def radicand_signs(tape: Tape, loops: Loops, cells: Cells) -> IntArray:
    """Return for each cell the sign that p² certainly has all over it, 0 if that is not known."""
    lo, hi = radicand_bounds(tape, loops, cells)
    known: IntArray = ((lo > 0.0) & (hi >= lo)).astype(np.int64) - ((hi < 0.0) & (lo <= hi))
    return known


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


def have_no_motion(
    tape: Tape,
    loops: Loops,
    most_cells: int = MAX_CELLS,
    narrowest: FloatArray | None = None,
    should_stop: Callable[[], bool] = lambda: False,
) -> BoolArray:
    """Tell for each loop whether p² < 0 on the whole half is proved, with so many cells at a time.

    Cells of a loop are not halved below the relative width ``narrowest``. False is no claim: there
    may be a motion, the bounds do not decide, or it was stopped.
    """
    narrowest = np.full(len(loops.Z[0]), CELL_MIN_RELATIVE_WIDTH) if narrowest is None else narrowest
    is_known = ~np.isnan(loops.Z[0]) & ~np.isnan(loops.G[0])

    def signs(cells: Cells) -> IntArray:
        return radicand_signs(tape, loops, cells)

    return all_negative(signs, is_known, narrowest, most_cells, should_stop)


def all_negative(
    signs_of: Callable[[Cells], IntArray],
    asked: BoolArray,
    narrowest: FloatArray,
    most_cells: int = MAX_CELLS,
    should_stop: Callable[[], bool] = lambda: False,
) -> BoolArray:
    """Tell for which of the loops ``asked`` a sign is -1 all over the half; see :func:`have_no_motion`.

    ``signs_of`` returns for each cell the sign that there certainly is, 0 if that is not known.
    """
    count, open_loops = len(asked), asked.copy()
    cells = _quarters(np.flatnonzero(open_loops))
    while len(cells.owner):
        if should_stop():
            open_loops[cells.owner] = False
            break
        signs = signs_of(cells)
        undecided = signs == 0
        given_up = undecided & np.where(
            cells.low > 0.0,
            cells.high - cells.low < narrowest[cells.owner] * cells.high,
            cells.high < NEAREST_POLE_DISTANCE,
        )
        open_loops[cells.owner[(signs > 0) | given_up]] = False
        crowded = np.bincount(cells.owner[undecided], minlength=count) > most_cells
        open_loops[crowded] = False
        cells = cells.at(undecided & open_loops[cells.owner]).halves()
    return open_loops


def _quarters(owners: IntArray) -> Cells:
    """Return the quarters of half loops, north and south, each a cell."""
    both = np.concatenate([owners, owners])
    hemisphere = np.repeat([1.0, -1.0], len(owners))
    return Cells(both, hemisphere, np.zeros(len(both)), np.full(len(both), QUARTER_TURN))


def sines(cells: Cells) -> Bounds:
    """Return bounds of |sin v| on every cell."""
    low = np.sin(cells.low) * (1.0 - VALUE_RELATIVE_ERROR)
    return low, np.where(
        cells.high >= QUARTER_TURN, 1.0, np.minimum(np.sin(cells.high) * (1.0 + VALUE_RELATIVE_ERROR), 1.0)
    )


def scales(loops: Loops, cells: Cells) -> list[Bounds]:
    """Return what the powers of an algebra are to be of: s, and λ where a loop stands for a stretch of it."""
    found, of = [sines(cells)], cells.owner
    if loops.scaled is not None:
        found.append((loops.scaled.scale[0][of], loops.scaled.scale[1][of]))
    return found


def axes(algebra: IntervalAlgebra, loops: Loops, cells: Cells) -> tuple[Interval, Interval]:
    """Return the primed g1 and g3 on every cell, in an algebra with these ``scales``."""
    shape, scaled, of = loops.shape, loops.scaled, cells.owner
    first_powers, third_powers = [shape.alpha], [Fraction(1)]
    Z, G = loops.Z, loops.G
    if scaled is not None:
        first_powers.append(scaled.G_power)
        third_powers.append(scaled.Z_power)
        Z, G = scaled.Z, scaled.G
    first = algebra.interval(G[0][of], G[1][of], tuple(first_powers))
    third = algebra.interval(Z[0][of], Z[1][of], tuple(third_powers))
    return (
        first if shape.first_sign > 0 else algebra.negate(first),
        third if shape.third_sign > 0 else algebra.negate(third),
    )


def heights(loops: Loops, cells: Cells) -> Bounds:
    """Return bounds of g2: |g2| = cos v √(Z² + G² R), R = (1 − s^2α)/cos² v, falls as v grows."""
    return heights_of(float(loops.shape.alpha), loops.Z, loops.G, cells)


def heights_of(alpha: float | FloatArray, Z: Bounds, G: Bounds, cells: Cells) -> Bounds:
    """Return what :func:`heights` does; α is that of all loops, or of each cell."""
    of = cells.owner
    with np.errstate(all="ignore"):
        low = _height(alpha, Z[0][of], G[0][of], cells.high) * (1.0 - HEIGHT_RELATIVE_ERROR)
        high = _height(alpha, Z[1][of], G[1][of], cells.low) * (1.0 + HEIGHT_RELATIVE_ERROR)
    low = np.where(cells.high >= QUARTER_TURN, 0.0, np.maximum(low, 0.0))
    high = np.where(cells.low == 0.0, 1.0, np.minimum(high, 1.0))
    north = cells.hemisphere > 0.0
    return np.where(north, low, -high), np.where(north, high, -low)


def _height(alpha: float | FloatArray, Z: FloatArray, G: FloatArray, v: FloatArray) -> FloatArray:
    return place_of(REALS, np.sin(v), np.cos(v), make_equator(Z, G, np.asarray(alpha)))[1]


def equators(alpha: Fraction | FloatArray, low: FloatArray, high: FloatArray) -> tuple[Bounds, Bounds]:
    """Return bounds of Z and G for every λ (primed) with ``low`` ≤ log λ ≤ ``high``; NaN if not found.

    α is the same for all, or there is the double nearest to that of each.
    F(u) = e^{2u} + e^{2α(u − log λ)} − 1 grows with u = log Z: its signs on both sides of a zero
    that Newton's steps found enclose it.
    """
    (z_low, g_high), (z_high, g_low) = _equator(alpha, low), _equator(alpha, high)
    return (z_low[0], z_high[1]), (g_low[0], g_high[1])


def loops_of_stretches(shape: Shape, low: FloatArray, high: FloatArray, *, is_inverse: bool) -> Loops:
    """Return the loops of all primed λ with ``low`` < k < ``high`` ≤ 1, k being λ, or 1/λ if ``is_inverse``.

    Where λ → 0, Z is like λ and G → 1; where λ → ∞, G is like λ^-α and Z → 1. The lower end may be 0.
    """
    with np.errstate(divide="ignore"):
        error = 2.0**-50 * (1.0 + np.abs(np.log(high)))
        logarithms = np.log(np.where(low > 0.0, low, high)), np.log(high)
    first, last = logarithms[0] - error - 2.0**-50 * np.abs(logarithms[0]), logarithms[1] + error
    Z, G = equators(shape.alpha, -last, -first) if is_inverse else equators(shape.alpha, first, last)
    at_end = low == 0.0
    if is_inverse:
        Z, G = (Z[0], np.where(at_end, 1.0, Z[1])), (np.where(at_end, 0.0, G[0]), G[1])
        coefficients = _powers(Z, shape.alpha)
        scaled = Scaled((low, high), Z, coefficients, Fraction(0), shape.alpha)
    else:
        Z, G = (np.where(at_end, 0.0, Z[0]), Z[1]), (G[0], np.where(at_end, 1.0, G[1]))
        coefficients = _powers(G, 1 / shape.alpha)
        scaled = Scaled((low, high), coefficients, G, Fraction(1), Fraction(0))
    return Loops(shape, Z, G, scaled=scaled)


def _powers(bounds: Bounds, exponent: Fraction) -> Bounds:
    """Return bounds of a power of a number between 0 and 1."""
    low, high = real_power(bounds[0], exponent), real_power(bounds[1], exponent)
    low, high = widened(low, high, power_error(exponent))
    return np.maximum(low, 0.0), np.minimum(high, 1.0)


def _equator(alpha: Fraction | FloatArray, logarithm: FloatArray) -> tuple[Bounds, Bounds]:
    """Return bounds of Z and of G for one λ each."""
    a = float(alpha) if isinstance(alpha, Fraction) else alpha
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


def _defect(alpha: float | FloatArray, u: FloatArray, logarithm: FloatArray, side: float) -> FloatArray:
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
