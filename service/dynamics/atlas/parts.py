"""The parts of an atlas, each window followed over the λ of its part, and the changes between parts.

Periods of many motions are computed at once, in doubles, with an error that is estimated. Between two
simple zeros of P, v = m − r cos θ makes dt = Z dv / (c √P) a smooth function of θ, and round a whole loop
it is periodic in v. The midpoint rule converges fast for both; the number of points is doubled until two
sums agree, and their difference is the estimate.

Between two parts windows appear, vanish, merge or split, or an end moves.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.atlas.curves import LambdaStretch, PlainHalves, equator_of, p_squared
from service.dynamics.atlas.sign_maps import EQUATOR, Signature, signs_in
from service.dynamics.atlas.zeros import Zeros
from service.dynamics.errors import DynamicsError
from service.dynamics.problem import Sign
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


ChangeKind = Literal[
    "window_appears",
    "window_vanishes",
    "windows_merge",
    "window_splits",
    "end_crosses_equator",
    "end_at_pole",
    "several",
]
"""As λ grows. Where a window appears or vanishes its motion is an equilibrium; where windows merge or split
there is a separatrix."""


@dataclass(frozen=True, slots=True)
class Change:
    """The enclosure of a value of λ at which the windows change, in the client's axes."""

    lower: arb
    upper: arb
    kind: ChangeKind
    g1: Measured | None
    """Where on the curve; the error is estimated, as the distance of the two zeros that meet. Shape ()."""
    g2: Measured | None


@dataclass(frozen=True, slots=True)
class Beside:
    """A part next to a change, as seen from it."""

    signatures: tuple[Signature, ...]
    """The signatures of the part, one for each half curve."""
    zeros: Callable[[int], Zeros]
    """Returns the zeros of p² on a half curve, at the λ of the part next to the change; shape (1, zeros)."""


def change_between(
    halves: Sequence[PlainHalves], before: Beside, after: Beside, enclosure: tuple[arb, arb]
) -> Change:
    """Return what changes between two parts, the first with the smaller λ of the client."""
    kinds: list[tuple[ChangeKind, Measured | None, Measured | None]] = []
    for k, half in enumerate(halves):
        if before.signatures[k] != after.signatures[k]:
            kinds.append(_of_half(half, k, before, after))
    kind, g1, g2 = kinds[0]
    if any(each[0] != kind for each in kinds):
        kind, g1, g2 = "several", None, None
    return Change(*enclosure, kind, g1, g2)


def _of_half(
    half: PlainHalves, k: int, before: Beside, after: Beside
) -> tuple[ChangeKind, Measured | None, Measured | None]:
    one, other = (_signs(each.signatures[k]) for each in (before, after))
    if one == other:
        return "end_crosses_equator", None, Measured(np.zeros(()), np.zeros(()))
    if (len(one) - len(other)) % 2:
        return "end_at_pole", Measured(np.zeros(()), np.zeros(())), None
    if len(one) == len(other):
        return "several", None, None
    grows = len(other) > len(one)
    many = after if grows else before
    sign, g1, g2 = _meeting(half, k, many)
    if sign == 0:
        return "several", None, None
    if sign > 0:
        return ("window_appears" if grows else "window_vanishes"), g1, g2
    return ("window_splits" if grows else "windows_merge"), g1, g2


def _signs(signature: Signature) -> list[int]:
    """Return the signs along the whole half curve: those on both sides of the equator are one."""
    border = signature.index(EQUATOR)
    return [*signs_in(signature[:border]), *signs_in(signature[border:])[1:]]


def _meeting(half: PlainHalves, number: int, beside: Beside) -> tuple[int, Measured | None, Measured | None]:
    """Return the sign of p² between the two neighbouring zeros that are closest, and where they are."""
    zeros = beside.zeros(number)
    x = 0.5 * (zeros.low[0] + zeros.high[0])
    v = np.where(zeros.hemisphere > 0, x, np.pi - x)
    gaps = np.diff(v) / np.sin(np.minimum(v[1:], v[:-1]))
    if not gaps.size or np.isnan(gaps).all():
        return 0, None, None
    first = int(np.nanargmin(gaps))
    g1, g2 = (_about(bounds, first) for bounds in _points(half, zeros))
    return _signs(beside.signatures[number])[first + 1], g1, g2


def _points(half: PlainHalves, zeros: Zeros) -> list[tuple[FloatArray, ...]]:
    sign = half.shape.third_sign if half.shape.is_mirrored else half.shape.first_sign
    g1 = tuple(sign * side[0] for side in zeros.size)
    return [g1, tuple(side[0] for side in zeros.height)]


def _about(bounds: tuple[FloatArray, ...], first: int) -> Measured:
    both = np.concatenate([side[first : first + 2] for side in bounds])
    return Measured(np.asarray(0.5 * (both.min() + both.max())), np.asarray(both.max() - both.min()))


Proof = Literal["proved", "seen"]
"""Proved for every λ; or seen at single λ, so that a window narrower than their distance may be missed."""


@dataclass(frozen=True, slots=True)
class LambdaRange:
    """lower ≤ λ ≤ upper, and the signs of g1 and g3."""

    lower: Fraction
    upper: Fraction
    g1_sign: Sign = 1
    g3_sign: Sign = 1

    def primed(self, half: PlainHalves) -> tuple[float, float]:
        """Return the range of the primed λ, rounded outwards."""
        ends = [float(self.lower), float(self.upper)]
        if half.shape.is_mirrored:
            ends = [end ** -float(1 / half.shape.alpha) for end in reversed(ends)]
        # A power in doubles has an error of some units in the last place.
        return ends[0] * (1.0 - 1e-14), ends[1] * (1.0 + 1e-14)

    def ends(self, half: PlainHalves, first: LambdaStretch, last: LambdaStretch) -> tuple[arb, arb]:
        """Return the λ of the client's axes between which two stretches and all between them are."""
        found = [*half.sent(first), *half.sent(last)]
        lower = min(found, key=lambda end: float(end.mid()))
        upper = max(found, key=lambda end: float(end.mid()))
        least, most = (arb(end.numerator) / end.denominator for end in (self.lower, self.upper))
        return (least if lower < least else lower), (most if upper > most else upper)

    def samples_between(self, ends: tuple[arb, arb], samples: int, fewest: int) -> int:
        """Return how many of all ``samples`` belong to a part of the range."""
        share = np.log(float(ends[1].mid()) / float(ends[0].mid())) / np.log(float(self.upper / self.lower))
        return max(round(samples * float(share)), fewest)


@dataclass(frozen=True, slots=True)
class AtlasPart:
    """A part of the range on which the windows keep their number, kinds and ends."""

    lower: arb
    upper: arb
    series: WindowSeries | None
    """None, with ``reason``, where the kind of the windows is not settled at the λ that was looked at."""
    reason: DynamicsError | None


@dataclass(frozen=True, slots=True)
class Atlas:
    """All planar motions over a range of λ, in the order of growing λ of the client's axes."""

    range: LambdaRange
    parts: tuple[AtlasPart, ...]
    changes: tuple[Change, ...]
    """Outside of them and of ``undecided`` nothing changes."""
    undecided: tuple[tuple[arb, arb], ...]
    proof: Proof = "proved"
    """The proof that all its parts and changes have."""
