"""The atlas of a potential without a formula: sampled at single λ, not proved between them.

Signs of p² along the curve are computed in doubles. Where two neighbouring λ differ the
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

from service.dynamics.atlas.curves import (
    GridSigns,
    LambdaStretch,
    PlainHalves,
    d_on_curves,
    equator_of,
    grid_signs_at,
    motion_at,
    radicand_ball,
    trusted_points,
    zero_between,
)
from service.dynamics.atlas.parts import (
    Atlas,
    AtlasPart,
    Beside,
    Change,
    LambdaRange,
    Measured,
    WindowSeries,
    change_between,
    series_of,
)
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
MAX_RESAMPLING_ROUNDS = 4
"""So often the λ that parts are followed at may show something new."""
ZERO_RELATIVE_WIDTHS = [2.0**k for k in range(-49, -18, 3)]
"""Relative widths to both sides of a estimated zero that are tried."""
ENERGY_ANGLES = (1.0, 0.4, 2.2)


@dataclass(frozen=True, slots=True)
class SampledLambda:
    """The signs of p² along all half curves at one λ, in doubles."""

    logarithm: float
    """log of the primed λ."""
    single: LambdaStretch
    grids: tuple[GridSigns, ...]

    @property
    def signatures(self) -> Signatures:
        """The signs along each half curve."""
        return tuple(grid.signature for grid in self.grids)


@dataclass(frozen=True, slots=True)
class SampledPart:
    """Neighbouring λ with equal signs, in the order of growing primed λ."""

    sampled: tuple[SampledLambda, ...]

    @property
    def signatures(self) -> Signatures:
        """The signs along each half curve, at all of them."""
        return self.sampled[0].signatures


class Sampler:
    """Computes the signs at single λ of the half curves of one potential, each λ once."""

    def __init__(self, halves: Sequence[PlainHalves], low: float, high: float) -> None:
        self.halves = halves
        ends = [single_at(t) for t in (low, 0.5 * (low + high), high)]
        self._points = trusted_points(halves, ends)
        self.sampled: dict[float, SampledLambda] = {}

    def sample(self, logarithms: Sequence[float]) -> None:
        """Compute the signs at these λ."""
        fresh = sorted({t for t in logarithms if t not in self.sampled})
        if not fresh:
            return
        single = [single_at(t) for t in fresh]
        columns = [grid_signs_at(half, self._points, single) for half in self.halves]
        for t, each, *grids in zip(fresh, single, *columns, strict=True):
            self.sampled[t] = SampledLambda(t, each, tuple(grids))

    def in_order(self) -> list[SampledLambda]:
        """Return all λ so far, in the order of growing primed λ."""
        return [self.sampled[t] for t in sorted(self.sampled)]

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
            self.sample(wide)

    def parts(self) -> list[SampledPart]:
        """Return the runs of λ with equal signs; one as narrow as a change belongs to it."""
        runs: list[list[SampledLambda]] = []
        for each in self.in_order():
            if runs and runs[-1][-1].signatures == each.signatures:
                runs[-1].append(each)
            else:
                runs.append([each])
        kept = [run for run in runs if run[-1].logarithm - run[0].logarithm > 4.0 * CHANGE_LOG_WIDTH]
        return [SampledPart(tuple(run)) for run in kept or runs[:1]]


def single_at(logarithm: float) -> LambdaStretch:
    """Return the primed λ of a logarithm."""
    k = min(float(np.exp(-abs(logarithm))), 1.0)
    return LambdaStretch(logarithm > 0.0, k, k)


def sampled_parts(
    sampler: Sampler, low: float, high: float, samples: int, fewest: int, is_late: Callable[[], bool]
) -> list[SampledPart]:
    """Return the parts between these logarithms of the primed λ, each seen at ``fewest`` λ or more."""
    sampler.sample(np.linspace(low, high, samples).tolist())
    parts: list[SampledPart] = []
    for _ in range(MAX_RESAMPLING_ROUNDS):
        sampler.halve(is_late)
        found = sampler.parts()
        if is_late() or [part.signatures for part in found] == [part.signatures for part in parts]:
            return found
        parts = found
        for part in parts:
            sampler.sample(followed(part, low, high, samples, fewest))
    return sampler.parts()


def followed(part: SampledPart, low: float, high: float, samples: int, fewest: int) -> list[float]:
    """Return the logarithms at which a part is followed, denser towards its ends."""
    first, last = part.sampled[0].logarithm, part.sampled[-1].logarithm
    count = max(round(samples * (last - first) / (high - low)), fewest)
    shares = 0.5 - 0.5 * np.cos(np.pi * np.arange(count) / (count - 1))
    return [first, *(first + (last - first) * shares[1:-1]).tolist(), last]


def sampled_series(
    halves: Sequence[PlainHalves],
    sampled: Sequence[SampledLambda],
    is_late: Callable[[], bool],
    *,
    has_periods: bool,
) -> WindowSeries | DynamicsError | None:
    """Return the windows at these λ, or why they are not decided; None if it is late or two ways see others.

    ``sampled`` are in the order of the client's λ, and all show the same.
    """
    row = len(sampled) // 2
    single = [each.single for each in sampled]
    half = halves[0]
    if is_late():
        return None
    try:
        windows = find_windows(half.body, half.potential, motion_at(half, single[row]))
    except DynamicsError as refusal:
        return refusal
    if not _agree(windows, sampled[row].grids[0]):
        return None
    zeros = list[Zeros]()
    for k, each in enumerate(halves):
        found = sampled_zeros(each, single, [each.grids[k] for each in sampled], is_late)
        if found is None:
            return None
        zeros.append(found)
    energy = _energies(half, single)
    return series_of(halves, zeros, single, windows, row, energy, has_periods=has_periods)


def _agree(windows: Sequence[Window], grid: GridSigns) -> bool:
    """Tell whether the half has as many stretches with p² > 0 as windows have arcs."""
    # On both sides of the equator the sign is the same.
    positive = [sign == 1 for sign in grid.signature if sign != EQUATOR]
    return sum(len(window.arcs) for window in windows) == sum(key for key, _ in groupby(positive))


def sampled_zeros(
    half: PlainHalves,
    single: Sequence[LambdaStretch],
    grids: Sequence[GridSigns],
    is_late: Callable[[], bool] = lambda: False,
) -> Zeros | None:
    """Return the zeros that were seen, each between two places where balls have different signs.

    NaN where they have not. None if it is late.
    """
    hemisphere = grids[0].hemisphere
    shape = len(single), len(hemisphere)
    low, high = (np.stack([getattr(grid, end) for grid in grids]) for end in ("low", "high"))
    Z, G = equator_of(half, single)
    side = hemisphere[None, :].astype(np.float64)
    estimates = zero_between(lambda x: d_on_curves(half, Z, G, side, x), low, high) if low.size else low
    bounds = np.full((6, *shape), np.nan)
    for row, each in enumerate(single):
        if is_late():
            return None
        loop = make_loop(half.body, half.potential, motion_at(half, each))
        for k in range(shape[1]):
            bounds[:, row, k] = _enclosed(half, loop, float(hemisphere[k]), float(estimates[row, k]))
    x, size, height = bounds[:2], bounds[2:4], bounds[4:]
    return Zeros(x[0], x[1], hemisphere, (size[0], size[1]), (height[0], height[1]))


def _enclosed(half: PlainHalves, loop: Loop, side: float, estimate: float) -> list[float]:
    """Return bounds of the distance from the pole, of |g1| and of g2 at a zero, in doubles."""
    if not estimate > 0.0:
        return [np.nan] * 6
    for width in ZERO_RELATIVE_WIDTHS:
        ends = arb(estimate * (1.0 - width)), arb(estimate * (1.0 + width))
        one, other = (radicand_ball(half, loop, side, x) for x in ends)
        if not ((one < 0 and other > 0) or (one > 0 and other < 0)):
            continue
        points = [_point(half, loop, side, x) for x in ends]
        return [float(x) for x in ends] + [
            bound for k in (0, 1) for bound in _between(points[0][k], points[1][k])
        ]
    return [np.nan] * 6


def _point(half: PlainHalves, loop: Loop, side: float, x: arb) -> tuple[arb, arb]:
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
"""Width in log λ of what counts as a change."""


def sampled_atlas(
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
    sampler = Sampler(halves, low, high)
    parts = sampled_parts(sampler, low, high, samples, fewest, is_late)
    if halves[0].shape.is_mirrored:
        parts = parts[::-1]
    found, changes, undecided = list[AtlasPart](), list[Change](), list[tuple[arb, arb]]()
    # From the end of one part to the beginning of the next, in the order of the client's λ.
    end, start = (0, -1) if halves[0].shape.is_mirrored else (-1, 0)
    for before, after in pairwise(parts):
        one, other = before.sampled[end], after.sampled[start]
        between = over.ends(halves[0], one.single, other.single)
        is_narrow = abs(other.logarithm - one.logarithm) < MAX_CHANGE_LOG_WIDTH
        if not is_narrow or before.signatures == after.signatures or is_late():
            undecided.append(between)
        else:
            besides = _beside(sampler, before, end), _beside(sampler, after, start)
            changes.append(change_between(halves, *besides, between))
    for part in parts:
        ends = over.ends(halves[0], part.sampled[0].single, part.sampled[-1].single)
        wanted = followed(part, low, high, samples, fewest)
        series = _series(sampler, part, wanted, is_late, has_periods=has_periods)
        if series is None:
            undecided.append(ends)
        elif isinstance(series, DynamicsError):
            found.append(AtlasPart(*ends, None, series))
        else:
            found.append(AtlasPart(*ends, series, None))
    undecided.sort(key=lambda ends: float(ends[0].mid()))
    return Atlas(over, tuple(found), tuple(changes), tuple(undecided), "seen")


def _series(
    sampler: Sampler,
    part: SampledPart,
    wanted: Sequence[float],
    is_late: Callable[[], bool],
    *,
    has_periods: bool,
) -> WindowSeries | DynamicsError | None:
    """Return the windows at the wanted λ, or why they are not decided; None if it is late or signs differ."""
    if is_late():
        return None
    sampler.sample(wanted)
    sampled = [sampler.sampled[t] for t in wanted]
    # At the last λ that are looked at something new may be seen.
    if any(each.signatures != part.signatures for each in sampled):
        return None
    if sampler.halves[0].shape.is_mirrored:
        sampled.reverse()
    return sampled_series(sampler.halves, sampled, is_late, has_periods=has_periods)


def _beside(sampler: Sampler, part: SampledPart, end_index: int) -> Beside:
    """Return the part as it is next to a change, and far enough from it that the zeros are apart."""
    end = part.sampled[end_index]
    away = end.logarithm + (PROBE_LOG_DISTANCE if end_index == 0 else -PROBE_LOG_DISTANCE)
    sampler.sample([away])
    sampled = sampler.sampled[away]
    nearest = sampled if sampled.signatures == part.signatures else end

    def zeros(k: int) -> Zeros:
        found = sampled_zeros(sampler.halves[k], [nearest.single], [nearest.grids[k]])
        assert found is not None
        return found

    return Beside(part.signatures, zeros)
