"""Doubles that guide a proof: the loop of a planar motion in them, and whether an arc has exactly one start.

They decide the latter where they can; the loop is no part of the proof.
"""

from fractions import Fraction
from functools import cache
from math import nan, sin
from typing import NamedTuple

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.formula.algebras.real import RealAlgebra
from service.dynamics.formula.tape import Tape
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.geometry.point import REALS, make_equator, place_of
from service.dynamics.reduction.window import (
    Arc,
    EndKind,
    StartingPoint,
    StartOutsideWindowError,
    Window,
    starting_point,
)
from service.dynamics.solution.dense_output import chebyshev_coefficients, chebyshev_points
from workers.solvers.certified.phase import LibrationPhase, RotationPhase

FloatArray = NDArray[np.float64]


UNKNOWN = (nan, nan)
OUTER_Y = 4.0
CENTRES = (-0.75, -0.25, 0.25, 0.75)
"""Centres of the quarters of a panel."""
EDGES = (-13.0, -10.0, -8.0, -6.0, -5.0, *(0.5 * k for k in range(-8, 9)), 5.0, 6.0, 8.0, 10.0, 13.0)
"""Edges of the panels of y, v = 2 arctan e^y: beyond, the scan has found a power law."""
PANEL_DEGREE = 14
_OUTER = [0.5 * k for k in range(8, 21)] + [11.0, 12.0, 13.0]
SCANNED = np.array([-y for y in _OUTER[::-1]] + [0.2 * k for k in range(-19, 20)] + _OUTER)
"""The y at which the scan looks at P; it may look at more."""
MAX_RELATIVE_TAIL = 1e-6
"""Tail of a series, against its largest term, that is too much."""
OUTWEIGHING_RATIO = 1.0001
"""The first coefficient outweighs the others clearly, whatever the tail."""


