"""Guesses in doubles at which λ of a stretch something changes. Bounds decide about what is guessed."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from service.dynamics.atlas.curves import HalfCurves, LambdaStretch
from service.dynamics.atlas.radicands import d_on_curves, equator_of, zero_between
from service.dynamics.atlas.turns import turning_gaps, turning_places
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import QUARTER
from service.dynamics.reduction.sign_proofs.signs import Picture

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

WIDEST, NARROWEST = 3e-3, 1e-7
"""Relative widths of the stretches in which a change is guessed."""
CLOSE = 1e-11
"""Relative error of a guess, less than stretches are cut to."""


def guessed_changes(
    halves: Sequence[HalfCurves], waiting: Sequence[tuple[LambdaStretch, Sequence[Picture | None]]]
) -> list[float | None]:
    """Return for each stretch the k at which two zeros seem to meet, or one to cross the equator, or None."""
    found: list[float | None] = [None] * len(waiting)
    for number, half in enumerate(halves):
        for inverse in (False, True):
            chosen = [
                k
                for k, (stretch, _) in enumerate(waiting)
                if stretch.is_inverse == inverse and NARROWEST < stretch.width < WIDEST and found[k] is None
            ]
            if chosen:
                stretches = [waiting[k][0] for k in chosen]
                pictures = [waiting[k][1][number] for k in chosen]
                for k, place in zip(chosen, _guessed(half, stretches, pictures), strict=True):
                    found[k] = place
    return found


def _guessed(
    half: HalfCurves, stretches: Sequence[LambdaStretch], pictures: Sequence[Picture | None]
) -> list[float | None]:
    at_equator = _zeros(lambda owners, k: _at_equator(half, _single(stretches, owners, k)), stretches)
    found = [None if np.isnan(place) else float(place) for place in at_equator]
    gaps = [
        gap
        for k, picture in enumerate(pictures)
        if picture is not None and found[k] is None
        for gap in turning_gaps(k, picture)
    ]
    if gaps:
        owned = [stretches[gap.owner] for gap in gaps]

        def turning_value(owners: IntArray, k: FloatArray) -> FloatArray:
            single, own = _single(owned, owners, k), [gaps[int(n)] for n in owners]
            side = np.array([gap.hemisphere for gap in own])[:, None]
            places = turning_places(half, single, own)
            Z, G = equator_of(half, single)
            return d_on_curves(half, Z, G, side, places[:, None])[:, 0]

        for gap, place in zip(gaps, _zeros(turning_value, owned), strict=True):
            if not np.isnan(place):
                found[gap.owner] = float(place)
    return found


def _single(stretches: Sequence[LambdaStretch], owners: IntArray, k: FloatArray) -> list[LambdaStretch]:
    return [
        LambdaStretch(stretches[int(n)].is_inverse, value, value)
        for n, value in zip(owners, k.tolist(), strict=True)
    ]


def _at_equator(half: HalfCurves, single: Sequence[LambdaStretch]) -> FloatArray:
    Z, G = equator_of(half, single)
    return d_on_curves(half, Z, G, np.ones((len(single), 1)), np.full((len(single), 1), QUARTER))[:, 0]


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
    found[changing] = zero_between(lambda k: value(owners, k), low[changing], high[changing], CLOSE)
    return found
