"""Classifies cells of half a loop by bounds in doubles: sign of P known, P monotone, or neither."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.intervals import Interval, IntervalAlgebra
from service.dynamics.formula.tape import Tape
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.geometry.pole_form import pole_forms
from service.dynamics.reduction.geometry.slopes import derivatives_along
from service.dynamics.reduction.geometry.tight_form import tight_form
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import (
    Bounds,
    Cells,
    Loops,
    Shape,
    axes,
    heights,
    scales,
)

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

FAINT_VALUE = 1e-300
"""Below it a double is next to 0, and smaller cells do not help."""


class _DomainIntervals(IntervalAlgebra):
    """Intervals that remember where a root or a logarithm certainly has no value."""

    def __init__(self, scales: Sequence[Bounds]) -> None:
        super().__init__(scales)
        self.is_undefined: BoolArray = np.zeros((), dtype=np.bool_)

    def power(self, base: Interval, exponent: Fraction) -> Interval:
        """Return base^exponent."""
        if exponent.denominator > 1 and base.sign <= 0:
            self.is_undefined = self.is_undefined | (base.hi < 0.0)
        return super().power(base, exponent)

    def call(self, name: str, argument: Interval) -> Interval:
        """Return the function."""
        if name == "log" and argument.sign <= 0:
            self.is_undefined = self.is_undefined | (argument.hi < 0.0)
        return super().call(name, argument)


@dataclass(frozen=True)
class Curves:
    """Half loops of one potential, 0 < v < π on the side of one sign of g3, of single λ or stretches."""

    tape: Tape
    body: RigidBody
    """In the axes of the client."""
    loops: Loops
    turn: int
    """The sign of P / D."""


@dataclass(frozen=True)
class Half(Curves):
    """One half of one loop, with Z and G in doubles."""

    loop: Loop
    g3_sign: int
    """Sign of the primed g3."""

    @cached_property
    def pole_forms(self) -> dict[int, tuple[Tape, Tape]]:
        """Return the tape as it is next to each pole, g2 = 1 and −1."""
        return {sigma: pole_forms(self.tape, sigma) for sigma in (1, -1)}


@dataclass(frozen=True, slots=True)
class CellSigns:
    """The results for each cell, as arrays."""

    sign: IntArray
    """Sign that P certainly has all over the cell; 0 if it is not known."""
    slope: IntArray
    """Sign that dP/dv certainly has, but for a positive factor of P; 0 if it is not known."""
    is_undefined: BoolArray
    """P certainly has no value anywhere on it."""
    is_faint: BoolArray
    """The bounds are so small that doubles lose them."""


def half_of(loop: Loop, tape: Tape, g3_sign: int) -> Half:
    """Return the half of the loop where the primed g3 has this sign."""
    shape = Shape(loop.alpha, loop.mirrored, loop.g1_sign, g3_sign)
    A, C = (loop.C, loop.A) if loop.mirrored else (loop.A, loop.C)
    loops = Loops(shape, _bounds(loop.Z), _bounds(loop.G))
    is_turned = (loop.g1_sign * g3_sign < 0) != loop.mirrored
    return Half(
        tape=tight_form(tape),
        body=RigidBody(A, None, C, allow_unphysical=True),
        loops=loops,
        turn=-1 if is_turned else 1,
        loop=loop,
        g3_sign=g3_sign,
    )


def signs_on_cells(curves: Curves, cells: Cells, *, with_slope: bool) -> CellSigns:
    """Return what bounds say of the cells."""
    algebra = _DomainIntervals(scales(curves.loops, cells))
    g = _places(algebra, curves.loops, cells)
    with np.errstate(all="ignore"):
        D, *slopes = derivatives_along(algebra, curves.tape, curves.body, g, 1 if with_slope else 0)
    shape = cells.low.shape
    at_pole = cells.low == 0.0
    slope = _signs(slopes[0], shape, at_pole) * curves.turn if slopes else np.zeros(shape, dtype=np.int64)
    is_undefined = np.broadcast_to(algebra.is_undefined, shape)
    return CellSigns(_signs(D, shape, at_pole) * curves.turn, slope, is_undefined, _are_faint(D, shape))


def derivative_values(curves: Curves, cells: Cells, order: int) -> list[Bounds]:
    """Return bounds of D, X D, … up to this order on each cell, times the sign of P / D; NaN for none."""
    algebra = IntervalAlgebra(scales(curves.loops, cells))
    g = _places(algebra, curves.loops, cells)
    zero = algebra.constant(Fraction(0))
    with np.errstate(all="ignore"):
        found = derivatives_along(algebra, curves.tape, curves.body, g, order)
        values = [algebra.bounds(zero if each is None else each) for each in found]
    shape = cells.low.shape
    full = [(np.broadcast_to(lo, shape), np.broadcast_to(hi, shape)) for lo, hi in values]
    return full if curves.turn > 0 else [(-hi, -lo) for lo, hi in full]


def _places(algebra: IntervalAlgebra, loops: Loops, cells: Cells) -> tuple[Interval, Interval, Interval]:
    """Return g1, g2 and g3 on each cell, in the client's axes."""
    first, third = axes(algebra, loops, cells)
    g1, g3 = (third, first) if loops.shape.is_mirrored else (first, third)
    return g1, algebra.interval(*heights(loops, cells)), g3


def _signs(element: Interval | None, shape: tuple[int, ...], at_pole: BoolArray) -> IntArray:
    if element is None:
        return np.zeros(shape, dtype=np.int64)
    # Written so that NaN is no sign. What is not bounded may be infinite inside, where a sign says nothing of
    # zeros; at a pole it is known by its leading power.
    is_ordered = (element.lo <= element.hi) & (at_pole | (np.isfinite(element.lo) & np.isfinite(element.hi)))
    signs = ((element.lo > 0.0) & is_ordered).astype(np.int64) - ((element.hi < 0.0) & is_ordered)
    return np.broadcast_to(signs, shape)


def _are_faint(element: Interval | None, shape: tuple[int, ...]) -> BoolArray:
    if element is None:
        return np.zeros(shape, dtype=np.bool_)
    return np.broadcast_to((element.lo > -FAINT_VALUE) & (element.hi < FAINT_VALUE), shape)


def _bounds(ball: arb) -> Bounds:
    low, high = float(ball.lower()), float(ball.upper())
    # A ball's end is rounded to the nearest double.
    lower, upper = np.nextafter(low, -np.inf), np.nextafter(high, np.inf)
    return np.array([max(lower, 0.0)]), np.array([min(upper, 1.0)])
