"""Looks on a grid for near zeros of p², and proves a double zero there, or that p² stays away from zero.

The grid says where balls need not look. About a near rest P is K (x² + ρ²), up to NEIGHBOURS
steps of the grid away. So half a step from it |P| is 1/256 of what it is NEIGHBOURS steps further; and where
P grows, or falls, at nearly one rate over LINE_STEPS steps on both sides of a zero there is no such place.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.formula.algebras.ball import ball
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.root_finding.gap import (
    KNOWN_BITS,
    NearRest,
    SeparatrixUndecidedError,
    box_about,
    ladder,
    near_rest,
    proved_rest,
    slopes,
)
from service.dynamics.reduction.root_finding.radicand import HalfLoop
from service.dynamics.reduction.root_finding.zeros import BRACKET_BITS, Zero
from service.dynamics.reduction.sign_proofs.cells import half_of
from service.dynamics.reduction.sign_proofs.high_zeros import order_at_part
from service.dynamics.reduction.window import height

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
GRID_POINTS = 256
STEP = np.pi / GRID_POINTS
SAME_MINIMUM_DISTANCE = 8.0 / GRID_POINTS
"""Distance in v within which a place is the one that was looked for."""
NEIGHBOURS, MINIMUM_RELATIVE_DEPTH = 8, 2.0**-4
LINE_STEPS, LINE_SLOPE_RATIO = 6, 4.0
"""Steps on both sides of a zero on which P is looked at, and the greatest ratio of those that are alike."""
SLOPE_DISTANCE = 2.0**-24
"""Distance in v from a zero at which its slope is looked at."""
EQUATOR_STEPS = 4
"""Steps from the equator that SAME_MINIMUM_DISTANCE is less than, by half a step and more."""


@dataclass(frozen=True, slots=True)
class GridMinima:
    """The grid's places of one half loop, 0 < |v| < π."""

    is_low: BoolArray
    """|P| is less than at both neighbours, and much less than around."""
    slopes: FloatArray
    """|dP/dv| where P changes its sign and its steps around are alike, NaN elsewhere."""
    is_far_at_equator: bool
    """|P| about the equator is nowhere much less than around."""

    def lowest(self) -> list[float]:
        """Return the places where |P| is low."""
        found: list[float] = _places()[self.is_low].tolist()
        return found

    def passes_plainly(self, loop: Loop, zero: arb) -> bool:
        """Tell whether P passes its simple zero on a straight line, both on the grid and next to the zero."""
        place = round(abs(float(zero)) / STEP) - 1
        slope = float(self.slopes[place]) if 0 <= place < GRID_POINTS - 1 else np.nan
        if not slope > 0.0:
            return False
        # What is narrower than a step of the grid bends P at the zero, or does not concern it.
        near = abs(float(loop.point(zero.mid() + SLOPE_DISTANCE).P)) / SLOPE_DISTANCE
        return slope < LINE_SLOPE_RATIO * near < LINE_SLOPE_RATIO * LINE_SLOPE_RATIO * slope


def is_at_one_of(v: float, places: Sequence[float]) -> bool:
    """Tell whether one of the places is next to v on the grid."""
    return any(abs(v - other) <= STEP for other in places)


def are_apart(places: Sequence[arb]) -> bool:
    """Tell whether any two places are too far apart for a near rest between them, or next to them."""
    sizes = sorted(abs(float(v)) for v in places)
    return all(upper - lower > 2.0 * SAME_MINIMUM_DISTANCE for lower, upper in pairwise(sizes))


@cache
def _places() -> FloatArray:
    return np.linspace(0.0, np.pi, GRID_POINTS + 1)[1:-1]


