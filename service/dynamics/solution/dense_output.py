"""A solution as a function of time: piecewise Chebyshev polynomials; and balls as columns of doubles.

Each piece maps [breaks[k], breaks[k+1]] onto [-1, 1] and holds, for every
column, the coefficients of a Chebyshev series of the first kind. A periodic
motion stores one period; its length is the sum hi + lo of two doubles, so that
reducing a time by n periods costs no digits for any n up to 2^53. A column such
as an angle may grow by a fixed advance per period, kept in the same way.

The midpoint of a stored ball is the unevaluated sum of doubles, each the rounding of what the
ones before leave; what the last one leaves is added to the radius.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cache
from math import floor, inf, log10, nextafter
from typing import Self

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.errors import DynamicsError
from service.dynamics.numerics import ErrorKind, largest

FloatArray = NDArray[np.float64]

RADIUS_DIGITS = 3
RADIUS = "radius"
"""Suffix of the column with the radii; the further parts of x are the columns x.1, x.2, …"""
MAX_PARTS = 10
JOIN_BITS = 1200
"""Exact for sums of doubles between 2^-1074 and 2^64."""


def split(ball: arb, parts: int) -> tuple[list[float], float]:
    """Return ``parts`` doubles whose sum is close to the midpoint, and a radius about that sum."""
    with ctx.workprec(JOIN_BITS):
        rest, doubles = ball.mid(), list[float]()
        for _ in range(parts):
            doubles.append(float(rest))
            rest = (rest - arb(doubles[-1])).mid()
        left = ball.rad() + abs(rest)
        radius = float(left.abs_upper())
    return doubles, nextafter(radius, inf) if radius else 0.0


def join(doubles: Sequence[float], radius: float) -> arb:
    """Return the ball about the exact sum of ``doubles``."""
    with ctx.workprec(JOIN_BITS):
        total = sum((arb(double) for double in doubles), start=arb(0))
        return arb(total.mid(), radius)


def parts_for(bits: int) -> int:
    """Return how many doubles hold a number near 1 with an error below 2^-bits."""
    return -(-(bits + 8) // 53)


def is_part(name: str) -> bool:
    """Tell whether a column is a further part, or the radii, of another."""
    return "." in name


def as_decimals(ball: arb) -> tuple[str, str]:
    """Return (value, radius) in decimal such that value ± radius contains the finite ``ball``.

    The value has as many decimals as the radius; both are "0" for an exact 0.

    Raises
    ------
    ValueError
        The ball is not finite.
    """
    if not ball.is_finite():
        raise ValueError(f"{ball} is not finite")
    middle, radius = exact_middle(ball), exact_middle(ball.rad())
    if radius:
        decimals = RADIUS_DIGITS - 1 - _exponent(radius)
    elif middle:
        # An exact value: as many digits as its own bits are worth.
        decimals = int(0.302 * ball.bits()) + RADIUS_DIGITS - _exponent(middle)
    else:
        return "0", "0"
    unit = Fraction(10) ** -decimals
    value = round(middle / unit)
    rest = radius + abs(middle - value * unit)
    return _scientific(value, decimals), _scientific(-floor(-rest / unit), decimals)


def exact_middle(ball: arb) -> Fraction:
    """Return the midpoint of a finite ball."""
    middle = ball.mid().fmpq()
    return Fraction(int(middle.p), int(middle.q))


def _exponent(value: Fraction) -> int:
    """Return floor(log10 |value|), or one less or more."""
    value = abs(value)
    bits = value.numerator.bit_length() - value.denominator.bit_length()
    return floor(bits * log10(2.0))


def _scientific(units: int, decimals: int) -> str:
    """Return units · 10^-decimals, exactly."""
    if units == 0:
        return "0"
    sign, digits = "-" if units < 0 else "", str(abs(units))
    exponent = len(digits) - 1 - decimals
    digits = digits.rstrip("0")
    if -5 <= exponent < 21:
        if exponent < 0:
            return f"{sign}0.{'0' * (-exponent - 1)}{digits}"
        whole = digits[: exponent + 1].ljust(exponent + 1, "0")
        fraction = digits[exponent + 1 :]
        return f"{sign}{whole}.{fraction}" if fraction else f"{sign}{whole}"
    fraction = digits[1:]
    return f"{sign}{digits[0]}{'.' + fraction if fraction else ''}e{exponent}"


EPSILON = float(np.finfo(np.float64).eps)
UNIT_ROUNDOFF = 0.5 * EPSILON
"""Relative error of one rounding, 2^-53."""
TURN, TURN_LOW = 2.0 * math.pi, 2.4492935982947064e-16
"""2π in two doubles."""
_SPLIT = 134217729.0  # 2^27 + 1: Veltkamp's constant for doubles
_TIMES_TOGETHER = 2048  # times whose sums stay in the cache


class OutsideHorizonError(DynamicsError):
    """A requested time is outside the solution."""

    code = "outside_horizon"


@dataclass(frozen=True, slots=True)
class Period:
    """A period hi + lo (|lo| ≤ ulp(hi)/2) and the bound of its absolute error."""

    hi: float
    lo: float
    error: float
    kind: ErrorKind = "estimate"
    """The way in which the bound is known: no theorem unless who has found it says so."""

    @classmethod
    def of(cls, length: arb) -> Self:
        """Return a ball of a period as two doubles, with a bound that is a theorem."""
        (hi, lo), error = split(length, 2)
        return cls(hi, lo, error, "theorem")


@dataclass(frozen=True, slots=True)
class Advance:
    """Growth of a column per period: hi + lo (|lo| ≤ ulp(hi)/2), and the bound of its absolute error."""

    hi: float = 0.0
    lo: float = 0.0
    error: float = 0.0


@dataclass(frozen=True, slots=True)
class DenseOutput:
    """Columns as functions of time.

    Parameters
    ----------
    columns
        Names, in the order of the last axis.
    breaks
        Shape (pieces + 1,), strictly increasing. Periodic: from 0 to the period.
    coefficients
        Shape (pieces, degree + 1, columns).
    period
        None if the motion is not periodic (or not known to be): then only
        times within ``breaks`` can be asked.
    error
        Bound of the absolute error within ``breaks`` of every column not in ``errors``.
    errors
        The same for columns with a bound of their own, by name.
    advances
        Of the columns that grow from period to period, by name; the others are periodic.
    """

    columns: tuple[str, ...]
    breaks: FloatArray
    coefficients: FloatArray
    period: Period | None
    error: float
    errors: Mapping[str, float] = field(default_factory=dict)
    advances: Mapping[str, Advance] = field(default_factory=dict)

    def __call__(self, times: FloatArray, low_parts: FloatArray | None = None) -> FloatArray:
        """Return the columns at ``times``, shape (len(times), columns).

        With ``low_parts`` the times are the sums of both, as
        :class:`~service.dynamics.sampling.SampleTimes` has them.

        Raises
        ------
        OutsideHorizonError
            A time is outside ``breaks`` and the motion is not periodic.
        """
        times = np.asarray(times, dtype=np.float64)
        if self.period is None:
            self.require_within(times)
            return self._within(times, low_parts)
        local, turns = split_time(times, self.period, low_parts)
        values = self._within(local)
        self.advance(values, turns)
        return values

    def only(self, columns: Sequence[str]) -> "DenseOutput":
        """Return the function of time of these columns alone: no other is evaluated with it."""
        chosen = [self.columns.index(name) for name in columns]
        return replace(
            self,
            columns=tuple(columns),
            coefficients=self.coefficients[:, :, chosen],
            errors={name: error for name, error in self.errors.items() if name in columns},
            advances={name: advance for name, advance in self.advances.items() if name in columns},
        )

    def advance(self, values: FloatArray, turns: FloatArray) -> None:
        """Add to columns that grow, shape (times, columns), what they gain in so many periods."""
        for name, advance in self.advances.items():
            k = self.columns.index(name)
            # The large part last: the small ones keep their digits.
            values[:, k] = (values[:, k] + turns * advance.lo) + turns * advance.hi

    def error_at(self, times: FloatArray) -> float:
        """Return the bound of the absolute error of any column at any of ``times``; see :meth:`errors_at`."""
        return largest(self.errors_at(times).values())

    def errors_at(self, times: FloatArray) -> dict[str, float]:
        """Return the bound of the absolute error of each column at any of ``times``, by name.

        For a periodic motion the error of the phase comes on top: that of the
        period, once for every period that has passed, and the rounding of a
        time by a few ulp. What it does is measured by moving the times by it:
        between, a column leaves the chords by φ²/8 times its second derivative
        at most, and it never does more than its whole range.
        The error of an advance counts once for every period as well.
        """
        times = np.asarray(times, dtype=np.float64)
        samples = self(times)
        bounds = np.array([self.errors.get(name, self.error) for name in self.columns])
        bounds += EPSILON * np.abs(samples).max(axis=0, initial=0.0)
        if self.period is not None and len(times):
            phase = self.phase_error(times)
            # Reduced first: a small shift would drown in the rounding of a late time.
            local, turns = split_time(times, self.period)
            here = self._within(local)
            moved = np.max([np.abs(self(local + by) - here).max(axis=0) for by in (-phase, phase)], axis=0)
            sagittas, ranges = self.sagittas_and_ranges(phase)
            for name, advance in self.advances.items():
                ranges[self.columns.index(name)] += abs(advance.hi) * (phase / self.period.hi)
            bounds += np.minimum(moved + sagittas, ranges)
            gains = [self.advances.get(name, Advance()).error for name in self.columns]
            bounds += np.abs(turns).max() * np.array(gains)
        return dict(zip(self.columns, bounds.tolist(), strict=True))

    def phase_error(self, times: FloatArray) -> float:
        """Return the bound of the error of the phase, as a time, at any of ``times``; 0 without a period."""
        return 0.0 if self.period is None else phase_error(times, self.period)

    def sagittas_and_ranges(self, phase: float) -> tuple[FloatArray, FloatArray]:
        """Return bounds of how far each column leaves its chords of length φ, and of its range.

        That is φ²/8 times the second derivative; on a piece, |T_k| ≤ 1 and |T_k''| ≤ k² (k² − 1) / 3
        times the square of 2 / width.
        """
        sizes = np.abs(self.coefficients)
        # Degree by degree: a sum's bits do not depend on the other columns.
        bends, radii = np.zeros_like(sizes[:, 0]), np.zeros_like(sizes[:, 0])
        for k in range(1, sizes.shape[1]):
            bends += (k * k * (k * k - 1) / 3.0) * sizes[:, k]
            radii += sizes[:, k]
        # Beyond 1e100 widths of a piece the range is the smaller bound, whatever this one is.
        scales = 0.5 * np.minimum(phase / np.diff(self.breaks), 1e100) ** 2
        middles = self.coefficients[:, 0]
        ranges = (middles + radii).max(axis=0) - (middles - radii).min(axis=0)
        return (scales[:, None] * bends).max(axis=0), ranges

    def _within(self, local: FloatArray, low_parts: FloatArray | None = None) -> FloatArray:
        piece = np.clip(np.searchsorted(self.breaks, local, side="right") - 1, 0, len(self.breaks) - 2)
        left, right = self.breaks[piece], self.breaks[piece + 1]
        x = ((local - left) - (right - local)) / (right - left)
        if low_parts is not None:
            x = x + 2.0 * low_parts / (right - left)
        x = np.clip(x, -1.0, 1.0)
        return _clenshaw(self.coefficients, piece, x)

    def require_within(self, times: FloatArray) -> None:
        """Refuse times before the first or after the last of ``breaks``.

        Raises
        ------
        OutsideHorizonError
            A time is outside.
        """
        first, last = float(self.breaks[0]), float(self.breaks[-1])
        outside = times[~((times >= first) & (times <= last))]
        if outside.size:
            raise OutsideHorizonError(
                f"t = {outside[0]:.17g} is outside [{first:.17g}, {last:.17g}], "
                "where this solution was computed; it is not known to be periodic"
            )


def phase_error(times: FloatArray, period: Period) -> float:
    """Return the bound of the error of the phase of a periodic motion, as a time, at any of ``times``."""
    if not len(times):
        return 0.0
    turns = float(np.abs(times).max()) / period.hi
    return period.error * turns + 4.0 * EPSILON * period.hi + float(turns_lost(turns)) * period.hi


MOST_TURNS = 2.0**52
"""Periods that a time is reduced by without losing digits; a larger number of them is no exact double."""


def turns_lost(turns: FloatArray | float) -> FloatArray:
    """Return the bound of the error of a reduced time, in periods, beside roundings: 0 up to MOST_TURNS."""
    return np.where(np.asarray(turns) <= MOST_TURNS, 0.0, 4.0 * EPSILON * np.asarray(turns))


def reduce_time(times: FloatArray, period: Period) -> FloatArray:
    """Return t − n (hi + lo) in [0, hi], with the product n hi formed exactly."""
    return split_time(times, period)[0]


def split_time(
    times: FloatArray, period: Period, low_parts: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return t − n (hi + lo) in [0, hi] as :func:`reduce_time` does, and n, whole numbers as doubles.

    With ``low_parts`` the times t are the sums of both.
    """
    turns = np.floor(times / period.hi)
    local = _remainder(times, turns, period, low_parts)
    shift = np.where(local < 0.0, -1.0, np.where(local >= period.hi, 1.0, 0.0))
    local = np.where(shift == 0.0, local, _remainder(times, turns + shift, period, low_parts))
    return np.clip(local, 0.0, period.hi), turns + shift


