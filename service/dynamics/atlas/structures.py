"""Cuts a range of λ into parts on which the zeros of p² keep their number, order and hemispheres, by proof.

Of a stretch of λ it is proved that p² has certain signs on certain parts of the curve, and one simple zero
between two of them, for every λ in it (:mod:`.pictures`). A stretch of which this is not proved is halved.
What is still open when it is very narrow encloses a value of λ where something changes, or may change.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from service.dynamics.atlas.curves import HalfCurves, LambdaStretch
from service.dynamics.atlas.pictures import Finest, Signature, signature_of
from service.dynamics.atlas.turns import settled_pictures
from service.dynamics.reduction.sign_proofs.signs import Picture

NARROW = 1e-9
"""Relative width of a stretch that is not halved any more."""
RATIO = 2.0
"""Of the ends of the first stretches."""
FINEST, WIDE = 1 / 8, 1e-3
"""Cells are cut to this share of the root of a stretch's width; of one as wide as this without a limit."""
MOST_OPEN = 96
"""Stretches that are halved at a time: with more of them nothing is gained."""


@dataclass(frozen=True, slots=True)
class LambdaPart:
    """Neighbouring stretches with one signature for each half curve; None where that is not proved."""

    stretches: tuple[LambdaStretch, ...]
    """In the order of growing primed λ."""
    signatures: tuple[Signature, ...] | None


@dataclass(frozen=True, slots=True)
class _Open:
    """A stretch, and what is known of each half curve of a stretch that contains it."""

    stretch: LambdaStretch
    pictures: tuple[Picture | None, ...]

    def halves(self) -> "list[_Open]":
        return [_Open(half, self.pictures) for half in self.stretch.halves()]


def parts_of_range(
    halves: Sequence[HalfCurves], first: Sequence[LambdaStretch], is_late: Callable[[], bool]
) -> list[LambdaPart]:
    """Return the parts in the order of growing primed λ; what is open when it ``is_late`` stays open."""
    waiting = [_Open(stretch, (None,) * len(halves)) for stretch in first]
    done: list[tuple[LambdaStretch, tuple[Signature, ...] | None]] = []
    while waiting:
        following: list[_Open] = []
        for inverse in (False, True):
            chosen = [each for each in waiting if each.stretch.is_inverse == inverse]
            if not chosen:
                continue
            for known, signatures in _look_again(halves, chosen):
                if signatures is None and known.stretch.width > NARROW:
                    following.append(known)
                else:
                    done.append((known.stretch, signatures))
        if len(following) > MOST_OPEN or is_late():
            done.extend((each.stretch, None) for each in following)
            break
        waiting = [half for each in following for half in each.halves()]
    return _joined(sorted(done, key=lambda each: _place(each[0])))


def _look_again(
    halves: Sequence[HalfCurves], waiting: Sequence[_Open]
) -> list[tuple[_Open, tuple[Signature, ...] | None]]:
    """Return each stretch with what is known of it now, and its signatures."""
    stretches = [each.stretch for each in waiting]
    # Next to a double zero p² changes by the width of the stretch over the root of it along the curve.
    finest = [
        Finest(float(np.sqrt(each.width)) * FINEST, each.width * FINEST) if each.width < WIDE else Finest()
        for each in stretches
    ]
    columns = [
        settled_pictures(half, stretches, [each.pictures[k] for each in waiting], finest)
        for k, half in enumerate(halves)
    ]
    found: list[tuple[_Open, tuple[Signature, ...] | None]] = []
    for place, stretch in enumerate(stretches):
        pictures = [column[place] for column in columns]
        signatures = [signature_of(picture) for picture in pictures]
        known = tuple(signature for signature in signatures if signature is not None)
        found.append((_Open(stretch, tuple(pictures)), known if len(known) == len(halves) else None))
    return found


def first_stretches(low: float, high: float) -> list[LambdaStretch]:
    """Return stretches with ends of the ratio 2 or less that cover ``low`` ≤ λ ≤ ``high`` (primed λ > 0)."""
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


def _geometric(low: float, high: float) -> list[float]:
    count = max(int(np.ceil(np.log(high / low) / np.log(RATIO))), 1) if high > low else 1
    inner: list[float] = np.geomspace(low, high, count + 1)[1:-1].tolist()
    return [low, *inner, high]


def _place(stretch: LambdaStretch) -> tuple[bool, float]:
    return stretch.is_inverse, -stretch.high if stretch.is_inverse else stretch.low


def _joined(pieces: Sequence[tuple[LambdaStretch, tuple[Signature, ...] | None]]) -> list[LambdaPart]:
    parts: list[LambdaPart] = []
    for stretch, signatures in pieces:
        if parts and parts[-1].signatures == signatures:
            parts[-1] = LambdaPart((*parts[-1].stretches, stretch), signatures)
        else:
            parts.append(LambdaPart((stretch,), signatures))
    return parts
