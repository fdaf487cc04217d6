"""Puts together the atlas of a potential without a formula: seen at single λ, not proved between them."""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from flint import arb

from service.dynamics.atlas.bands import WindowSeries
from service.dynamics.atlas.changes import Beside, Change, change_between
from service.dynamics.atlas.curves import PlainHalves
from service.dynamics.atlas.parts import Atlas, AtlasPart, LambdaRange
from service.dynamics.atlas.seen import (
    NARROW,
    SeenPart,
    Watcher,
    followed,
    seen_parts,
    seen_series,
    seen_zeros,
)
from service.dynamics.atlas.zeros import Zeros
from service.dynamics.errors import DynamicsError

AWAY = 1e-6
"""Distance in log λ from a change, where it is looked at which zeros meet."""
WIDEST = 16.0 * NARROW
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
        is_narrow = abs(other.logarithm - one.logarithm) < WIDEST
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
    away = end.logarithm + (AWAY if place == 0 else -AWAY)
    watcher.look([away])
    sight = watcher.sights[away]
    nearest = sight if sight.signatures == part.signatures else end

    def zeros(k: int) -> Zeros:
        found = seen_zeros(watcher.halves[k], [nearest.single], [nearest.looks[k]])
        assert found is not None
        return found

    return Beside(part.signatures, zeros)
