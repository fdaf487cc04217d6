"""The atlas of a potential without a formula: sampled at single λ, not proved between them.

Signs of p² along the curve are computed in doubles (:mod:`.grid_signs`). Where two neighbouring λ differ the
stretch between them is halved, until it is narrow: it encloses a change, if the signs at both ends are
true. A window that opens and closes between two neighbouring λ is missed. Ends of windows are enclosed in
balls, and the kinds of the windows are those that a single motion finds at one λ of the part.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.atlas.bands import Measured, WindowSeries, series_of
from service.dynamics.atlas.curves import (
    LambdaStretch,
    PlainHalves,
    d_on_curves,
    equator_of,
    motion_at,
    zero_between,
)
from service.dynamics.atlas.grid_signs import Look, looks_at, radicand_ball, trusted_places
from service.dynamics.atlas.parts import Atlas, AtlasPart, Beside, Change, LambdaRange, change_between
from service.dynamics.atlas.sign_maps import EQUATOR, Signature
from service.dynamics.atlas.zeros import Zeros
from service.dynamics.errors import DynamicsError
from service.dynamics.reduction.geometry.loop import Loop, make_loop
from service.dynamics.reduction.window import Window
from service.dynamics.reduction.windows import find_windows

FloatArray = NDArray[np.float64]
Signatures = tuple[Signature, ...]

CHANGE_LOG_WIDTH = 1e-10
"""Width in log λ down to which a stretch with different ends is halved."""
MAX_HALVINGS = 60
"""Halvings: from a range of 1e18 to CHANGE_LOG_WIDTH."""
MAX_RESAMPLINGS = 4
"""So often the λ that parts are followed at may show something new."""
ZERO_RELATIVE_WIDTHS = [2.0**k for k in range(-49, -18, 3)]
"""Relative widths to both sides of a guessed zero that are tried."""
ENERGY_ANGLES = (1.0, 0.4, 2.2)


@dataclass(frozen=True, slots=True)
class Sight:
    """The signs of p² seen along all half curves at one λ."""

    logarithm: float
    """log of the primed λ."""
    single: LambdaStretch
    looks: tuple[Look, ...]

    @property
    def signatures(self) -> Signatures:
        """The signs along each half curve."""
        return tuple(look.signature for look in self.looks)


@dataclass(frozen=True, slots=True)
class SeenPart:
    """Neighbouring λ at which the same is seen, in the order of growing primed λ."""

    sights: tuple[Sight, ...]

    @property
    def signatures(self) -> Signatures:
        """The signs along each half curve, at all of them."""
        return self.sights[0].signatures


class Watcher:
    """Looks at λ of the half curves of one potential, and remembers what it saw."""

    def __init__(self, halves: Sequence[PlainHalves], low: float, high: float) -> None:
        self.halves = halves
        ends = [single_at(t) for t in (low, 0.5 * (low + high), high)]
        self._places = trusted_places(halves, ends)
        self.sights: dict[float, Sight] = {}

    def look(self, logarithms: Sequence[float]) -> None:
        """Look at these λ."""
        fresh = sorted({t for t in logarithms if t not in self.sights})
        if not fresh:
            return
        single = [single_at(t) for t in fresh]
        columns = [looks_at(half, self._places, single) for half in self.halves]
        for t, each, *looks in zip(fresh, single, *columns, strict=True):
            self.sights[t] = Sight(t, each, tuple(looks))

    def in_order(self) -> list[Sight]:
        """Return everything seen, in the order of growing primed λ."""
        return [self.sights[t] for t in sorted(self.sights)]

    def halve(self, is_late: Callable[[], bool]) -> None:
        """Halve the stretches between neighbours that differ until they are narrow, or it is late."""
        for _ in range(MAX_HALVINGS):
            wide = [
                0.5 * (one.logarithm + other.logarithm)
                for one, other in pairwise(self.in_order())
                if one.signatures != other.signatures and other.logarithm - one.logarithm > CHANGE_LOG_WIDTH
            ]
            if not wide or is_late():
                return
            self.look(wide)

    def parts(self) -> list[SeenPart]:
        """Return the runs of λ at which the same is seen; one as narrow as a change belongs to it."""
        runs: list[list[Sight]] = []
        for sight in self.in_order():
            if runs and runs[-1][-1].signatures == sight.signatures:
                runs[-1].append(sight)
            else:
                runs.append([sight])
        kept = [run for run in runs if run[-1].logarithm - run[0].logarithm > 4.0 * CHANGE_LOG_WIDTH]
        return [SeenPart(tuple(run)) for run in kept or runs[:1]]


def single_at(logarithm: float) -> LambdaStretch:
    """Return the primed λ of a logarithm."""
    k = min(float(np.exp(-abs(logarithm))), 1.0)
    return LambdaStretch(logarithm > 0.0, k, k)


def seen_parts(
    watcher: Watcher, low: float, high: float, samples: int, fewest: int, is_late: Callable[[], bool]
) -> list[SeenPart]:
    """Return the parts between these logarithms of the primed λ, each seen at ``fewest`` λ or more."""
    watcher.look(np.linspace(low, high, samples).tolist())
    parts: list[SeenPart] = []
    for _ in range(MAX_RESAMPLINGS):
        watcher.halve(is_late)
        found = watcher.parts()
        if is_late() or [part.signatures for part in found] == [part.signatures for part in parts]:
            return found
        parts = found
        for part in parts:
            watcher.look(followed(part, low, high, samples, fewest))
    return watcher.parts()


def followed(part: SeenPart, low: float, high: float, samples: int, fewest: int) -> list[float]:
    """Return the logarithms at which a part is followed, denser towards its ends."""
    first, last = part.sights[0].logarithm, part.sights[-1].logarithm
    count = max(round(samples * (last - first) / (high - low)), fewest)
    shares = 0.5 - 0.5 * np.cos(np.pi * np.arange(count) / (count - 1))
    return [first, *(first + (last - first) * shares[1:-1]).tolist(), last]


def seen_series(
    halves: Sequence[PlainHalves],
    sights: Sequence[Sight],
    is_late: Callable[[], bool],
    *,
    has_periods: bool,
) -> WindowSeries | DynamicsError | None:
    """Return the windows at these λ, or why they are not told; None if it is late or two ways see others.

    ``sights`` are in the order of the client's λ, and all show the same.
    """
    row = len(sights) // 2
    single = [sight.single for sight in sights]
    half = halves[0]
    if is_late():
        return None
    try:
        windows = find_windows(half.body, half.potential, motion_at(half, single[row]))
    except DynamicsError as refusal:
        return refusal
    if not _agree(windows, sights[row].looks[0]):
        return None
    zeros = list[Zeros]()
    for k, each in enumerate(halves):
        found = seen_zeros(each, single, [sight.looks[k] for sight in sights], is_late)
        if found is None:
            return None
        zeros.append(found)
    energy = _energies(half, single)
    return series_of(halves, zeros, single, windows, row, energy, has_periods=has_periods)


def _agree(windows: Sequence[Window], look: Look) -> bool:
    """Tell whether the half has as many stretches with p² > 0 as windows have arcs."""
    # On both sides of the equator the sign is the same.
    positive = [sign == 1 for sign in look.signature if sign != EQUATOR]
    return sum(len(window.arcs) for window in windows) == sum(key for key, _ in groupby(positive))


def seen_zeros(
    half: PlainHalves,
    single: Sequence[LambdaStretch],
    looks: Sequence[Look],
    is_late: Callable[[], bool] = lambda: False,
) -> Zeros | None:
    """Return the zeros that were seen, each between two places where balls have different signs.

    NaN where they have not. None if it is late.
    """
    hemisphere = looks[0].hemisphere
    shape = len(single), len(hemisphere)
    low, high = (np.stack([getattr(look, end) for look in looks]) for end in ("low", "high"))
    Z, G = equator_of(half, single)
    side = hemisphere[None, :].astype(np.float64)
    guesses = zero_between(lambda x: d_on_curves(half, Z, G, side, x), low, high) if low.size else low
    bounds = np.full((6, *shape), np.nan)
    for row, each in enumerate(single):
        if is_late():
            return None
        loop = make_loop(half.body, half.potential, motion_at(half, each))
        for k in range(shape[1]):
            bounds[:, row, k] = _enclosed(half, loop, float(hemisphere[k]), float(guesses[row, k]))
    x, size, height = bounds[:2], bounds[2:4], bounds[4:]
    return Zeros(x[0], x[1], hemisphere, (size[0], size[1]), (height[0], height[1]))


def _enclosed(half: PlainHalves, loop: Loop, side: float, guess: float) -> list[float]:
    """Return bounds of the distance from the pole, of |g1| and of g2 at a zero, in doubles."""
    if not guess > 0.0:
        return [np.nan] * 6
    for width in ZERO_RELATIVE_WIDTHS:
        ends = arb(guess * (1.0 - width)), arb(guess * (1.0 + width))
        one, other = (radicand_ball(half, loop, side, x) for x in ends)
        if not ((one < 0 and other > 0) or (one > 0 and other < 0)):
            continue
        places = [_place(half, loop, side, x) for x in ends]
        return [float(x) for x in ends] + [
            bound for k in (0, 1) for bound in _between(places[0][k], places[1][k])
        ]
    return [np.nan] * 6


def _place(half: PlainHalves, loop: Loop, side: float, x: arb) -> tuple[arb, arb]:
    """Return |g1| and g2, the first in the client's axes; both are monotone from a pole to the equator."""
    sine, cosine = x.sin_cos()
    at = loop.point_from(sine, cosine if side > 0 else -cosine)
    return abs(at.g3 if half.shape.is_mirrored else at.g1), at.g2


