"""Cuts a range of λ into parts on which the zeros of p² keep their number, order and hemispheres, by proof.

Of a stretch of λ it is proved that p² has certain signs on certain parts of the curve, and one simple zero
between two of them, for every λ in it (:mod:`.sign_maps`). A stretch of which this is not proved is halved.
What is still open when it is very narrow encloses a value of λ where something changes, or may change.

Where to cut is estimated in doubles, and bounds decide about the estimates.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np
from numpy.typing import NDArray

from service.dynamics.atlas.curves import HalfCurves, LambdaStretch, d_on_curves, equator_of, zero_between
from service.dynamics.atlas.sign_maps import Finest, Signature, compact, signature_of
from service.dynamics.atlas.turns import settled_sign_maps, turning_gaps, turning_points
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import QUARTER_TURN
from service.dynamics.reduction.sign_proofs.signs import SignMap

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MAX_ESTIMATE_RELATIVE_WIDTH, MIN_ESTIMATE_RELATIVE_WIDTH = 3e-3, 1e-7
"""Relative widths of the stretches in which a change is estimated."""
ESTIMATE_RELATIVE_ERROR = 1e-11
"""Relative error of a estimate, less than stretches are cut to."""


def estimated_changes(
    halves: Sequence[HalfCurves], waiting: Sequence[tuple[LambdaStretch, Sequence[SignMap | None]]]
) -> list[float | None]:
    """Return for each stretch the k at which two zeros seem to meet, or one to cross the equator, or None."""
    found: list[float | None] = [None] * len(waiting)
    for number, half in enumerate(halves):
        for inverse in (False, True):
            chosen = [
                k
                for k, (stretch, _) in enumerate(waiting)
                if stretch.is_inverse == inverse
                and MIN_ESTIMATE_RELATIVE_WIDTH < stretch.width < MAX_ESTIMATE_RELATIVE_WIDTH
                and found[k] is None
            ]
            if chosen:
                stretches = [waiting[k][0] for k in chosen]
                sign_maps = [waiting[k][1][number] for k in chosen]
                for k, point in zip(chosen, _estimated(half, stretches, sign_maps), strict=True):
                    found[k] = point
    return found


def _estimated(
    half: HalfCurves, stretches: Sequence[LambdaStretch], sign_maps: Sequence[SignMap | None]
) -> list[float | None]:
    at_equator = _zeros(lambda owners, k: _at_equator(half, _single(stretches, owners, k)), stretches)
    found = [None if np.isnan(point) else float(point) for point in at_equator]
    gaps = [
        gap
        for k, sign_map in enumerate(sign_maps)
        if sign_map is not None and found[k] is None
        for gap in turning_gaps(k, sign_map)
    ]
    if gaps:
        owned = [stretches[gap.owner] for gap in gaps]

        def turning_value(owners: IntArray, k: FloatArray) -> FloatArray:
            single, own = _single(owned, owners, k), [gaps[int(n)] for n in owners]
            side = np.array([gap.hemisphere for gap in own])[:, None]
            points = turning_points(half, single, own)
            Z, G = equator_of(half, single)
            return d_on_curves(half, Z, G, side, points[:, None])[:, 0]

        for gap, point in zip(gaps, _zeros(turning_value, owned), strict=True):
            if not np.isnan(point):
                found[gap.owner] = float(point)
    return found


def _single(stretches: Sequence[LambdaStretch], owners: IntArray, k: FloatArray) -> list[LambdaStretch]:
    return [
        LambdaStretch(stretches[int(n)].is_inverse, value, value)
        for n, value in zip(owners, k.tolist(), strict=True)
    ]


def _at_equator(half: HalfCurves, single: Sequence[LambdaStretch]) -> FloatArray:
    Z, G = equator_of(half, single)
    return d_on_curves(half, Z, G, np.ones((len(single), 1)), np.full((len(single), 1), QUARTER_TURN))[:, 0]


def _zeros(
    value: Callable[[IntArray, FloatArray], FloatArray], stretches: Sequence[LambdaStretch]
) -> FloatArray:
    """Return a k of each stretch where ``value`` changes its sign; NaN where its ends have the same one."""
    low = np.array([each.low for each in stretches])
    high = np.array([each.high for each in stretches])
    everyone = np.arange(len(stretches))
    at_low, at_high = value(everyone, low), value(everyone, high)
    found = np.full(len(stretches), np.nan)
    changing = np.flatnonzero(at_low * at_high < 0.0)
    if not changing.size:
        return found
    owners = everyone[changing]
    found[changing] = zero_between(
        lambda k: value(owners, k), low[changing], high[changing], ESTIMATE_RELATIVE_ERROR
    )
    return found


STRETCH_MIN_RELATIVE_WIDTH, STRAY_MIN_RELATIVE_WIDTH = 1e-9, 1e-11
"""Relative width of a stretch that is not cut any more; and of one between two parts that are alike."""
FIRST_STRETCH_RATIO = 1.3
"""Largest ratio of the two ends of a first stretch."""
CELL_WIDTH_SHARE, UNLIMITED_RELATIVE_WIDTH = 1 / 8, 1e-3
"""Cells are cut to this share of the root of a stretch's width; of one as wide as this without a limit, but
for those next to the equator."""
STRETCHES_TOGETHER, MAX_CUT_PARTS = 16, 8
"""About so many stretches are looked at together; into so many one is cut."""
WIDE_CUT_ROUNDS = 2
"""Cells of a wide stretch are cut so often; then it is cheaper to cut the stretch."""
MAX_STRETCHES_HALVED = 256
"""Stretches that are halved at a time: with more of them nothing is gained."""

Signatures = tuple[Signature, ...]
"""The signatures of the half curves, one for each."""


@dataclass(frozen=True, slots=True)
class MappedStretch:
    """A stretch, and what is known of each half curve for all its λ."""

    stretch: LambdaStretch
    sign_maps: tuple[SignMap | None, ...]

    def parts(self, count: int) -> "list[MappedStretch]":
        """Return so many parts, of which as much is known."""
        return [MappedStretch(part, self.sign_maps) for part in self.stretch.parts(count)]


@dataclass(frozen=True, slots=True)
class LambdaPart:
    """Neighbouring stretches with one signature for each half curve; None where that is not proved."""

    mapped: tuple[MappedStretch, ...]
    """In the order of growing primed λ."""
    signatures: Signatures | None

    @property
    def stretches(self) -> tuple[LambdaStretch, ...]:
        """The stretches alone."""
        return tuple(each.stretch for each in self.mapped)

    @property
    def is_narrow(self) -> bool:
        """No stretch of it is cut any more."""
        return all(each.stretch.width <= STRETCH_MIN_RELATIVE_WIDTH for each in self.mapped)

    def sign_maps_at(self, single: LambdaStretch, half: int) -> SignMap | None:
        """Return what is known of a half curve at a single λ; None outside of the stretches."""
        for each in self.mapped:
            stretch = each.stretch
            if stretch.is_inverse == single.is_inverse and stretch.low <= single.low <= stretch.high:
                return each.sign_maps[half]
        return None


def parts_of_range(
    halves: Sequence[HalfCurves], first: Sequence[LambdaStretch], is_late: Callable[[], bool]
) -> list[LambdaPart]:
    """Return the parts in the order of growing primed λ; what is open when it ``is_late`` stays open."""
    parts = _joined(
        _settled(
            halves,
            [MappedStretch(each, (None,) * len(halves)) for each in first],
            STRETCH_MIN_RELATIVE_WIDTH,
            is_late,
        )
    )
    stray = [
        part
        for before, part, after in zip(parts, parts[1:], parts[2:], strict=False)
        if part.signatures is None and before.signatures == after.signatures and part.is_narrow
    ]
    if not stray:
        return parts
    again = [small for part in stray for each in part.mapped for small in each.parts(MAX_CUT_PARTS)]
    known = {part.mapped[0].stretch for part in stray}
    rest = [
        (each, part.signatures)
        for part in parts
        if part.mapped[0].stretch not in known
        for each in part.mapped
    ]
    return _joined([*rest, *_settled(halves, again, STRAY_MIN_RELATIVE_WIDTH, is_late)])


def _settled(
    halves: Sequence[HalfCurves], waiting: Sequence[MappedStretch], narrow: float, is_late: Callable[[], bool]
) -> list[tuple[MappedStretch, Signatures | None]]:
    """Return stretches with their signatures; those without are at most ``narrow``, or it was late."""
    done: list[tuple[MappedStretch, Signatures | None]] = []
    while waiting:
        following: list[MappedStretch] = []
        for inverse in (False, True):
            chosen = [each for each in waiting if each.stretch.is_inverse == inverse]
            if not chosen:
                continue
            for known, signatures in _look_again(halves, chosen):
                if signatures is None and known.stretch.width > narrow:
                    following.append(known)
                else:
                    done.append((known, signatures))
        if len(following) > MAX_STRETCHES_HALVED or is_late():
            done.extend((each, None) for each in following)
            break
        waiting = _cut(halves, following)
    return done


def _cut(halves: Sequence[HalfCurves], following: Sequence[MappedStretch]) -> list[MappedStretch]:
    """Return parts of open stretches, the finer the nearer a estimated change is, else equal ones."""
    count = min(max(STRETCHES_TOGETHER // max(len(following), 1), 2), MAX_CUT_PARTS)
    estimated = estimated_changes(halves, [(each.stretch, each.sign_maps) for each in following])
    cut = list[MappedStretch]()
    for each, point in zip(following, estimated, strict=True):
        stretch = each.stretch
        parts = (
            stretch.parts(count)
            if point is None
            else stretch.parts_towards(point, 2.0 * STRETCH_MIN_RELATIVE_WIDTH)
        )
        cut.extend(MappedStretch(part, each.sign_maps) for part in parts)
    return cut


def _look_again(
    halves: Sequence[HalfCurves], waiting: Sequence[MappedStretch]
) -> list[tuple[MappedStretch, Signatures | None]]:
    """Return each stretch with what is known of it now, and its signatures."""
    stretches = [each.stretch for each in waiting]
    # Next to a double zero p² changes by the width of the stretch over the root of it along the curve.
    finest = [
        Finest(float(np.sqrt(each.width)) * CELL_WIDTH_SHARE, each.width * CELL_WIDTH_SHARE)
        if each.width < UNLIMITED_RELATIVE_WIDTH
        else Finest(0.0, each.width * CELL_WIDTH_SHARE, WIDE_CUT_ROUNDS)
        for each in stretches
    ]
    columns = [
        settled_sign_maps(half, stretches, [each.sign_maps[k] for each in waiting], finest)
        for k, half in enumerate(halves)
    ]
    found: list[tuple[MappedStretch, Signatures | None]] = []
    for index, stretch in enumerate(stretches):
        sign_maps = [column[index] for column in columns]
        signatures = [signature_of(sign_map) for sign_map in sign_maps]
        known = tuple(signature for signature in signatures if signature is not None)
        mapped = MappedStretch(stretch, tuple(compact(sign_map) for sign_map in sign_maps))
        found.append((mapped, known if len(known) == len(halves) else None))
    return found


def first_stretches(low: float, high: float) -> list[LambdaStretch]:
    """Return stretches that cover ``low`` ≤ primed λ ≤ ``high``, with ends of FIRST_STRETCH_RATIO or less."""
    found: list[LambdaStretch] = []
    if low < 1.0:
        top = min(high, 1.0)
        ends = _geometric(low, top)
        found.extend(LambdaStretch(False, a, b) for a, b in pairwise(ends))
    if high > 1.0:
        # 1/λ is rounded: the stretches cover a little more.
        ends = _geometric(
            float(np.nextafter(1.0 / high, 0.0)), min(float(np.nextafter(1.0 / max(low, 1.0), 2.0)), 1.0)
        )
        found.extend(LambdaStretch(True, a, b) for a, b in pairwise(ends))
    return found


def whole_range(first: Sequence[LambdaStretch], halves: int) -> LambdaPart:
    """Return all stretches as one part of which nothing is known along the curves."""
    ordered = sorted(first, key=_order_key)
    return LambdaPart(tuple(MappedStretch(each, (None,) * halves) for each in ordered), None)


def _geometric(low: float, high: float) -> list[float]:
    count = max(int(np.ceil(np.log(high / low) / np.log(FIRST_STRETCH_RATIO))), 1) if high > low else 1
    inner: list[float] = np.geomspace(low, high, count + 1)[1:-1].tolist()
    return [low, *inner, high]


def _order_key(stretch: LambdaStretch) -> tuple[bool, float]:
    return stretch.is_inverse, -stretch.high if stretch.is_inverse else stretch.low


def _joined(pieces: Sequence[tuple[MappedStretch, Signatures | None]]) -> list[LambdaPart]:
    ordered = sorted(pieces, key=lambda each: _order_key(each[0].stretch))
    parts: list[LambdaPart] = []
    for signatures, group in groupby(ordered, key=lambda each: each[1]):
        parts.append(LambdaPart(tuple(mapped for mapped, _ in group), signatures))
    return parts
