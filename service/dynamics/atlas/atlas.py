r"""Finds all planar motions of a body and a potential over a range of λ.

Its energies h(λ) are bounded at single λ. On the curve, with primed axes,

.. math:: h = V + \frac{(A g_1^2 + C g_3^2)\,D}{2 (A - C)\, g_1 g_3},

has the same value at every place of it where V and D are defined.
"""

from collections.abc import Callable, Sequence
from fractions import Fraction

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.atlas.curves import (
    HalfCurves,
    LambdaStretch,
    PlainHalves,
    grouped,
    half_curves,
    motion_at,
    plain_halves,
)
from service.dynamics.atlas.parts import (
    Atlas,
    AtlasPart,
    Beside,
    Change,
    LambdaRange,
    Measured,
    change_between,
    series_of,
)
from service.dynamics.atlas.sampled_atlas import sampled_atlas, single_at
from service.dynamics.atlas.structures import LambdaPart, first_stretches, parts_of_range, whole_range
from service.dynamics.atlas.zeros import CELL_RELATIVE_WIDTH, stays_at_latitudes, zeros_at_latitudes, zeros_of
from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.intervals import IntervalAlgebra
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.potentials.families.general_formula import formula_of
from service.dynamics.potentials.families.general_solution import GeneralPotential
from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.recognition import is_written_even
from service.dynamics.problem import PlanarMotion, Sign
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import (
    QUARTER_TURN,
    Cells,
    axes,
    heights,
    scales,
)
from service.dynamics.reduction.sign_proofs.signs import INFINITE
from service.dynamics.reduction.windows import find_windows

FloatArray = NDArray[np.float64]

ENERGY_POINTS = (
    (1.0, 0.3),
    (1.0, 0.6),
    (1.0, 0.9),
    (1.0, 1.2),
    (1.0, QUARTER_TURN * 0.97),
    (-1.0, 0.5),
    (-1.0, 1.1),
)
"""Signs of g2, and distances from the pole of this sign, where the energy is bounded."""


def energies(half: HalfCurves, single: Sequence[LambdaStretch]) -> tuple[FloatArray, FloatArray]:
    """Return bounds of h at single λ; NaN where there are none."""
    parts = [_energies(half, group) for group in grouped(single)]
    return np.concatenate([low for low, _ in parts]), np.concatenate([high for _, high in parts])


def _energies(half: HalfCurves, single: Sequence[LambdaStretch]) -> tuple[FloatArray, FloatArray]:
    shape, loops = (len(single), len(ENERGY_POINTS)), half.loops(single)
    side, x = (np.tile(np.array(each), shape[0]) for each in zip(*ENERGY_POINTS, strict=True))
    cells = Cells(np.repeat(np.arange(shape[0]), shape[1]), side, x * (1.0 - CELL_RELATIVE_WIDTH), x)
    algebra = IntervalAlgebra(scales(loops, cells))
    first, third = axes(algebra, loops, cells)
    g1, g3 = (third, first) if half.shape.is_mirrored else (first, third)
    g2 = algebra.interval(*heights(loops, cells))
    jets = FirstOrderJets(algebra, 1)
    seeds = [jets.seed(g1, (algebra.negate(g3),)), jets.seed(g2, (None,)), jets.seed(g3, (g1,))]
    A, C = half.body.A, half.body.C
    with np.errstate(all="ignore"):
        V = half.tape.evaluate(jets, seeds)
        total = V.value
        if V.first[0] is not None:
            # Mirrored, A and C, g1 and g3 are exchanged and D changes its sign: the quotient is the same.
            Q = algebra.add(
                algebra.multiply(algebra.constant(A), algebra.power(g1, Fraction(2))),
                algebra.multiply(algebra.constant(C), algebra.power(g3, Fraction(2))),
            )
            product = algebra.multiply(algebra.constant(2 * (A - C)), algebra.multiply(g1, g3))
            total = algebra.add(total, algebra.divide(algebra.multiply(Q, V.first[0]), product))
        lo, hi = (np.broadcast_to(bound, x.shape).reshape(shape) for bound in algebra.bounds(total))
    known = lo <= hi
    low = np.where(known, lo, -np.inf).max(axis=1)
    high = np.where(known, hi, np.inf).min(axis=1)
    is_known = np.isfinite(low) & np.isfinite(high)
    return np.where(is_known, low, np.nan), np.where(is_known, high, np.nan)


