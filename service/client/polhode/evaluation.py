"""A stored motion as a function of time, evaluated here with the bits of the service; attitude; samples.

The service stores piecewise Chebyshev series; with a period as the sum hi + lo of two doubles, so that
reducing a time costs no digits however many periods have passed. The operations and their order are
those of the service: tests compare every bit.
"""

import importlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from polhode.documents.problems import nearest
from polhode.documents.quantities import doubles
from polhode.errors import PolhodeError, WrongArgumentError

if TYPE_CHECKING:
    import pandas as pd


FloatArray = NDArray[np.float64]

LATEST = 1e15
"""The latest time, on either side of 0, that is evaluated: the service takes no later one."""
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

        For a periodic motion the error of the phase comes on top: that of the period, once for every
        period that has passed, and the rounding of a time. What it does is measured by moving the times:
        between, a column leaves the chords by φ²/8 times its second derivative at most, and it never does
        more than its whole range.
        """
        samples = self(times)
        bounds = np.array([self.errors.get(name, self.error) for name in self.columns])
        bounds += EPSILON * np.abs(samples).max(axis=0, initial=0.0)
        if self.period is not None and len(times):
            phase = self.phase_error(times)
            local, turns = split_time(times, self.period)
            here = self._within(local)
            moved = np.max([np.abs(self(local + by) - here).max(axis=0) for by in (-phase, phase)], axis=0)
            sagittas, ranges = self.sagittas_and_ranges(phase)
            for name, gained in self.advances.items():
                ranges[list(self.columns).index(name)] += abs(gained.hi) * (phase / self.period.hi)
            bounds += np.minimum(moved + sagittas, ranges)
            gains = [self.advances.get(name, PairOfDoubles()).error for name in self.columns]
            bounds += np.abs(turns).max() * np.array(gains)
        return dict(zip(self.columns, bounds.tolist(), strict=True))

    def phase_error(self, times: FloatArray) -> float:
        """Return the bound of the error of the phase, as a time, at any of ``times``; 0 without a period."""
        if self.period is None or not len(times):
            return 0.0
        turns = float(np.abs(times).max()) / self.period.hi
        # A larger number of periods is no exact double.
        lost = 0.0 if turns <= 2.0**52 else 4.0 * EPSILON * turns * self.period.hi
        return self.period.error * turns + 4.0 * EPSILON * self.period.hi + lost

    def sagittas_and_ranges(self, phase: float) -> tuple[FloatArray, FloatArray]:
        """Return bounds of how far each column leaves its chords of length φ, and of its range."""
        sizes = np.abs(self.coefficients)
        bends, radii = np.zeros_like(sizes[:, 0]), np.zeros_like(sizes[:, 0])
        for k in range(1, sizes.shape[1]):
            bends += (k * k * (k * k - 1) / 3.0) * sizes[:, k]
            radii += sizes[:, k]
        # Beyond 1e100 widths of a piece the range is the smaller bound, whatever this one is.
        scales = 0.5 * np.minimum(phase / np.diff(self.breaks), 1e100) ** 2
        middles = self.coefficients[:, 0]
        ranges = (middles + radii).max(axis=0) - (middles - radii).min(axis=0)
        return (scales[:, None] * bends).max(axis=0), ranges

    def _within(self, local: FloatArray) -> FloatArray:
        piece = np.clip(np.searchsorted(self.breaks, local, side="right") - 1, 0, len(self.breaks) - 2)
        left, right = self.breaks[piece], self.breaks[piece + 1]
        x = np.clip(((local - left) - (right - local)) / (right - left), -1.0, 1.0)
        values = np.empty((len(x), self.coefficients.shape[2]))
        for start in range(0, len(x), _BLOCK):
            block = slice(start, start + _BLOCK)
            values[block] = _clenshaw(self.coefficients, piece[block], x[block])
        return values


def instants(times: ArrayLike) -> FloatArray:
    """Return times as doubles, of any shape; one alone becomes a list of one.

    Raises
    ------
    WrongArgumentError
        One of them is no number, not finite, or too far away.
    """
    asked = np.atleast_1d(doubles(times, "t"))
    far = asked[~(np.abs(asked) <= LATEST)]
    if far.size:
        raise WrongArgumentError(f"t = {far[0]:.17g} is too far away; times up to ±{LATEST:.0e} are accepted")
    return asked


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


LOCAL = ("local_q0", "local_q1", "local_q2", "local_q3")
"""Columns of the quaternion of the time within a period."""
_QUATERNION = ("q0", "q1", "q2", "q3")
_TWO_TURNS = PairOfDoubles(4.0 * math.pi, 4.0 * 1.2246467991473532e-16)
"""4π in two doubles: the period of a quaternion in its angle."""


def columns_at(function: FunctionOfTime, times: FloatArray) -> dict[str, FloatArray]:
    """Return all columns at ``times`` by name: the variables, and the orientation if the function has it."""
    values = function(times)
    names = list(function.columns)
    hidden = (*LOCAL, "psi1", "psi3")
    columns = {name: values[:, k] for k, name in enumerate(names) if name not in hidden}
    if LOCAL[0] not in names:
        return columns
    quaternion = _quaternion(function, times, values)
    angles = {name: values[:, k] for k, name in enumerate(names) if name in ("psi1", "psi3")}
    return {**columns, **{name: quaternion[:, k] for k, name in enumerate(_QUATERNION)}, **angles}


def errors_at(function: FunctionOfTime, times: FloatArray) -> dict[str, float]:
    """Return the bound of the absolute error of each of :func:`columns_at`, at any of ``times``."""
    errors = function.errors_at(times)
    others = {name: error for name, error in errors.items() if name not in LOCAL}
    if LOCAL[0] not in function.columns:
        return others
    bound = max(function.errors.get(name, function.error) for name in LOCAL) + 2.0 * EPSILON
    if function.period is not None and len(times):
        local, turns = split_time(times, function.period)
        phase = function.phase_error(times)
        here, *moved = (_quaternion(function, local + by) for by in (0.0, -phase, phase))
        sagittas = function.sagittas_and_ranges(phase)[0][
            [list(function.columns).index(name) for name in LOCAL]
        ]
        bent = math.hypot(*sagittas.tolist())
        bound += min(max(float(np.abs(there - here).max()) for there in moved) + bent, 2.0)
        bound += 0.5 * float(np.abs(turns).max()) * function.advances.get("psi1", PairOfDoubles()).error
    return {**others, **dict.fromkeys(_QUATERNION, bound)}


def _quaternion(function: FunctionOfTime, times: FloatArray, values: FloatArray | None = None) -> FloatArray:
    known = function(times) if values is None else values
    first = list(function.columns).index(LOCAL[0])
    quaternion = known[:, first : first + 4]
    if function.period is None:
        return quaternion
    _, turns = split_time(times, function.period)
    advances: Mapping[str, PairOfDoubles] = function.advances
    gained = advances.get("psi1", PairOfDoubles())
    product, rest = two_product(turns, gained.hi)
    angle = split_time(product, _TWO_TURNS)[0] + (rest + turns * gained.lo)
    sign = np.where(turns % 2.0 == 0.0, 1.0, _sign_of_period(function, first, gained))
    return sign[:, None] * _product(_about_vertical(angle), quaternion)


def _sign_of_period(function: FunctionOfTime, first: int, gained: PairOfDoubles) -> float:
    series = function.coefficients[:, :, first : first + 4]
    end = series[-1].sum(axis=0)
    start = series[0, ::2].sum(axis=0) - series[0, 1::2].sum(axis=0)
    turned = _product(_about_vertical(np.array(gained.hi)), start)
    return math.copysign(1.0, float(turned @ end))


def _about_vertical(angle: FloatArray) -> FloatArray:
    zero = np.zeros_like(angle)
    return np.stack([np.cos(angle / 2), zero, zero, np.sin(angle / 2)], axis=-1)


def _product(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return Hamilton's product of quaternions, shape (..., 4) each."""
    a0, a1, a2, a3 = np.moveaxis(left, -1, 0)
    b0, b1, b2, b3 = np.moveaxis(right, -1, 0)
    return np.stack(
        [
            a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
            a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
            a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
            a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
        ],
        axis=-1,
    )