def _remainder(
    times: FloatArray, turns: FloatArray, period: Period, low_parts: FloatArray | None
) -> FloatArray:
    product, rest = two_product(turns, period.hi)
    small = turns * period.lo if low_parts is None else turns * period.lo - low_parts
    return ((times - product) - rest) - small


def two_product(a: FloatArray, b: FloatArray | float) -> tuple[FloatArray, FloatArray]:
    """Return a·b as an unevaluated sum of two doubles (Dekker 1971)."""
    product = a * b
    return product, rest_of_product(product, *split_double(a), b)


def split_double(a: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return doubles as sums of two, each of half the bits (Veltkamp 1968)."""
    scaled = _SPLIT * a
    high = scaled - (scaled - a)
    return high, a - high


def rest_of_product(
    product: FloatArray, a_high: FloatArray, a_low: FloatArray, b: FloatArray | float
) -> FloatArray:
    """Return what the rounded product of a and b leaves out, a being a sum as of :func:`split_double`."""
    b_high = _SPLIT * b - (_SPLIT * b - b)
    b_low = b - b_high
    return ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low


def _clenshaw(coefficients: FloatArray, piece: NDArray[np.intp], x: FloatArray) -> FloatArray:
    """Sum the Chebyshev series of each time's piece; all columns at once.

    Every time has its own sum, so that its digits do not depend on the other times.
    """
    values = np.empty((len(x), coefficients.shape[2]))
    by_degree = np.ascontiguousarray(coefficients.swapaxes(0, 1))
    for start in range(0, len(x), _TIMES_TOGETHER):
        block = slice(start, start + _TIMES_TOGETHER)
        _clenshaw_block(by_degree, piece[block], x[block], values[block])
    return values


def _clenshaw_block(
    by_degree: FloatArray, piece: NDArray[np.intp], x: FloatArray, values: FloatArray
) -> None:
    # Arrays of one shape, written in place: broadcasting and new arrays would take half of the time.
    wide = np.repeat(x[:, None], values.shape[1], axis=1)
    twice = 2.0 * wide
    first, second = np.zeros_like(wide), np.zeros_like(wide)
    following, coefficient = np.empty_like(wide), np.empty_like(wide)
    for k in range(len(by_degree) - 1, 0, -1):
        np.take(by_degree[k], piece, axis=0, out=coefficient, mode="clip")
        np.multiply(twice, first, out=following)
        np.add(coefficient, following, out=following)
        np.subtract(following, second, out=following)
        first, second, following = following, first, second
    np.take(by_degree[0], piece, axis=0, out=coefficient, mode="clip")
    np.multiply(wide, first, out=values)
    np.add(coefficient, values, out=values)
    np.subtract(values, second, out=values)


def chebyshev_points(degree: int) -> FloatArray:
    """Return cos(π j / degree), j = 0..degree: from 1 down to -1."""
    return np.sin(np.pi * np.arange(degree, -degree - 1, -2) / (2 * degree))


def chebyshev_coefficients(values: FloatArray) -> FloatArray:
    """Return the series that takes ``values`` (axis 0) at :func:`chebyshev_points`."""
    return np.tensordot(_series_of_values(values.shape[0] - 1), values, axes=(1, 0))


def chebyshev_series(values: FloatArray) -> FloatArray:
    """Return :func:`chebyshev_coefficients` of each ``values[k]``, shape (n, m, c): the same bits."""
    series: FloatArray = np.matmul(_series_of_values(values.shape[1] - 1), values)
    return series


@cache
def _series_of_values(degree: int) -> FloatArray:
    j = np.arange(degree + 1)
    # The angle is reduced in integers: cos of a large one would cost two digits.
    matrix: FloatArray = np.cos(np.pi * (np.outer(j, j) % (2 * degree)) / degree) * (2.0 / degree)
    matrix[:, [0, -1]] *= 0.5
    matrix[[0, -1], :] *= 0.5
    # Every caller has the same array.
    matrix.flags.writeable = False
    return matrix
