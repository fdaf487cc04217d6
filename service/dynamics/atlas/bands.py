"""Follows each window of a part of λ: its ends, its energy and its period at single λ."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.atlas.curves import LambdaStretch, PlainHalves
from service.dynamics.atlas.periods import periods
from service.dynamics.atlas.radicands import equator_of
from service.dynamics.atlas.zeros import Zeros
from service.dynamics.reduction.arc import Arc
from service.dynamics.reduction.window import Window

FloatArray = NDArray[np.float64]

SAME = 1e-6
"""Relative distance up to which an end of a window is taken for a zero; zeros are simple, hence apart."""
ROUNDED = 1e-15
"""Relative error of a λ that is told as a double."""


@dataclass(frozen=True, slots=True)
class Measured:
    """Values with bounds of their errors, shape (λ,); NaN where nothing is known."""

    value: FloatArray
    error: FloatArray

    @staticmethod
    def between(low: FloatArray, high: FloatArray) -> "Measured":
        """Return the middles of bounds, with half of what is between them and a rounding."""
        middle = 0.5 * low + 0.5 * high
        return Measured(middle, 0.5 * (high - low) + 2.0**-52 * np.abs(middle))


@dataclass(frozen=True, slots=True)
class Band:
    """One window over a part of λ."""

    window: Window
    """At one λ of the part: its number, kind and ends are the same at all of them."""
    g1: tuple[Measured, Measured]
    """With its sign, where |g1| is smallest and where it is largest."""
    g2: tuple[Measured, Measured]
    """Smallest and largest, of the northern one of two mirror images."""
    period: Measured


@dataclass(frozen=True, slots=True)
class WindowSeries:
    """The windows of a part at single λ, in the order of growing primed λ."""

    lambda_: FloatArray
    """In the client's axes."""
    energy: Measured
    bands: tuple[Band, ...]


def series_of(
    halves: Sequence[PlainHalves],
    zeros: Sequence[Zeros],
    single: Sequence[LambdaStretch],
    windows: Sequence[Window],
    row: int,
    energy: Measured,
    *,
    has_periods: bool,
) -> WindowSeries:
    """Return the windows at single λ of a part, with the zeros of its halves; ``windows`` are at ``row``."""
    lambda_ = np.array([float(halves[0].sent(each)[0].mid()) for each in single])
    Z, G = equator_of(halves[0], single)
    bands = tuple(_band(halves[0], zeros, Z, G, window, row, has_period=has_periods) for window in windows)
    return WindowSeries(lambda_, energy, bands)


@dataclass(frozen=True, slots=True)
class _End:
    v: FloatArray
    """Shape (λ, 1)."""
    size: tuple[FloatArray, FloatArray]
    """Bounds of |g1|, shape (λ,)."""
    height: tuple[FloatArray, FloatArray]


def _band(
    half: PlainHalves,
    zeros: Sequence[Zeros],
    Z: FloatArray,
    G: FloatArray,
    window: Window,
    row: int,
    *,
    has_period: bool,
) -> Band:
    arc = window.arcs[0]
    ends = [_end(half, zeros, v, row, len(Z)) for v in (arc.lower, arc.upper)]
    sizes = [np.sort(np.stack([end.size[k] for end in ends]), axis=0) for k in (0, 1)]
    least, most = (Measured.between(sizes[0][k], sizes[1][k]) for k in (0, 1))
    nothing = Measured(np.zeros(len(Z)), np.zeros(len(Z)))
    if window.ends[0] == "pole":
        least = nothing
    if window.ends[1] == "equator":
        widest = (Z if half.shape.is_mirrored else G)[:, 0]
        most = Measured(widest, 8.0 * ROUNDED * widest)
    heights = [end.height for end in ends]
    poles = [*arc.poles, *([arb(0), arb.pi()] if arc.is_whole_loop else [])]
    for pole in poles:
        flat = np.full(len(Z), float(pole.cos()))
        heights.append((flat, flat))
    lows, highs = np.stack([low for low, _ in heights]), np.stack([high for _, high in heights])
    # NaN, where a zero is not enclosed, is kept.
    g2 = (
        Measured.between(lows.min(axis=0), highs[np.argmin(highs, axis=0), np.arange(len(Z))]),
        Measured.between(lows[np.argmax(lows, axis=0), np.arange(len(Z))], highs.max(axis=0)),
    )
    sign = half.shape.third_sign if half.shape.is_mirrored else half.shape.first_sign
    g1 = tuple(Measured(sign * each.value + 0.0, each.error) for each in (least, most))
    if has_period and window.kind == "periodic":
        period = _period(half, Z, G, arc, ends)
    else:
        period = Measured(np.full(len(Z), np.nan), np.full(len(Z), np.nan))
    return Band(window, (g1[0], g1[1]), g2, period)


def _end(half: PlainHalves, zeros: Sequence[Zeros], v: arb, row: int, count: int) -> _End:
    """Return an end of an arc at every λ; it is known at the λ of one row."""
    place = float(v)
    turns = round(place / np.pi)
    x = place - turns * np.pi
    pole = 1.0 if turns % 2 == 0 else -1.0
    if abs(x) < 1e-300 or v.contains(arb.pi() * turns):
        nothing, flat = np.zeros(count), np.full(count, pole)
        return _End(np.full((count, 1), turns * np.pi), (nothing, nothing), (flat, flat))
    on_other = (np.sin(place) > 0.0) != (half.shape.third_sign > 0)
    found = zeros[1 if on_other and len(zeros) > 1 else 0]
    column = _column(found, row, abs(x), pole)
    if column is None:
        unknown = np.full(count, np.nan)
        return _End(unknown[:, None], (unknown, unknown), (unknown, unknown))
    middle = 0.5 * (found.low[:, column] + found.high[:, column])
    size, height = ((part[0][:, column], part[1][:, column]) for part in (found.size, found.height))
    return _End((turns * np.pi + np.copysign(middle, x))[:, None], size, height)


def _column(zeros: Zeros, row: int, x: float, pole: float) -> int | None:
    middles = 0.5 * (zeros.low[row] + zeros.high[row])
    off = np.where(zeros.hemisphere == pole, np.abs(middles - x), np.inf)
    # Of a zero, and of a place where p² is infinite, there may be two enclosures: the narrower one holds too.
    widths = np.where(off <= SAME * x, zeros.high[row] - zeros.low[row], np.inf)
    best = int(np.argmin(widths)) if off.size else 0
    return best if off.size and widths[best] < np.inf else None


def _period(half: PlainHalves, Z: FloatArray, G: FloatArray, arc: Arc, ends: Sequence[_End]) -> Measured:
    lower, upper = (end.v for end in ends)
    if arc.is_whole_loop:
        lower = np.full((len(Z), 1), float(arc.lower))
        upper = lower + 2.0 * np.pi
    return Measured(*periods(half, Z, G, lower, upper, is_loop=arc.is_whole_loop))
