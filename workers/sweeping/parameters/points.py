"""The numbers of neighbouring points: those on the axes, and those in which the potential is linear."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.monomials import as_fmpq, as_fraction
from service.dynamics.problem import PlanarMotion, TimePeriods, Times, TimeSpan
from service.dynamics.sweep_axes import ListedAxis
from service.schemas.reading.numbers import LARGEST, LATEST
from service.schemas.sweep.sweep import Sweep, SweepAxis
from workers.sweeping.parameters.coefficients import Coefficients
from workers.sweeping.parameters.templates import double_of

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
ListedNumbers = Sequence[Mapping[float, fmpq | None]]
"""The result of :func:`listed_exactly` for each axis."""


class SweptPoints:
    """The numbers on the axes at some points, as doubles and exactly."""

    def __init__(self, sweep: Sweep, known: ListedNumbers, indices: IntArray) -> None:
        self.count = len(indices)
        self.doubles = np.stack(list(sweep.columns_at(indices).values()))
        self._sweep = sweep
        self._known = known
        self._indices = indices

    def exact(self, axis: int, index: int) -> fmpq:
        """Return the number on an axis at the ``index``-th point."""
        double = float(self.doubles[axis, index])
        known = self._known[axis]
        if double not in known:
            # A double means its shortest decimal.
            return fmpq(*Decimal(repr(double)).as_integer_ratio())
        exact = known[double]
        return as_fmpq(self._sweep.values(int(self._indices[index]))[axis]) if exact is None else exact

    def exact_row(self, index: int, axes: Sequence[int]) -> list[fmpq]:
        """Return the numbers on several axes."""
        return [self.exact(axis, index) for axis in axes]

    def sizes(self, axis: int | None, indices: IntArray) -> FloatArray | None:
        """Return the absolute values of the numbers on an axis at some points; None without an axis."""
        return None if axis is None else np.abs(self.doubles[axis, indices])

    def parameters(self, coefficients: Coefficients, axes: Sequence[int]) -> "Parameters":
        """Return the coefficients that the numbers on these axes make."""
        if coefficients.parts is None:
            return Parameters(self.doubles[list(axes)].T, lambda index: self.exact_row(index, axes))
        exact = [coefficients.at(self.exact_row(index, axes)) for index in range(self.count)]
        width = len(coefficients.paths)
        doubles = np.array(
            [[math.nan] * width if row is None else list(map(double_of, row)) for row in exact]
        )
        return Parameters(doubles.reshape(-1, width), lambda index: exact[index] or [])

    def have_moment(self, body: RigidBody, axis: int) -> BoolArray:
        """Tell at which points the body with the number on an axis as its B is one."""
        least, most = (
            (fmpq(0), None)
            if body.allow_unphysical
            else (as_fmpq(abs(body.A - body.C)), as_fmpq(body.A + body.C))
        )
        moments = [self.exact(axis, index) for index in range(self.count)]
        return np.array([B > 0 and least <= B and (most is None or most >= B) for B in moments])


def curves_of(
    points: SweptPoints, axis: int | None, sign: int, motion: PlanarMotion
) -> tuple[list[fmpq], IntArray]:
    """Return λ² and the sign of g1 at every point; the sign is 0 where λ or nu is not one.

    Without an ``axis`` they are those of ``motion``, which has the ``sign``.
    """
    if axis is None:
        return [as_fmpq(motion.lambda_squared)] * points.count, np.full(points.count, sign)
    values = [points.exact(axis, index) for index in range(points.count)]
    if motion.nu is not None:
        return [abs(value) for value in values], np.sign(points.doubles[axis]).astype(np.int64)
    return [value * value for value in values], np.where(points.doubles[axis] > 0.0, sign, 0)


def times_of(points: SweptPoints, axes: Mapping[str, int], time: Times) -> list[Times | None]:
    """Return the times of every point; None where they are none, or out of reach.

    ``axes`` are those of the numbers of ``time`` that vary, by their names.
    """
    if not axes:
        return [time] * points.count
    result: list[Times | None] = []
    for index in range(points.count):
        numbers = {name: as_fraction(points.exact(axis, index)) for name, axis in axes.items()}
        changed = replace(time, **numbers)  # type: ignore[arg-type,type-var,unused-ignore]
        if isinstance(changed, TimeSpan):
            is_usable = changed.start < changed.stop and max(-changed.start, changed.stop) <= LATEST
        else:
            is_usable = isinstance(changed, TimePeriods) and 0 < changed.periods <= LATEST
        result.append(changed if is_usable else None)
    return result


class Parameters:
    """The numbers in which a potential is linear, at neighbouring points."""

    def __init__(self, doubles: FloatArray, exact: Callable[[int], list[fmpq]]) -> None:
        self.doubles = doubles
        """Shape (points, parameters); NaN where they have no value."""
        self.exact = exact
        """Returns those of one point."""


def are_numbers(doubles: FloatArray) -> BoolArray:
    """Tell which rows have numbers that are all safely within the limits of documents."""
    sizes = np.abs(doubles)
    limit = float(LARGEST) / 2.0
    usable: BoolArray = ((sizes == 0.0) | ((sizes > 1.0 / limit) & (sizes < limit))).all(axis=1)
    return usable


def listed_exactly(axis: SweepAxis) -> dict[float, fmpq | None]:
    """Return listed numbers and ends that their doubles may not equal; None if two share a double."""
    if isinstance(axis.axis, ListedAxis):
        values = axis.axis.listed
    else:
        values = (axis.axis.value(0), axis.axis.value(axis.axis.length - 1))
    first: dict[float, Fraction] = {}
    shared = {double for value in values if first.setdefault(double := float(value), value) != value}
    return {double: None if double in shared else as_fmpq(value) for double, value in first.items()}