def _between(one: arb, other: arb) -> tuple[float, float]:
    both = one.union(other)
    return float(np.nextafter(float(both.lower()), -np.inf)), float(np.nextafter(float(both.upper()), np.inf))


def _energies(half: PlainHalves, single: Sequence[LambdaStretch]) -> Measured:
    """Return h in balls, which is the same at every place of a curve."""
    found = []
    for each in single:
        loop = make_loop(half.body, half.potential, motion_at(half, each))
        values = (loop.energy(arb(v * half.shape.third_sign)) for v in ENERGY_ANGLES)
        value = next((value for value in values if value.is_finite()), None)
        found.append((np.nan, np.nan) if value is None else _between(value, value))
    low, high = np.array(found).T
    return Measured.between(low, high)


PROBE_LOG_DISTANCE = 1e-6
"""Distance in log λ from a change, where it is looked at which zeros meet."""
MAX_CHANGE_LOG_WIDTH = 16.0 * CHANGE_LOG_WIDTH
"""Width in log λ of what is told as a change."""


def seen_atlas(
    halves: Sequence[PlainHalves],
    over: LambdaRange,
    samples: int,
    fewest: int,
    is_late: Callable[[], bool],
    *,
    has_periods: bool,
) -> Atlas:
    """Return what is seen at about ``samples`` λ and, between those that differ, by halving."""
    low, high = (float(np.log(end)) for end in over.primed(halves[0]))
    watcher = Watcher(halves, low, high)
    parts = seen_parts(watcher, low, high, samples, fewest, is_late)
    if halves[0].shape.is_mirrored:
        parts = parts[::-1]
    found, changes, undecided = list[AtlasPart](), list[Change](), list[tuple[arb, arb]]()
    # From the end of one part to the beginning of the next, in the order of the client's λ.
    end, start = (0, -1) if halves[0].shape.is_mirrored else (-1, 0)
    for before, after in pairwise(parts):
        one, other = before.sights[end], after.sights[start]
        between = over.ends(halves[0], one.single, other.single)
        is_narrow = abs(other.logarithm - one.logarithm) < MAX_CHANGE_LOG_WIDTH
        if not is_narrow or before.signatures == after.signatures or is_late():
            undecided.append(between)
        else:
            besides = _beside(watcher, before, end), _beside(watcher, after, start)
            changes.append(change_between(halves, *besides, between))
    for part in parts:
        ends = over.ends(halves[0], part.sights[0].single, part.sights[-1].single)
        wanted = followed(part, low, high, samples, fewest)
        told = _told(watcher, part, wanted, is_late, has_periods=has_periods)
        if told is None:
            undecided.append(ends)
        elif isinstance(told, DynamicsError):
            found.append(AtlasPart(*ends, None, told))
        else:
            found.append(AtlasPart(*ends, told, None))
    undecided.sort(key=lambda ends: float(ends[0].mid()))
    return Atlas(over, tuple(found), tuple(changes), tuple(undecided), "seen")