def grid_minima_of(loops: Sequence[Loop], g3_sign: int) -> list[GridMinima]:
    """Return what the grid shows of each loop; they differ in λ alone."""
    v = _places()
    Z, G = (np.array([float(getattr(loop, name)) for loop in loops])[:, None] for name in "ZG")
    P = loops[0].radicand_on(Z, G, g3_sign * np.sin(v), np.cos(v))
    size = np.abs(P)
    around = np.pad(size, ((0, 0), (NEIGHBOURS, NEIGHBOURS)), mode="edge")
    for width in (1, 2, 4, 8):
        around = np.maximum(around[:, :-width], around[:, width:])
    # The largest of 16 places each, and of 17.
    around = np.maximum(around[:, :-1], around[:, 1:])
    with np.errstate(all="ignore"):
        # Where P is constant but for its rounding, every third place is lower than its neighbours.
        is_low = size < MINIMUM_RELATIVE_DEPTH * around
        is_low[:, 1:-1] &= (size[:, 1:-1] < size[:, :-2]) & (size[:, 1:-1] < size[:, 2:])
        is_low[:, [0, -1]] = False
        beside, wider = (
            size[:, GRID_POINTS // 2 - 1 - steps : GRID_POINTS // 2 + steps]
            for steps in (EQUATOR_STEPS, EQUATOR_STEPS + NEIGHBOURS)
        )
        # Written so that NaN is not far.
        is_far = beside.min(axis=1) > MINIMUM_RELATIVE_DEPTH * wider.max(axis=1)
        slopes = _slopes(P)
    return [GridMinima(low, slope, bool(far)) for low, slope, far in zip(is_low, slopes, is_far, strict=True)]


def _slopes(P: FloatArray) -> FloatArray:
    """Return the slope of P where it changes its sign and its steps around are alike, NaN elsewhere."""
    found = np.full(P.shape, np.nan)
    crosses = np.zeros(P.shape, dtype=np.bool_)
    crosses[:, LINE_STEPS:-LINE_STEPS] = (P[:, LINE_STEPS - 1 : -LINE_STEPS - 1] > 0.0) != (
        P[:, LINE_STEPS + 1 : -LINE_STEPS + 1] > 0.0
    )
    rows, places = np.nonzero(crosses)
    if len(rows):
        steps = np.diff(P[rows[:, None], places[:, None] + np.arange(-LINE_STEPS, LINE_STEPS + 1)], axis=1)
        low, high = steps.min(axis=1), steps.max(axis=1)
        alike = ((low > 0.0) & (high < LINE_SLOPE_RATIO * low)) | (
            (high < 0.0) & (low > LINE_SLOPE_RATIO * high)
        )
        slopes = np.abs(steps[:, LINE_STEPS - 1 : LINE_STEPS + 1].mean(axis=1)) / STEP
        found[rows, places] = np.where(alike, slopes, np.nan)
    return found


SAME_POINT_DISTANCE = 2.0**-64
"""Distance in v of two places that are one, known with different bits."""
SIGNS_RELATIVE_DISTANCE = 2.0 ** (8 - BRACKET_BITS)
"""Distance from a zero at which signs locate it, relative to its distance from the pole."""
NEAR_REST_RELATIVE_REACH = 2.0**-12
"""Reach of a near rest, against the distance from the pole, up to which it is one."""


def with_near_rests(
    loop: Loop, half: HalfLoop, g3_sign: int, turns: Iterable[arb], minima: GridMinima | None = None
) -> HalfLoop:
    """Return the half with the places where P nearly touches 0 and is proved not to.

    They are looked for next to the zeros, the equator and the ``turns`` of P, 0 < v < π, and where
    ``minima``, which says what a grid shows of P, does not exclude them.
    """
    minima = grid_minima_of([loop], g3_sign)[0] if minima is None else minima
    zeros = [zero for zero in half.zeros if zero.kind != "infinite"]
    # Next to another place P is no simple zero's, however straight it looks.
    turned = [v * g3_sign for v in turns]
    apart = are_apart([*(zero.v for zero in zeros), *turned])
    plain = [
        abs(float(zero.v))
        for zero in zeros
        if apart and zero.kind == "simple" and minima.passes_plainly(loop, zero.v)
    ]
    places = [zero.v for zero in zeros if abs(float(zero.v)) not in plain]
    if not minima.is_far_at_equator:
        places.append(arb.pi() / 2 * g3_sign)
    places.extend(turned)
    places.extend(arb(x) * g3_sign for x in minima.lowest() if not is_at_one_of(x, plain))
    found: list[NearRest] = []
    for v in places:
        near = _known(loop, v)
        # From afar Newton's method leads anywhere: then the place is another's.
        if (
            near is None
            or not _is_close(near)
            or not abs(near.v - v) < 2 * near.reach + SAME_MINIMUM_DISTANCE
        ):
            continue
        # Two places that agree within their errors are the same unless they are proved different.
        same = [other for other in found if not abs(near.v - other.v) > near.reach]
        if all(near.v.rad() < other.v.rad() for other in same):
            found = [*(other for other in found if other not in same), near]
    return replace(half, slow=tuple(found))


def _known(loop: Loop, v: arb) -> NearRest | None:
    """Return the near rest next to ``v``; compute a close one with more bits, if they resolve its square."""
    near = near_rest(loop, v)
    if near is None or not _is_close(near) or near.square.rel_accuracy_bits() >= KNOWN_BITS:
        return near
    with ctx.workprec(4 * ctx.prec):
        finer = near_rest(loop, v)
    return finer if finer is not None and finer.square.rel_accuracy_bits() >= KNOWN_BITS else None


def _is_told(near: NearRest) -> bool:
    """Tell whether the gap is known, and where it is a window or a wall, its ends apart from its middle."""
    if near.square.rel_accuracy_bits() < KNOWN_BITS:
        return False
    return bool(near.square > 0 or arb(near.v.rad()) < near.reach * arb(2) ** -KNOWN_BITS)


def _is_close(near: NearRest) -> bool:
    return bool(near.square.abs_upper() < (NEAR_REST_RELATIVE_REACH * near.v.sin()) ** 2)


def resolved(loop: Loop, half: HalfLoop) -> HalfLoop:
    """Return the half with every zero of order two or more proved, or resolved into what is there.

    Raises
    ------
    SeparatrixUndecidedError
        One of them is neither proved, nor distinguished from two zeros or none.
    """
    zeros, signs, slow = list[Zero](), [half.signs[0]], list(half.slow)
    for zero, before, after in zip(half.zeros, half.signs, half.signs[1:], strict=False):
        if zero.kind != "multiple":
            zeros.append(zero)
            signs.append(after)
            continue
        found = _resolved(loop, zero, before, after)
        if isinstance(found, Zero):
            zeros.append(found)
            signs.append(after)
            continue
        slow = [*(near for near in slow if not abs(near.v - found.v) < SAME_POINT_DISTANCE), found]
        if found.square < 0:
            # The two sides of a narrow gap agree in more digits than the current precision.
            with ctx.workprec(max(ctx.prec, found.v.bits()) + 64):
                zeros.extend(Zero(found.v + side * found.reach, "simple") for side in (-1, 1))
            signs.extend((-before, after))
    return replace(half, zeros=tuple(zeros), signs=tuple(signs), slow=tuple(slow))


def _resolved(loop: Loop, zero: Zero, before: int, after: int) -> Zero | NearRest:
    near = near_rest(loop, zero.v)
    rest = _proved_rest(loop, zero.v if near is None else near.v)
    if rest is not None:
        return Zero(rest, "multiple")
    if near is None:
        raise _undecided(loop, zero.v, None)
    if before != after:
        simple = _end_of_gap(loop, zero, before)
        if simple is None:
            raise _undecided(loop, zero.v, None)
        return simple
    for bits in ladder(loop, 2 * ctx.prec):
        with ctx.workprec(bits):
            near = near_rest(loop, zero.v) or near
            if _is_told(near):
                return near
    raise _undecided(loop, zero.v, near)


def _proved_rest(loop: Loop, v: arb) -> arb | None:
    """Return the place next to ``v``, −π < v < π, where P is proved to have a zero of order two or more."""
    rest = proved_rest(loop, v)
    if rest is not None or not loop.potential.has_formula:
        return rest
    sign = 1 if v > 0 else -1
    found = order_at_part(half_of(loop, loop.potential.tape, sign), v * sign)
    return found[0] * sign if found is not None and found[1] > 1 else None


def _end_of_gap(loop: Loop, zero: Zero, before: int) -> Zero | None:
    """Return the simple zero where P changes its sign: one of the two ends of a gap about a near rest.

    The zero is known to fewer digits than the gap is narrow. f'' lies in a ball about its value at the
    critical place m, on a box that holds both ends: f = f(m) + ½ f'' (τ − τ_m)² says where they are.
    """
    sine = abs(zero.v.sin())
    for bits in ladder(loop, ctx.prec):
        with ctx.workprec(bits):
            near = near_rest(loop, zero.v)
            if near is None:
                return None
            if not _is_told(near):
                continue
            if not (near.square < 0 and near.reach < SAME_POINT_DISTANCE * sine):
                return None
            refined = loop.refined()
            rate = ball(loop.C) * near.at.c * abs(near.v.sin())
            box = box_about(refined, near.at, 2 * near.reach / rate)
            bend = slopes(refined, box)[1] / slopes(refined, near.at)[1]
            if not (bend > 0.5 and bend < 2):
                return None
            # v is as good as proportional to τ.
            away = near.reach / bend.sqrt() * arb(1, (16 * near.reach / sine).abs_upper())
        # The two agree in more digits than the current precision.
        with ctx.workprec(max(bits, near.v.bits()) + 64):
            side = -1 if (before < 0) == (near.K < 0) else 1
            end = near.v + side * away
            # Else it is another zero, farther away.
            return Zero(end, "simple") if abs(end - zero.v) < SIGNS_RELATIVE_DISTANCE * sine else None
    return None


def _undecided(loop: Loop, v: arb, near: NearRest | None) -> SeparatrixUndecidedError:
    place = f"at g2 = {height(loop, v if near is None else near.v):.15g}"
    text = f"{place} p² is neither proved to have a zero of order two or more nor proved not to vanish: "
    shortest = 0.0 if near is None else _shortest_period(loop, near)
    if shortest > 0.0:
        text += f"the motion is a separatrix, or its period is longer than {shortest:.3g}"
    else:
        text += "the motion may take any time there"
    text += "; coefficients that are algebraic numbers make a proof possible"
    return SeparatrixUndecidedError(text, pointer="/potential")


def _shortest_period(loop: Loop, near: NearRest) -> float:
    """Return a time that it takes at least to pass the place, or to turn back before it.

    From the distance √ρ to ρ, the largest reach there can be, dt = Z dv/(c √P), P ≤ 1.1 K (v² + ρ²).
    """
    farthest = near.square.abs_upper().sqrt()
    rate = loop.Z / (near.at.c * near.K.abs_upper().sqrt())
    return 0.9 * float((rate * -farthest.log() / 2).lower())
