"""A stored motion as a function of time, evaluated here with the bits of the service.

The service stores piecewise Chebyshev series; with a period as the sum hi + lo of two doubles, so that
reducing a time costs no digits however many periods have passed. The operations and their order are
those of the service: tests compare every bit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polhode.errors import WrongArgumentError

FloatArray = NDArray[np.float64]

EPSILON = float(np.finfo(np.float64).eps)
_SPLIT = 134217729.0  # 2^27 + 1: Veltkamp's constant for doubles
_BLOCK = 2048  # times whose sums stay in the cache


@dataclass(frozen=True, slots=True)
class PairOfDoubles:
    """A number hi + lo with the bound of its absolute error: a period, or what grows in one."""

    hi: float = 0.0
    lo: float = 0.0
    error: float = 0.0


@dataclass(frozen=True, slots=True)
class FunctionOfTime:
    """Columns as functions of time.

    Parameters
    ----------
    columns
        Names, in the order of the last axis of ``coefficients``.
    breaks
        Shape (pieces + 1,), increasing; of a periodic motion from 0 to the period.
    coefficients
        Shape (pieces, degree + 1, columns), of Chebyshev polynomials of the first kind.
    period
        None: only times within ``breaks`` can be asked.
    error
        Bound of the absolute error within ``breaks`` of each column not in ``errors``.
    advances
        What columns that grow, such as angles, gain in a period.
    """

    columns: Sequence[str]
    breaks: FloatArray
    coefficients: FloatArray
    period: PairOfDoubles | None
    error: float
    errors: Mapping[str, float]
    advances: Mapping[str, PairOfDoubles]

    def __call__(self, times: FloatArray) -> FloatArray:
        """Return the columns at ``times``, shape (len(times), columns).

        Raises
        ------
        WrongArgumentError
            A time is outside ``breaks``, and the motion is not known to be periodic.
        """
        if self.period is None:
            first, last = float(self.breaks[0]), float(self.breaks[-1])
            outside = times[~((times >= first) & (times <= last))]
            if outside.size:
                raise WrongArgumentError(
                    f"t = {outside[0]:.17g} is outside [{first:.17g}, {last:.17g}], where this motion was"
                    " computed; it is not known to be periodic"
                )
            return self._within(times)
        local, turns = split_time(times, self.period)
        values = self._within(local)
        for name, gained in self.advances.items():
            k = list(self.columns).index(name)
            values[:, k] = (values[:, k] + turns * gained.lo) + turns * gained.hi
        return values

    def errors_at(self, times: FloatArray) -> dict[str, float]:
        """Return the bound of the absolute error of each column at any of ``times``, by name.

        Of a periodic motion the error of the phase comes on top: that of the period, once for every
        period that has passed, and the rounding of a time. What it does is measured by moving the times.
        """
        samples = self(times)
        bounds = np.array([self.errors.get(name, self.error) for name in self.columns])
        bounds += EPSILON * np.abs(samples).max(axis=0, initial=0.0)
        if self.period is not None and len(times):
            passed = float(np.abs(times).max()) / self.period.hi
            phase = self.period.error * passed + 4.0 * EPSILON * self.period.hi
            local, turns = split_time(times, self.period)
            here = self._within(local)
            bounds += np.max([np.abs(self(local + by) - here).max(axis=0) for by in (-phase, phase)], axis=0)
            gains = [self.advances.get(name, PairOfDoubles()).error for name in self.columns]
            bounds += np.abs(turns).max() * np.array(gains)
        return dict(zip(self.columns, bounds.tolist(), strict=True))

    def _within(self, local: FloatArray) -> FloatArray:
        piece = np.clip(np.searchsorted(self.breaks, local, side="right") - 1, 0, len(self.breaks) - 2)
        left, right = self.breaks[piece], self.breaks[piece + 1]
        x = np.clip(((local - left) - (right - local)) / (right - left), -1.0, 1.0)
        values = np.empty((len(x), self.coefficients.shape[2]))
        for start in range(0, len(x), _BLOCK):
            block = slice(start, start + _BLOCK)
            values[block] = _clenshaw(self.coefficients, piece[block], x[block])
        return values


def split_time(times: FloatArray, period: PairOfDoubles) -> tuple[FloatArray, FloatArray]:
    """Return t − n (hi + lo) in [0, hi], with the product n hi formed exactly, and n as doubles."""
    turns = np.floor(times / period.hi)
    local = _remainder(times, turns, period)
    shift = np.where(local < 0.0, -1.0, np.where(local >= period.hi, 1.0, 0.0))
    local = np.where(shift == 0.0, local, _remainder(times, turns + shift, period))
    return np.clip(local, 0.0, period.hi), turns + shift


def two_product(a: FloatArray, b: float) -> tuple[FloatArray, FloatArray]:
    """Return a·b as an unevaluated sum of two doubles (Dekker 1971)."""
    product = a * b
    a_high = _SPLIT * a - (_SPLIT * a - a)
    b_high = _SPLIT * b - (_SPLIT * b - b)
    a_low, b_low = a - a_high, b - b_high
    rest = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    return product, rest


def _remainder(times: FloatArray, turns: FloatArray, period: PairOfDoubles) -> FloatArray:
    product, rest = two_product(turns, period.hi)
    return ((times - product) - rest) - turns * period.lo


def _clenshaw(coefficients: FloatArray, piece: NDArray[np.intp], x: FloatArray) -> FloatArray:
    wide = np.repeat(x[:, None], coefficients.shape[2], axis=1)
    twice = 2.0 * wide
    first, second = np.zeros_like(wide), np.zeros_like(wide)
    for k in range(coefficients.shape[1] - 1, 0, -1):
        first, second = (coefficients[piece, k] + twice * first) - second, first
    values: FloatArray = (coefficients[piece, 0] + wide * first) - second
    return values
