"""Follows each window of a part of λ: its ends, its energy and its period at single λ.

Periods of many motions are computed at once, in doubles, with an error that is estimated. Between two
simple zeros of P, v = m − r cos θ makes dt = Z dv / (c √P) a smooth function of θ, and round a whole loop
it is periodic in v. The midpoint rule converges fast for both; the number of points is doubled until two
sums agree, and their difference is the estimate.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.atlas.curves import LambdaStretch, PlainHalves, equator_of, p_squared
from service.dynamics.atlas.zeros import Zeros
from service.dynamics.reduction.window import Arc, Window

FloatArray = NDArray[np.float64]

MIN_NODES, MAX_NODES = 16, 1024
SUMS_RELATIVE_CHANGE = 1e-11
PERIOD_RELATIVE_ROUNDING = 1e-10
"""Relative error that rounding may bring: next to an end p² is the small difference of large terms."""
PERIOD_MAX_RELATIVE_ERROR = 1e-3
"""A period whose estimated relative error is larger is not told."""


def periods(
    half: PlainHalves, Z: FloatArray, G: FloatArray, lower: FloatArray, upper: FloatArray, *, is_loop: bool
) -> tuple[FloatArray, FloatArray]:
    """Return periods and their estimated errors; NaN where they are not known.

    Parameters
    ----------
    Z, G
        Of each λ, shape (λ, 1).
    lower, upper
        The ends v of the arc, shape (λ, 1), P being zero there; of a whole loop any v and v + 2π.
    """
    rate = _of_loop if is_loop else _between
    last = np.full(len(Z), np.nan)
    found, error = last.copy(), np.full(len(Z), np.inf)
    n = MIN_NODES
    while n <= MAX_NODES:
        with np.errstate(all="ignore"):
            now = rate(lambda v: _slowness(half, Z, G, v), lower, upper, n)
            change = np.abs(now - last)
            # NaN is no improvement.
            better = change < error
            found, error = np.where(better, now, found), np.where(better, change, error)
            if bool((error < SUMS_RELATIVE_CHANGE * found).all()):
                break
        last, n = now, 2 * n
    with np.errstate(all="ignore"):
        error = error + PERIOD_RELATIVE_ROUNDING * found
        is_known = (error < PERIOD_MAX_RELATIVE_ERROR * found) & np.isfinite(found)
    return np.where(is_known, found, np.nan), np.where(is_known, error, np.nan)


def _slowness(half: PlainHalves, Z: FloatArray, G: FloatArray, v: FloatArray) -> FloatArray:
    """Return dt/dv = Z / (c √P)."""
    # The signs of a half belong to sin x; v goes round the whole loop, with the sign of g3 in sin v.
    P, c = p_squared(half, Z, G, half.shape.third_sign * np.sin(v), np.cos(v))
    slowness: FloatArray = Z / (c * np.sqrt(P))
    return slowness


def _between(
    rate: Callable[[FloatArray], FloatArray], lower: FloatArray, upper: FloatArray, n: int
) -> FloatArray:
    angle = (np.arange(n) + 0.5) * np.pi / n
    middle, radius = 0.5 * (lower + upper), 0.5 * (upper - lower)
    values = rate(middle - radius * np.cos(angle)) * radius * np.sin(angle)
    # There and back.
    total: FloatArray = 2.0 * np.pi / n * values.sum(axis=1)
    return total


def _of_loop(
    rate: Callable[[FloatArray], FloatArray], lower: FloatArray, upper: FloatArray, n: int
) -> FloatArray:
    steps = (np.arange(n) + 0.5) / n
    values = rate(lower + (upper - lower) * steps)
    total: FloatArray = ((upper - lower)[:, 0] / n) * values.sum(axis=1)
    return total


ENDPOINT_RELATIVE_DISTANCE = 1e-6
"""Relative distance up to which an end of a window is taken for a zero; zeros are simple, hence apart."""
LAMBDA_RELATIVE_ROUNDING = 1e-15
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
        most = Measured(widest, 8.0 * LAMBDA_RELATIVE_ROUNDING * widest)
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
    point = float(v)
    turns = round(point / np.pi)
    x = point - turns * np.pi
    pole = 1.0 if turns % 2 == 0 else -1.0
    if abs(x) < 1e-300 or v.contains(arb.pi() * turns):
        nothing, flat = np.zeros(count), np.full(count, pole)
        return _End(np.full((count, 1), turns * np.pi), (nothing, nothing), (flat, flat))
    on_other = (np.sin(point) > 0.0) != (half.shape.third_sign > 0)
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
    widths = np.where(off <= ENDPOINT_RELATIVE_DISTANCE * x, zeros.high[row] - zeros.low[row], np.inf)
    best = int(np.argmin(widths)) if off.size else 0
    return best if off.size and widths[best] < np.inf else None


def _period(half: PlainHalves, Z: FloatArray, G: FloatArray, arc: Arc, ends: Sequence[_End]) -> Measured:
    lower, upper = (end.v for end in ends)
    if arc.is_whole_loop:
        lower = np.full((len(Z), 1), float(arc.lower))
        upper = lower + 2.0 * np.pi
    return Measured(*periods(half, Z, G, lower, upper, is_loop=arc.is_whole_loop))