def _told(
    watcher: Watcher,
    part: SeenPart,
    wanted: Sequence[float],
    is_late: Callable[[], bool],
    *,
    has_periods: bool,
) -> WindowSeries | DynamicsError | None:
    """Return the windows at the wanted λ of a part, or why they are not told; None if that is not decided."""
    if is_late():
        return None
    watcher.look(wanted)
    sights = [watcher.sights[t] for t in wanted]
    # At the last λ that are looked at something new may be seen.
    if any(sight.signatures != part.signatures for sight in sights):
        return None
    if watcher.halves[0].shape.is_mirrored:
        sights.reverse()
    return seen_series(watcher.halves, sights, is_late, has_periods=has_periods)


def _beside(watcher: Watcher, part: SeenPart, place: int) -> Beside:
    """Return the part as it is next to a change, and far enough from it that the zeros are apart."""
    end = part.sights[place]
    away = end.logarithm + (PROBE_LOG_DISTANCE if place == 0 else -PROBE_LOG_DISTANCE)
    watcher.look([away])
    sight = watcher.sights[away]
    nearest = sight if sight.signatures == part.signatures else end

    def zeros(k: int) -> Zeros:
        found = seen_zeros(watcher.halves[k], [nearest.single], [nearest.looks[k]])
        assert found is not None
        return found

    return Beside(part.signatures, zeros)