class QuietReals(RealAlgebra):
    """The same numbers where warnings are off already, in less time."""

    def add(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """Return left + right."""
        return left + right

    def subtract(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """Return left - right."""
        return left - right

    def multiply(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """Return left · right."""
        return left * right

    def power(self, base: FloatArray, exponent: Fraction) -> FloatArray:
        """Return base^exponent."""
        if exponent.denominator == 1 and exponent.numerator in (2, 3):
            return base * base if exponent.numerator == 2 else base * base * base
        return super().power(base, exponent)


_REALS = QuietReals()


def room(
    loop: Loop, tape: Tape, h: arb, sine: FloatArray, cosine: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return N = h − V, |g1/g3| and c at places with sin v ≠ 0; numpy's warnings must be off."""
    Z, G, alpha = (np.asarray(float(each)) for each in (loop.Z, loop.G, loop.alpha))
    first, height, third, c = place_of(REALS, sine, cosine, make_equator(Z, G, alpha))
    gamma = loop.g1_sign * first, height, third
    V = tape.evaluate(_REALS, gamma[::-1] if loop.mirrored else gamma)
    return np.broadcast_to(float(h) - V, sine.shape), np.abs(first / third), c


def rates(phase: LibrationPhase | RotationPhase, count: int) -> FloatArray:
    """Return dt/dθ, but for a factor, at equidistant θ halfway between multiples of 2π/count."""
    theta = (np.arange(count) + 0.5) * (2.0 * np.pi / count)
    curve, loop = phase.curve, phase.curve.loop
    if isinstance(phase, RotationPhase):
        v, product = float(phase.origin) + phase.direction * theta, np.ones(count)
    else:
        lower, upper = float(phase.lower), float(phase.upper)
        v = lower + (upper - lower) * np.sin(theta / 2.0) ** 2
        product = (0.5 * (upper - lower) * np.sin(theta)) ** 2
    with np.errstate(all="ignore"):
        # What is beyond doubles is infinite, and so are the rates that nobody takes for known then.
        N, ratio, c = room(loop, curve.tape, curve.h, np.sin(v), np.cos(v))
        steep = 1.0 + float(loop.A / loop.C) * ratio * ratio
        return np.asarray(np.sqrt(steep * product / (c * c * N)))


def start_on(arc: Arc, motion: PlanarMotion) -> StartingPoint | None:
    """Return the start on a periodic arc, whose ends may be in doubt; None if it is not on the arc."""
    reached: EndKind = "equator" if arc.is_whole_loop or arc.equators else "rest"
    try:
        return starting_point(Window(0, "periodic", ("rest", reached), UNKNOWN, UNKNOWN, (arc,)), motion)
    except StartOutsideWindowError:
        return None


def is_the_only_one(arc: Arc, h: arb) -> bool:
    """Say whether doubles, looking closely, see no other window than the scan that chose the arc."""
    middle = 0.5 * (float(arc.lower) + float(arc.upper))
    halves = (1, -1) if passes_pole(arc) else (1 if sin(middle) > 0.0 else -1,)
    return all(_saw_every_zero(arc.loop, h, half) for half in halves)


def passes_pole(arc: Arc) -> bool:
    """Say whether motions on the arc go through a pole."""
    return arc.is_whole_loop or bool(arc.poles)


def _saw_every_zero(loop: Loop, h: arb, g3_sign: int) -> bool:
    """Say whether N = h − V changes sign at the places of the scan as often as it has zeros.

    It has as many as its Chebyshev series, which resolve it, on panels of y, v = 2 arctan e^y.
    """
    places, count = _places(), len(SCANNED)
    with np.errstate(all="ignore"):
        N = room(loop, loop.potential.tape, h, g3_sign * places.sine, places.cosine)[0]
        changes = int(np.count_nonzero(N[1:count] * N[: count - 1] < 0.0))
        # Power laws at the poles are levelled, which moves no zero.
        powers = np.log(N[1] / N[0]) * places.north + np.log(N[count - 2] / N[count - 1]) * places.south
        levelled = (N * np.exp(powers))[count:].reshape(PANEL_DEGREE + 1, -1)
        return changes == _zeros(places.matrix @ levelled)


def _zeros(series: FloatArray) -> int | None:
    """Return the number of zeros of Chebyshev series (columns) side by side; None if it is in doubt."""
    sizes = np.abs(series)
    if not np.all(sizes[-3:].max(axis=0) <= MAX_RELATIVE_TAIL * sizes.max(axis=0)):
        return None
    unclear = _quarters() @ series[:, _may_vanish(series)]
    # Axis 0: quarters.
    parts = np.concatenate(tuple(unclear), axis=1)
    parts = parts[:, _may_vanish(parts)]
    first, second = (derivative @ parts for derivative in _derivatives())
    left, right = (np.where(np.arange(PANEL_DEGREE + 1) % 2, sign, 1.0) @ parts for sign in (-1.0, 1.0))
    crosses = left * right < 0.0
    # Monotone, or bent to one side between different signs: then no more than is seen.
    if not np.all(~_may_vanish(first) | (~_may_vanish(second) & crosses)):
        return None
    return int(crosses.sum())


def _may_vanish(series: FloatArray) -> NDArray[np.bool_]:
    """Say of which series the first coefficient does not outweigh the others."""
    sizes = np.abs(series)
    return np.asarray(2.0 * sizes[0] <= OUTWEIGHING_RATIO * sizes.sum(axis=0))


class _Places(NamedTuple):
    """SCANNED, and the nodes of all panels, node by node."""

    sine: FloatArray
    cosine: FloatArray
    north: FloatArray
    south: FloatArray
    """How far they are beyond OUTER_Y."""
    matrix: FloatArray
    """Takes values on panels to series."""


@cache
def _places() -> _Places:
    edges = np.array(EDGES)
    nodes = 0.5 * ((edges[1:] + edges[:-1]) + np.diff(edges) * chebyshev_points(PANEL_DEGREE)[:, None])
    y = np.concatenate((SCANNED, nodes.ravel()))
    north, south = (np.maximum(sign * y - OUTER_Y, 0.0) for sign in (-1.0, 1.0))
    matrix = chebyshev_coefficients(np.eye(PANEL_DEGREE + 1))
    return _Places(1.0 / np.cosh(y), -np.tanh(y), north, south, matrix)


@cache
def _quarters() -> FloatArray:
    """Return the matrices from a series to those of the four quarters of its panel."""
    to_series = chebyshev_coefficients(np.eye(PANEL_DEGREE + 1))
    points = 0.25 * chebyshev_points(PANEL_DEGREE)
    values = (np.polynomial.chebyshev.chebvander(points + centre, PANEL_DEGREE) for centre in CENTRES)
    return np.stack([to_series @ each for each in values])


@cache
def _derivatives() -> tuple[FloatArray, FloatArray]:
    """Return the matrices from a series to those of its first and second derivatives."""
    one, two = (np.polynomial.chebyshev.chebder(np.eye(PANEL_DEGREE + 1), order) for order in (1, 2))
    return np.asarray(one), np.asarray(two)
