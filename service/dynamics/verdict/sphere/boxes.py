r"""Rational points of the sphere, and boxes that cover it, with bounds of the parts of a formula on each.

A box is a stretch of latitudes and one of angles about the second axis in one octant,
g = (ε1 cos θ cos φ, ε2 sin θ, ε3 cos θ sin φ) with θ and φ from 0 to π/2: g1, g2 and g3 are monotonic
in both.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import product
from math import tan

import numpy as np
from numpy.typing import NDArray

from service.dynamics.formula.algebras.intervals import Interval, IntervalAlgebra
from service.dynamics.formula.tape import Tape
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import QUARTER_TURN

Point = tuple[Fraction, Fraction, Fraction]
# (a, b, c, d) with a² + b² + c² = d² and no two ratios alike: in general
# position to each other and to coordinate planes, diagonals and rational cones.
_QUADRUPLES = (
    (2, 6, 3, 7),
    (4, 8, 1, 9),
    (6, 2, 9, 11),
    (12, 4, 3, 13),
    (8, 9, 12, 17),
    (6, 10, 15, 19),
)
_OCTANTS = (
    (1, 1, 1),
    (-1, 1, -1),
    (1, -1, -1),
    (-1, -1, 1),
    (-1, 1, 1),
    (1, 1, -1),
    (1, -1, 1),
    (-1, -1, -1),
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def sphere_points() -> Iterator[Point]:
    """Yield 48 points of moderate height, every octant among the first 8 and six times in all.

    The k-th visit of an octant brings another quadruple, so that 8 successive
    points do not lie on one cone.
    """
    return iter(_points_of_octants())


@cache
def _points_of_octants() -> tuple[Point, ...]:
    found = []
    for visit in range(len(_QUADRUPLES)):
        for number, signs in enumerate(_OCTANTS):
            a, b, c, d = _QUADRUPLES[(visit + number) % len(_QUADRUPLES)]
            found.append((Fraction(signs[0] * a, d), Fraction(signs[1] * b, d), Fraction(signs[2] * c, d)))
    return tuple(found)


def fine_sphere_points(steps: int = 9) -> Iterator[Point]:
    """Yield points all over the sphere, close to the axes too: for formulas that are defined on small parts.

    Stereographic images of a grid of ``4 steps²`` points in the square
    -1 < u, v < 1, from both ends of the first axis; no grid point is on an axis.
    """
    halves = [Fraction(2 * k + 1, 2 * steps) for k in range(steps)]
    for u_size in halves:
        for v_size in halves:
            # A little more than v, to keep |g2| = |g3| out.
            v_size += Fraction(1, 40 * steps)
            norm = 1 + u_size**2 + v_size**2
            first, second, third = (2 - norm) / norm, 2 * u_size / norm, 2 * v_size / norm
            for signs in _OCTANTS:
                yield (signs[0] * first, signs[1] * second, signs[2] * third)


FIRST_STRETCHES = 8
"""Stretches of a quarter turn to begin with."""
SINE_ERROR = 2.0**-48
"""More than the error of a sine or cosine of numpy, and of the rounding of π/2."""


@dataclass(frozen=True, slots=True)
class Boxes:
    """Arrays of one shape, ``octant`` besides with a last axis of three signs."""

    octant: FloatArray
    theta_low: FloatArray
    theta_high: FloatArray
    phi_low: FloatArray
    phi_high: FloatArray

    def __len__(self) -> int:
        return len(self.theta_low)

    def at(self, chosen: NDArray[np.bool_] | IntArray) -> "Boxes":
        """Return some of them."""
        return Boxes(
            self.octant[chosen],
            self.theta_low[chosen],
            self.theta_high[chosen],
            self.phi_low[chosen],
            self.phi_high[chosen],
        )

    def quarters(self) -> "Boxes":
        """Return the four parts of each."""
        theta, phi = 0.5 * (self.theta_low + self.theta_high), 0.5 * (self.phi_low + self.phi_high)
        thetas = ((self.theta_low, theta), (theta, self.theta_high))
        phis = ((self.phi_low, phi), (phi, self.phi_high))
        parts = list(product(thetas, phis))
        return Boxes(
            np.concatenate([self.octant] * 4),
            np.concatenate([t[0] for t, _ in parts]),
            np.concatenate([t[1] for t, _ in parts]),
            np.concatenate([f[0] for _, f in parts]),
            np.concatenate([f[1] for _, f in parts]),
        )

    def points(self, theta: float, phi: float) -> "Boxes":
        """Return one point of each box, at these shares of its sides, as boxes of no size."""
        theta_at = self.theta_low + theta * (self.theta_high - self.theta_low)
        phi_at = self.phi_low + phi * (self.phi_high - self.phi_low)
        return Boxes(self.octant, theta_at, theta_at, phi_at, phi_at)

    def middle(self, index: int) -> Point:
        """Return a rational point exactly on the sphere at the middle of a box."""
        signs = self.octant[index]
        theta = 0.5 * float(self.theta_low[index] + self.theta_high[index])
        phi = 0.5 * float(self.phi_low[index] + self.phi_high[index])
        return rational_point((int(signs[0]), int(signs[1]), int(signs[2])), theta, phi)


def rational_point(signs: tuple[int, int, int], theta: float, phi: float) -> Point:
    """Return the point of an octant at these angles, with the tangents of their halves rounded."""
    t, u = Fraction(tan(0.5 * theta)), Fraction(tan(0.5 * phi))
    return point_of_tangents(signs, t, u)


def point_of_tangents(signs: tuple[int, int, int], t: Fraction, u: Fraction) -> Point:
    """Return the point with tan(θ/2) = t and tan(φ/2) = u."""
    cosine, sine = (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)
    first, third = (1 - u * u) / (1 + u * u), 2 * u / (1 + u * u)
    return signs[0] * cosine * first, signs[1] * sine, signs[2] * cosine * third


def whole_sphere() -> Boxes:
    """Return boxes that cover the sphere."""
    edges = np.linspace(0.0, QUARTER_TURN, FIRST_STRETCHES + 1)
    # The last edge is rounded: the bounds of sine and cosine there are widened by more.
    rows = [
        (signs, edges[i], edges[i + 1], edges[j], edges[j + 1])
        for signs in product((1.0, -1.0), repeat=3)
        for i in range(FIRST_STRETCHES)
        for j in range(FIRST_STRETCHES)
    ]
    return Boxes(
        np.array([row[0] for row in rows]),
        np.array([row[1] for row in rows]),
        np.array([row[2] for row in rows]),
        np.array([row[3] for row in rows]),
        np.array([row[4] for row in rows]),
    )


class DomainIntervals(IntervalAlgebra):
    """Intervals of what a formula is wherever it has a value: roots and logarithms of what is ≥ 0."""

    def power(self, base: Interval, exponent: Fraction) -> Interval:
        """Return base^exponent."""
        if exponent.denominator > 1:
            base = _positive(base)
        return super().power(base, exponent)

    def call(self, name: str, argument: Interval) -> Interval:
        """Return the function."""
        return super().call(name, _positive(argument) if name == "log" else argument)


def _positive(x: Interval) -> Interval:
    # Where all of it is negative there is no value: NaN.
    hi = np.where(x.hi >= 0.0, x.hi, np.nan)
    return Interval(np.where(np.isnan(x.lo), np.nan, np.maximum(x.lo, 0.0)), hi, x.exponents, 1)


@np.errstate(all="ignore")
def bounds_on(boxes: Boxes, tape: Tape, registers: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Return lower and upper bounds of some registers, shape (registers, boxes); NaN where there are none.

    They hold wherever what precedes the register has a value.
    """
    algebra = DomainIntervals(())
    return bounds_of(algebra, _axes(algebra, boxes), tape, registers, len(boxes))