class MissingLibraryError(PolhodeError, ImportError):
    """An optional library is not installed."""


def optional(library: str, for_what: str) -> ModuleType:
    """Return an optional library.

    Raises
    ------
    MissingLibraryError
        It is not installed; the message says how to install it.
    """
    try:
        return importlib.import_module(library)
    except ImportError as fault:
        top = library.partition(".")[0]
        raise MissingLibraryError(f"{for_what} needs {top}: pip install {top}") from fault


@dataclass(frozen=True, slots=True)
class Samples:
    """Columns of one shape by name: ``t``, ``p``, ``q``, ``r``, ``g1``, ``g2``, ``g3`` and others.

    Parameters
    ----------
    columns
        In the shape of the times that were asked for.
    errors
        For each column the bound of the absolute error of any number in it.
    """

    columns: Mapping[str, FloatArray]
    errors: Mapping[str, float]

    @property
    def error(self) -> float:
        """Bound of the absolute error of any number."""
        return max(self.errors.values(), default=0.0)

    @property
    def t(self) -> FloatArray:
        """Times, in the shape in which they were asked for; (1,) for one alone."""
        return self["t"]

    @property
    def omega(self) -> FloatArray:
        """Angular velocity (p, q, r) in the axes of the body, shape (..., 3)."""
        return np.stack([self[name] for name in ("p", "q", "r")], axis=-1)

    @property
    def gamma(self) -> FloatArray:
        """The vertical (g1, g2, g3) in the axes of the body, shape (..., 3)."""
        return np.stack([self[name] for name in ("g1", "g2", "g3")], axis=-1)

    def __getitem__(self, name: str) -> FloatArray:
        if name not in self.columns:
            known = list(self.columns)
            raise KeyError(f"no column {name!r}{nearest(name, known)}; there are {', '.join(known)}")
        return self.columns[name]

    def __len__(self) -> int:
        return self.columns["t"].size

    def __repr__(self) -> str:
        return f"<{len(self)} samples of {', '.join(self.columns)}; error {self.error:.1e}>"

    def frame(self) -> "pd.DataFrame":
        """Return a pandas frame with a row a time; ``frame.attrs["error"]`` bounds every number's error."""
        pandas: ModuleType = optional("pandas", "frame()")
        frame: pd.DataFrame = pandas.DataFrame({name: each.ravel() for name, each in self.columns.items()})
        frame.attrs.update(error=self.error, errors=dict(self.errors))
        return frame
