"""Finds all planar motions of a body and a potential over a range of λ."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import arb, ctx

from service.dynamics.atlas.bands import WindowSeries, motion_value, series_of
from service.dynamics.atlas.changes import Beside, Change, change_between
from service.dynamics.atlas.curves import HalfCurves, LambdaStretch, half_curves
from service.dynamics.atlas.latitudes import stays_at_latitudes, zeros_at_latitudes
from service.dynamics.atlas.structures import LambdaPart, first_stretches, parts_of_range, whole_range
from service.dynamics.atlas.zeros import zeros_of
from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.parity import is_written_even
from service.dynamics.potentials.families.general_solution import GeneralPotential
from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.recognition.constant_curve_function import formula_of
from service.dynamics.problem import PlanarMotion, Sign
from service.dynamics.reduction.windows import find_windows

BITS = 128
FEWEST = 9
"""λ of a part at which its windows are followed."""
AWAY = 1e-6
"""Relative distance from a change at which it is looked at which zeros meet."""
EVENT = 1e-5
"""Relative width up to which a stretch without a proof, between parts that differ, encloses a change."""


class AtlasNeedsFormulaError(DynamicsError):
    """The potential is given by an integral, of which nothing is known on whole stretches."""

    code = "atlas_needs_formula"


@dataclass(frozen=True, slots=True)
class LambdaRange:
    """lower ≤ λ ≤ upper, and the signs of g1 and g3."""

    lower: Fraction
    upper: Fraction
    g1_sign: Sign = 1
    g3_sign: Sign = 1


@dataclass(frozen=True, slots=True)
class AtlasPart:
    """A part of the range on which the windows keep their number, kinds and ends: proved for all its λ."""

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


def make_atlas(
    body: RigidBody,
    potential: Potential,
    over: LambdaRange,
    samples: int,
    is_late: Callable[[], bool] = lambda: False,
    *,
    has_periods: bool = True,
) -> Atlas:
    """Return the atlas, with some ``samples`` values of λ in all; what is open when it ``is_late`` stays so.

    Without periods these are NaN.

    Raises
    ------
    EqualMomentsError
        A = C.
    AtlasNeedsFormulaError
        The potential has no formula, and its F is not constant.
    """
    body.require_planar()
    potential = with_formula(body, potential)
    with ctx.workprec(BITS):
        halves = _halves(body, potential, over)
        if stays_at_latitudes(halves):
            return _of_latitudes(halves, over, samples, has_periods=has_periods)
        parts = parts_of_range(halves, first_stretches(*_primed(halves[0], over)), is_late)
        if halves[0].shape.is_mirrored:
            parts = parts[::-1]
        return _assembled(halves, parts, over, samples, has_periods=has_periods)


def with_formula(body: RigidBody, potential: Potential) -> Potential:
    """Return the potential, by a formula if it is one of the family ``general`` with a constant F; A ≠ C.

    Raises
    ------
    AtlasNeedsFormulaError
        It has none.
    """
    if potential.has_formula:
        return potential
    found = formula_of(body, potential) if isinstance(potential, GeneralPotential) else None
    if found is None:
        raise AtlasNeedsFormulaError(
            "the potential is given by an integral of F that has no formula, and an atlas is proved by "
            "bounds of formulas; accepted are potentials with a formula of g1, g2 and g3, and a constant F",
            pointer="/potential",
        )
    return found


def _halves(body: RigidBody, potential: Potential, over: LambdaRange) -> list[HalfCurves]:
    """Return the half on which the motion is asked, and the other one where it has other zeros."""
    is_mirrored = body.A < body.C
    signs: list[tuple[Sign, Sign]] = [(over.g1_sign, over.g3_sign)]
    if not is_written_even(potential.tape, 0 if is_mirrored else 2):
        turned: Sign = -1 if (over.g1_sign if is_mirrored else over.g3_sign) > 0 else 1
        signs.append((turned, over.g3_sign) if is_mirrored else (over.g1_sign, turned))
    return [
        half_curves(body, potential, PlanarMotion(Fraction(1), g1_sign=first, g3_sign=third))
        for first, third in signs
    ]


def _primed(half: HalfCurves, over: LambdaRange) -> tuple[float, float]:
    """Return the range of the primed λ, rounded outwards."""
    ends = [float(over.lower), float(over.upper)]
    if half.shape.is_mirrored:
        ends = [end ** -float(1 / half.shape.alpha) for end in reversed(ends)]
    # A power in doubles has an error of some units in the last place.
    return ends[0] * (1.0 - 1e-14), ends[1] * (1.0 + 1e-14)


def _assembled(
    halves: Sequence[HalfCurves],
    parts: Sequence[LambdaPart],
    over: LambdaRange,
    samples: int,
    *,
    has_periods: bool,
) -> Atlas:
    found, changes, undecided = list[AtlasPart](), list[Change](), list[tuple[arb, arb]]()
    whole = float(np.log(float(over.upper) / float(over.lower)))
    for k, part in enumerate(parts):
        lower, upper = _ends(halves[0], part, over)
        if part.signatures is not None:
            share = float(np.log(float(upper.mid()) / float(lower.mid()))) / whole
            count = max(round(samples * share), FEWEST)
            found.append(_part(halves, part, (lower, upper), count, has_periods=has_periods))
            continue
        around = [parts[n] if 0 <= n < len(parts) else None for n in (k - 1, k + 1)]
        change = _change(halves, around, (lower, upper))
        if change is None:
            undecided.append((lower, upper))
        else:
            changes.append(change)
    return Atlas(over, tuple(found), tuple(changes), tuple(undecided))


def _ends(half: HalfCurves, part: LambdaPart, over: LambdaRange) -> tuple[arb, arb]:
    ends = [*half.sent(part.stretches[0]), *half.sent(part.stretches[-1])]
    lower, upper = min(ends, key=lambda end: float(end.mid())), max(ends, key=lambda end: float(end.mid()))
    first, last = (arb(end.numerator) / end.denominator for end in (over.lower, over.upper))
    return (first if lower < first else lower), (last if upper > last else upper)


def _change(
    halves: Sequence[HalfCurves], around: Sequence[LambdaPart | None], ends: tuple[arb, arb]
) -> Change | None:
    before, after = around
    is_narrow = ends[1] - ends[0] < EVENT * ends[1]
    if before is None or after is None or not is_narrow:
        return None
    if before.signatures is None or after.signatures is None or before.signatures == after.signatures:
        return None
    mirrored = halves[0].shape.is_mirrored
    # In the order of the client's λ; stretches are in that of the primed one.
    first = _at(before, -1 if not mirrored else 0, upper=not mirrored)
    second = _at(after, -1 if mirrored else 0, upper=mirrored)
    return change_between(halves, first, second, ends)


def _at(part: LambdaPart, nearest: int, *, upper: bool) -> Beside:
    """Return the part with a single λ next to the change, and far enough from it that the zeros are apart."""
    end = _logarithm(part.stretches[nearest], upper=upper)
    return Beside(part, _at_logarithm(end - AWAY if upper else end + AWAY))


def _of_latitudes(
    halves: Sequence[HalfCurves], over: LambdaRange, samples: int, *, has_periods: bool
) -> Atlas:
    """Return the atlas where all zeros of p² stay at one g2 each: one part, without a change."""
    whole = whole_range(first_stretches(*_primed(halves[0], over)), len(halves))
    ends = _ends(halves[0], whole, over)
    return Atlas(over, (_part(halves, whole, ends, samples, has_periods=has_periods),), (), ())


def _part(
    halves: Sequence[HalfCurves], part: LambdaPart, ends: tuple[arb, arb], count: int, *, has_periods: bool
) -> AtlasPart:
    single = _single(part, count)
    if halves[0].shape.is_mirrored:
        single = single[::-1]
    row = len(single) // 2
    half = halves[0]
    motion = PlanarMotion(
        motion_value(half, single[row]), g1_sign=half.motion.g1_sign, g3_sign=half.motion.g3_sign
    )
    try:
        windows = find_windows(half.body, half.potential, motion)
    except DynamicsError as refusal:
        return AtlasPart(*ends, None, refusal)
    if part.signatures is None:
        zeros = zeros_at_latitudes(halves, single, windows)
    else:
        zeros = [zeros_of(half, k, part, single) for k, half in enumerate(halves)]
    series = series_of(halves, zeros, single, windows, row, has_periods=has_periods)
    return AtlasPart(*ends, series, None)


def _single(part: LambdaPart, count: int) -> list[LambdaStretch]:
    """Return single λ of a part, denser towards its ends, where windows may grow like a root."""
    low, high = (_logarithm(part.stretches[k], upper=k != 0) for k in (0, -1))
    shares = 0.5 - 0.5 * np.cos(np.pi * np.arange(count) / (count - 1))
    return [_at_logarithm(float(low + (high - low) * share)) for share in shares]


def _logarithm(stretch: LambdaStretch, *, upper: bool) -> float:
    k = stretch.high if upper != stretch.is_inverse else stretch.low
    return -float(np.log(k)) if stretch.is_inverse else float(np.log(k))


def _at_logarithm(logarithm: float) -> LambdaStretch:
    k = min(float(np.exp(-abs(logarithm))), 1.0)
    return LambdaStretch(logarithm > 0.0, k, k)