ENERGY_BITS = 128
MIN_SAMPLES_PER_PART = 9
"""λ of a part at which its windows are followed."""
PROBE_RELATIVE_DISTANCE = 1e-6
"""Relative distance from a change at which it is looked at which zeros meet."""
CHANGE_RELATIVE_WIDTH = 1e-5
"""Relative width up to which a stretch without a proof, between parts that differ, encloses a change."""


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

    Without periods these are NaN. Of a potential without a formula all is seen, and not proved.

    Raises
    ------
    EqualMomentsError
        A = C.
    """
    body.require_planar()
    potential = with_formula(potential)
    if not potential.has_formula:
        with ctx.workprec(ENERGY_BITS):
            plain = _plain_halves(body, potential, over)
            return sampled_atlas(plain, over, samples, MIN_SAMPLES_PER_PART, is_late, has_periods=has_periods)
    with ctx.workprec(ENERGY_BITS):
        halves = _halves(body, potential, over)
        if stays_at_latitudes(halves):
            return _of_latitudes(halves, over, samples, has_periods=has_periods)
        parts = parts_of_range(halves, first_stretches(*over.primed(halves[0])), is_late)
        if halves[0].shape.is_mirrored:
            parts = parts[::-1]
        return _assembled(halves, parts, over, samples, has_periods=has_periods)


def with_formula(potential: Potential) -> Potential:
    """Return the potential by a formula whose windows can be proved for all λ, or as it was stated.

    V1 of powers of w has a formula with √(g1² + g3²), of which bounds for stretches of λ tell nothing next to
    the poles; they do where F is constant, and where that part cancels.
    """
    stated = potential.as_stated
    if not isinstance(stated, GeneralPotential):
        return potential
    found = formula_of(stated)
    F = stated.pieces[0].angular.F.tape
    if (
        stated.is_uniform
        and F.result != 0
        and all(0 not in (made.left, made.right) for made in F.instructions)
    ):
        return found or stated
    is_simpler = found is not None and potential.has_formula and potential.tree != found.tree
    return potential if is_simpler else stated


def _halves(body: RigidBody, potential: Potential, over: LambdaRange) -> list[HalfCurves]:
    """Return the half on which the motion is asked, and the other one where it has other zeros."""
    is_even = is_written_even(potential.tape, 0 if body.A < body.C else 2)
    return [half_curves(body, potential, motion) for motion in _motions(body, over, is_even=is_even)]


def _plain_halves(body: RigidBody, potential: Potential, over: LambdaRange) -> list[PlainHalves]:
    """Return the same for a potential without a formula: one F and G make it even in g1 and g3."""
    is_even = isinstance(potential, GeneralPotential) and potential.is_uniform
    return [plain_halves(body, potential, motion) for motion in _motions(body, over, is_even=is_even)]


def _motions(body: RigidBody, over: LambdaRange, *, is_even: bool) -> list[PlanarMotion]:
    signs: list[tuple[Sign, Sign]] = [(over.g1_sign, over.g3_sign)]
    if not is_even:
        is_mirrored = body.A < body.C
        turned: Sign = -1 if (over.g1_sign if is_mirrored else over.g3_sign) > 0 else 1
        signs.append((turned, over.g3_sign) if is_mirrored else (over.g1_sign, turned))
    return [PlanarMotion(Fraction(1), g1_sign=first, g3_sign=third) for first, third in signs]


def _assembled(
    halves: Sequence[HalfCurves],
    parts: Sequence[LambdaPart],
    over: LambdaRange,
    samples: int,
    *,
    has_periods: bool,
) -> Atlas:
    found, changes, undecided = list[AtlasPart](), list[Change](), list[tuple[arb, arb]]()
    for k, part in enumerate(parts):
        lower, upper = over.ends(halves[0], part.stretches[0], part.stretches[-1])
        if part.signatures is not None:
            count = over.samples_between((lower, upper), samples, MIN_SAMPLES_PER_PART)
            found.append(_part(halves, part, (lower, upper), count, has_periods=has_periods))
            continue
        around = [parts[n] if 0 <= n < len(parts) else None for n in (k - 1, k + 1)]
        change = _change(halves, around, (lower, upper))
        if change is None:
            undecided.append((lower, upper))
        else:
            changes.append(change)
    return Atlas(over, tuple(found), tuple(changes), tuple(undecided))


def _change(
    halves: Sequence[HalfCurves], around: Sequence[LambdaPart | None], ends: tuple[arb, arb]
) -> Change | None:
    before, after = around
    is_narrow = ends[1] - ends[0] < CHANGE_RELATIVE_WIDTH * ends[1]
    if before is None or after is None or not is_narrow:
        return None
    if before.signatures is None or after.signatures is None or before.signatures == after.signatures:
        return None
    mirrored = halves[0].shape.is_mirrored
    # In the order of the client's λ; stretches are in that of the primed one.
    one = _at(halves, before, -1 if not mirrored else 0, upper=not mirrored)
    other = _at(halves, after, -1 if mirrored else 0, upper=mirrored)
    return change_between(halves, one, other, ends)


def _at(halves: Sequence[HalfCurves], part: LambdaPart, number: int, *, upper: bool) -> Beside:
    """Return the part with a single λ next to the change, and far enough from it that the zeros are apart."""
    end = _logarithm(part.stretches[number], upper=upper)
    nearest = single_at(end - PROBE_RELATIVE_DISTANCE if upper else end + PROBE_RELATIVE_DISTANCE)
    return Beside(part.signatures or (), lambda k: zeros_of(halves[k], k, part, [nearest]))


def _of_latitudes(
    halves: Sequence[HalfCurves], over: LambdaRange, samples: int, *, has_periods: bool
) -> Atlas:
    """Return the atlas where all zeros of p² stay at one g2 each: one part, without a change."""
    whole = whole_range(first_stretches(*over.primed(halves[0])), len(halves))
    ends = over.ends(halves[0], whole.stretches[0], whole.stretches[-1])
    return Atlas(over, (_part(halves, whole, ends, samples, has_periods=has_periods),), (), ())


def _part(
    halves: Sequence[HalfCurves], part: LambdaPart, ends: tuple[arb, arb], count: int, *, has_periods: bool
) -> AtlasPart:
    single = _single(part, count)
    if halves[0].shape.is_mirrored:
        single = single[::-1]
    row = len(single) // 2
    half = halves[0]
    try:
        windows = find_windows(half.body, half.potential, motion_at(half, single[row]))
    except DynamicsError as refusal:
        return AtlasPart(*ends, None, refusal)
    if part.signatures is None:
        zeros = zeros_at_latitudes(halves, single, windows)
    else:
        zeros = [zeros_of(half, k, part, single) for k, half in enumerate(halves)]
        if any(INFINITE in signature for signature in part.signatures):
            infinite = zeros_at_latitudes(halves, single, windows, only="collision")
            zeros = [one.beside(other) for one, other in zip(zeros, infinite, strict=True)]
    energy = Measured.between(*energies(half, single))
    series = series_of(halves, zeros, single, windows, row, energy, has_periods=has_periods)
    return AtlasPart(*ends, series, None)


def _single(part: LambdaPart, count: int) -> list[LambdaStretch]:
    """Return single λ of a part, denser towards its ends, where windows may grow like a root."""
    low, high = (_logarithm(part.stretches[k], upper=k != 0) for k in (0, -1))
    shares = 0.5 - 0.5 * np.cos(np.pi * np.arange(count) / (count - 1))
    return [single_at(float(low + (high - low) * share)) for share in shares]


def _logarithm(stretch: LambdaStretch, *, upper: bool) -> float:
    k = stretch.high if upper != stretch.is_inverse else stretch.low
    return -float(np.log(k)) if stretch.is_inverse else float(np.log(k))
