"""Generates the values of a sweep's axis, each from its index alone.

A value is an exact number. Those that arithmetic makes (all but the listed ones
and the ends of spans) are rounded once, to the nearest double, and stand for
the shortest decimal of that double: so a problem sent by itself with this
number, as JSON prints it, is the same problem to the last bit.

Doubles are the same on every machine: they come from integers divided once,
from decimals of 50 digits, and from a counter-based generator; never from the
mathematical library of a platform.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Context, Decimal
from fractions import Fraction
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from service.dynamics.exact import exact_number

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_LOGARITHMIC_CONTEXT = Context(prec=50)
"""A run of 1e7 values, each made from the one before, keeps 40 digits of them."""
_RESOLUTION = 2**53
"""Draws are multiples of 1/2^53 of the span."""
_DRAWS_PER_COUNT = 4
"""Numbers of 64 bits that Philox makes of one value of its counter."""
_MAX_DROPPED = 64
"""Gaps up to this are computed and dropped, which is cheaper than a new start."""


class Axis(Protocol):
    """The values of one number."""

    @property
    def length(self) -> int:
        """Number of values."""
        ...

    def value(self, index: int) -> Fraction:
        """Return one value, exact."""
        ...

    def doubles(self, first: int, count: int) -> FloatArray:
        """Return ``count`` neighbouring values, each rounded to the nearest double."""
        ...


@dataclass(frozen=True, slots=True)
class ListedAxis:
    """The values themselves."""

    listed: tuple[Fraction, ...]

    @property
    def length(self) -> int:
        """Number of values."""
        return len(self.listed)

    def value(self, index: int) -> Fraction:
        """Return one value, as it was given."""
        return self.listed[index]

    def doubles(self, first: int, count: int) -> FloatArray:
        """Return neighbouring values."""
        return np.array([float(value) for value in self.listed[first : first + count]], dtype=np.float64)


@dataclass(frozen=True, slots=True)
class LinearAxis:
    """``length`` equidistant values from ``lo`` to ``hi``, both included and exact; one is ``lo``."""

    lo: Fraction
    hi: Fraction
    length: int

    def value(self, index: int) -> Fraction:
        """Return one value."""
        return _between(self, index)

    def doubles(self, first: int, count: int) -> FloatArray:
        """Return neighbouring values."""
        return _affine(self.lo, self.hi, max(self.length - 1, 1), range(first, first + count))


@dataclass(frozen=True, slots=True)
class LogarithmicAxis:
    """``length`` values with equal ratios from ``lo`` to ``hi`` (> 0), both included and exact."""

    lo: Fraction
    hi: Fraction
    length: int

    def value(self, index: int) -> Fraction:
        """Return one value."""
        return _between(self, index)

    def doubles(self, first: int, count: int) -> FloatArray:
        """Return neighbouring values."""
        steps = Decimal(max(self.length - 1, 1))
        growth = _LOGARITHMIC_CONTEXT.divide(
            _LOGARITHMIC_CONTEXT.subtract(_logarithm(self.hi), _logarithm(self.lo)), steps
        )
        exponent = _LOGARITHMIC_CONTEXT.add(
            _logarithm(self.lo), _LOGARITHMIC_CONTEXT.multiply(growth, Decimal(first))
        )
        value, ratio = _LOGARITHMIC_CONTEXT.exp(exponent), _LOGARITHMIC_CONTEXT.exp(growth)
        found = np.empty(count)
        for k in range(count):
            found[k] = float(value)
            value = _LOGARITHMIC_CONTEXT.multiply(value, ratio)
        for index, end in ((0, self.lo), (self.length - 1, self.hi)):
            if self.length > 1 and first <= index < first + count:
                found[index - first] = float(end)
        return found if self.length > 1 else np.full(count, float(self.lo))


@dataclass(frozen=True, slots=True)
class UniformAxis:
    """``length`` independent draws from between ``lo`` and ``hi``.

    The draw at an index is number ``index`` of the stream of Philox-4x64 whose
    key is (``seed``, ``stream``); its 53 leading bits are its place in the span.
    """

    lo: Fraction
    hi: Fraction
    length: int
    seed: int
    stream: int

    def value(self, index: int) -> Fraction:
        """Return one value."""
        return exact_number(float(self.doubles(index, 1)[0]))

    def doubles(self, first: int, count: int) -> FloatArray:
        """Return neighbouring values."""
        counter, skipped = divmod(first, _DRAWS_PER_COUNT)
        key = np.array([self.seed, self.stream], dtype=np.uint64)
        draws = np.random.Philox(key=key, counter=counter).random_raw(skipped + count)[skipped:]
        places = (draws >> np.uint64(64 - 53)).tolist()
        return _affine(self.lo, self.hi, _RESOLUTION, places)


def at(axis: Axis, indices: IntArray) -> FloatArray:
    """Return the doubles of ``axis`` at any indices, in any order."""
    distinct, places = np.unique(indices, return_inverse=True)
    runs = np.split(distinct, np.flatnonzero(np.diff(distinct) > _MAX_DROPPED) + 1) if len(distinct) else []
    found = [axis.doubles(int(run[0]), int(run[-1] - run[0]) + 1)[run - run[0]] for run in runs]
    return np.concatenate([np.empty(0), *found])[places]


def _between(axis: LinearAxis | LogarithmicAxis, index: int) -> Fraction:
    """Return a value of a span: its ends are exact, between them the doubles count."""
    if index == 0:
        return axis.lo
    if index == axis.length - 1:
        return axis.hi
    return exact_number(float(axis.doubles(index, 1)[0]))


def _affine(lo: Fraction, hi: Fraction, parts: int, places: Iterable[int]) -> FloatArray:
    """Return lo + (hi - lo) k / parts for the integers k, each rounded once."""
    common = lo.denominator * hi.denominator
    start, slope = int(lo * common) * parts, int((hi - lo) * common)
    divisor = common * parts
    # Python divides integers of any size with one rounding.
    return np.array([(start + slope * place) / divisor for place in places], dtype=np.float64)


def _logarithm(value: Fraction) -> Decimal:
    quotient = _LOGARITHMIC_CONTEXT.divide(Decimal(value.numerator), Decimal(value.denominator))
    return _LOGARITHMIC_CONTEXT.ln(quotient)