@np.errstate(all="ignore")
def bounds_of(
    algebra: IntervalAlgebra, axes: Sequence[Interval], tape: Tape, registers: Sequence[int], count: int
) -> tuple[FloatArray, FloatArray]:
    """Return the same where g1, g2 and g3 are between these bounds, each of shape (count,)."""
    values = list(axes)
    for instruction in tape.instructions:
        single = Tape(tuple(map(str, range(len(values)))), (instruction,), len(values))
        values.append(single.evaluate(algebra, values))
    shape = (count,)
    found = [algebra.bounds(values[register]) for register in registers]
    low = [np.broadcast_to(lo, shape) for lo, _ in found]
    high = [np.broadcast_to(hi, shape) for _, hi in found]
    return np.array(low).reshape(len(registers), *shape), np.array(high).reshape(len(registers), *shape)


def _axes(algebra: IntervalAlgebra, boxes: Boxes) -> tuple[Interval, Interval, Interval]:
    def between(low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.maximum(low - SINE_ERROR, 0.0), np.minimum(high + SINE_ERROR, 1.0)

    across = between(np.cos(boxes.theta_high), np.cos(boxes.theta_low))
    first = between(np.cos(boxes.phi_high), np.cos(boxes.phi_low))
    third = between(np.sin(boxes.phi_low), np.sin(boxes.phi_high))
    sizes = (
        between(across[0] * first[0], across[1] * first[1]),
        between(np.sin(boxes.theta_low), np.sin(boxes.theta_high)),
        between(across[0] * third[0], across[1] * third[1]),
    )
    return tuple(  # type: ignore[return-value]
        algebra.interval(
            np.where(sign > 0.0, low, -high),
            np.where(sign > 0.0, high, -low),
        )
        for (low, high), sign in zip(sizes, boxes.octant.T, strict=True)
    )
