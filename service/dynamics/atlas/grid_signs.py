r"""Looks at the signs of p² along half curves at single λ, by values in doubles. Nothing is proved by it.

For potentials without a formula, of which there are no bounds. p² is evaluated at places from pole to pole;
where it comes nearest to 0 between two places its extremum is looked for, so that also two zeros that
are about to meet are seen. Next to the poles, where doubles may have no digit left, balls give the sign.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.atlas.curves import LambdaStretch, PlainHalves, equator_of, motion_at, p_squared
from service.dynamics.atlas.sign_maps import EQUATOR, UNDEFINED, Signature
from service.dynamics.reduction.geometry.loop import Loop, make_loop
from service.dynamics.reduction.root_finding.radicand import TRUSTED_RELATIVE_DIFFERENCE
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import QUARTER_TURN

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Function = Callable[[FloatArray], FloatArray]

POLE_DISTANCE = 2.0**-42
"""Distance from a pole at which the sign is taken in balls."""
POLE_POINTS, EVEN_POINTS = 26, 240
"""Places from 2^-27 to an eighth, each twice as far from the pole; and from there to the equator."""
GOLDEN_SECTIONS = 44
"""Golden sections: to 1e-9 of the distance of two places, where p² differs from its extremum by 1e-18."""
GOLDEN_RATIO = 0.5 * (5.0**0.5 - 1.0)


@dataclass(frozen=True, slots=True)
class GridSigns:
    """The signs of p² along one half curve at one λ, in doubles."""

    signature: Signature
    low: FloatArray
    high: FloatArray
    """Distances from the pole between which p² changes its sign, from the north to the south pole."""
    hemisphere: IntArray
    """The sign of g2 there."""


def trusted_points(halves: Sequence[PlainHalves], single: Sequence[LambdaStretch]) -> FloatArray:
    """Return distances from a pole that grow to the equator, from the nearest one where balls agree."""
    near: FloatArray = 0.125 * np.exp2(np.arange(-POLE_POINTS, 0, dtype=np.float64))
    first = 0
    for half in halves:
        Z, G = equator_of(half, single)
        for side in (1.0, -1.0):
            values = _values(half, Z, G, side, near)
            for row, at in enumerate(single):
                loop = make_loop(half.body, half.potential, motion_at(half, at))
                while first < POLE_POINTS:
                    exact = radicand_ball(half, loop, side, arb(near[first]))
                    if abs(arb(values[row, first]) - exact) < TRUSTED_RELATIVE_DIFFERENCE * abs(exact):
                        break
                    first += 1
    return np.concatenate([near[first:], np.linspace(0.125, QUARTER_TURN, EVEN_POINTS)])


def radicand_ball(half: PlainHalves, loop: Loop, side: float, x: arb) -> arb:
    """Return p² at a distance from the pole g2 = ``side`` of a half, at the current precision."""
    sine, cosine = x.sin_cos()
    return loop.point_from(sine * half.shape.third_sign, cosine if side > 0 else -cosine).P


def grid_signs_at(half: PlainHalves, points: FloatArray, single: Sequence[LambdaStretch]) -> list[GridSigns]:
    """Return the signs along a half curve at each λ."""
    Z, G = equator_of(half, single)
    north, south = (_values(half, Z, G, side, points) for side in (1.0, -1.0))
    # In the order of growing v; the equator is the last place of the north.
    values = np.concatenate([north, south[:, -2::-1]], axis=1)
    v = np.concatenate([points, np.pi - points[-2::-1]])
    owner, at, sign = _extrema(half, Z, G, points, values)
    found = []
    for row, each in enumerate(single):
        more = [(float(x), int(s)) for x, s in zip(at[owner == row], sign[owner == row], strict=True)]
        signed = sorted([*zip(v.tolist(), _signs(values[row]).tolist(), strict=True), *more])
        loop = make_loop(half.body, half.potential, motion_at(half, each))
        ends = [_sign_next_to(half, loop, side) for side in (1.0, -1.0)]
        found.append(_grid_signs([(POLE_DISTANCE, ends[0]), *signed, (np.pi - POLE_DISTANCE, ends[1])]))
    return found


def _values(half: PlainHalves, Z: FloatArray, G: FloatArray, side: float, x: FloatArray) -> FloatArray:
    cosine = np.where(x == QUARTER_TURN, 0.0, side * np.cos(x))
    return p_squared(half, Z, G, np.sin(x)[None, :], cosine[None, :])[0]


def _signs(values: FloatArray) -> IntArray:
    with np.errstate(all="ignore"):
        return np.where(np.isnan(values), UNDEFINED, np.sign(values)).astype(np.int64)


def _sign_next_to(half: PlainHalves, loop: Loop, side: float) -> int:
    """Return the sign of p² next to a pole, 0 if it is not known."""
    P = radicand_ball(half, loop, side, arb(POLE_DISTANCE))
    return 1 if P > 0 else -1 if P < 0 else 0


def _extrema(
    half: PlainHalves, Z: FloatArray, G: FloatArray, points: FloatArray, values: FloatArray
) -> tuple[IntArray, FloatArray, IntArray]:
    """Return λ (as rows), v and sign of extrema that have another sign than the places around them."""
    left, middle, right = values[:, :-2], values[:, 1:-1], values[:, 2:]
    with np.errstate(all="ignore"):
        sign = np.sign(middle)
        is_near = (sign * left > 0.0) & (sign * right > 0.0)
        is_near &= (np.abs(middle) <= np.abs(left)) & (np.abs(middle) <= np.abs(right))
    row, k = np.nonzero(is_near)
    if not row.size:
        return row, np.zeros(0), row
    n, count = len(points), values.shape[1]
    # The distance from the north pole, or from the south pole, in whose hemisphere all three places are.
    side = np.where(k + 1 < n, 1.0, -1.0)
    index = np.arange(count)
    north = np.where(
        index < n, points[np.minimum(index, n - 1)], np.pi - points[np.minimum(count - 1 - index, n - 1)]
    )
    south = points[np.minimum(count - 1 - index, n - 1)]
    low = np.where(side > 0.0, north[k], south[k + 2])
    high = np.where(side > 0.0, north[k + 2], south[k])
    signs = sign[row, k]

    def size(x: FloatArray) -> FloatArray:
        P = p_squared(half, Z[row], G[row], np.sin(x)[:, None], (side * np.cos(x))[:, None])[0][:, 0]
        return signs * P

    x, least = _least(size, low, high)
    is_other = least < 0.0
    v = np.where(side > 0.0, x, np.pi - x)
    return row[is_other], v[is_other], (-signs[is_other]).astype(np.int64)


def _least(function: Function, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the places of least values between ``low`` and ``high``, by golden sections, and the values."""
    one, other = high - GOLDEN_RATIO * (high - low), low + GOLDEN_RATIO * (high - low)
    f_one, f_other = function(one), function(other)
    for _ in range(GOLDEN_SECTIONS):
        is_left = f_one < f_other
        low, high = np.where(is_left, low, one), np.where(is_left, other, high)
        fresh = np.where(is_left, high - GOLDEN_RATIO * (high - low), low + GOLDEN_RATIO * (high - low))
        f_fresh = function(fresh)
        one, other = np.where(is_left, fresh, other), np.where(is_left, one, fresh)
        f_one, f_other = np.where(is_left, f_fresh, f_other), np.where(is_left, f_one, f_fresh)
    is_left = f_one < f_other
    return np.where(is_left, one, other), np.where(is_left, f_one, f_other)


def _grid_signs(signed: Sequence[tuple[float, int]]) -> GridSigns:
    """Return the stretches of one sign, and where they meet."""
    known = [(v, sign) for v, sign in signed if sign != 0]
    at_equator = [sign for v, sign in known if v == QUARTER_TURN]
    runs = []
    for is_north in (True, False):
        # A place on the equator belongs to both hemispheres.
        signs = [sign for v, sign in known if (v < QUARTER_TURN) == is_north and v != QUARTER_TURN]
        signs = [*signs, *at_equator] if is_north else [*at_equator, *signs]
        runs.append([sign for sign, _ in groupby(signs)])
    meeting = [(one, two) for (one, first), (two, second) in pairwise(known) if first != second]
    hemisphere = np.array([1 if two <= QUARTER_TURN else -1 for _, two in meeting], dtype=np.int64)
    ends = np.array(meeting).reshape(-1, 2)
    in_north = hemisphere > 0
    return GridSigns(
        (*runs[0], EQUATOR, *runs[1]),
        np.where(in_north, ends[:, 0], np.pi - ends[:, 1]),
        np.where(in_north, ends[:, 1], np.pi - ends[:, 0]),
        hemisphere,
    )
