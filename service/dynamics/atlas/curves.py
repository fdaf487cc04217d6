r"""Describes the half curves of one potential, for many λ or stretches of λ, and looks at signs along them.

Everything is in primed axes (:mod:`service.dynamics.reduction.geometry.loop`): a body with A < C is
mirrored, and its primed λ is λ^(−A/C). A stretch of the primed λ is stored as the two doubles that bound
k = λ, or k = 1/λ where λ > 1, because the bounds of the curve are tight for 0 ≤ k ≤ 1.

The curve and p² are evaluated in doubles at many λ and many points at once: for estimates and series, not for
proofs. So signs of p² are looked at for potentials without a formula, of which there are no bounds, at places
from pole to pole. Where it comes nearest to 0 between two places its extremum is looked for, so that also two
zeros that are about to meet are seen. Next to the poles, where doubles may have no digit left, balls give the
sign.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import groupby, pairwise

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.atlas.sign_maps import EQUATOR, UNDEFINED, Signature
from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import Loop, make_loop
from service.dynamics.reduction.geometry.point import REALS, make_equator, place_of
from service.dynamics.reduction.geometry.tight_form import tight_form
from service.dynamics.reduction.root_finding.radicand import TRUSTED_RELATIVE_DIFFERENCE
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import (
    QUARTER_TURN,
    Loops,
    Shape,
    loops_of_stretches,
    shape_of,
)
from service.dynamics.reduction.sign_proofs.cells import Curves

FloatArray = NDArray[np.float64]
EDGES_RATIO = 2.0
"""Ratio of the distances from a place of both ends of a part."""


@dataclass(frozen=True, slots=True)
class LambdaStretch:
    """low ≤ k ≤ high ≤ 1, k being the primed λ or 1/λ; one λ where both ends are equal."""

    is_inverse: bool
    low: float
    high: float

    def parts(self, count: int) -> "list[LambdaStretch]":
        """Return so many parts, with about equal ratios of their ends, in the order of growing k."""
        inner = self.low * (self.high / self.low) ** (np.arange(1, count) / count)
        ends = [self.low, *np.clip(inner, self.low, self.high).tolist(), self.high]
        return [LambdaStretch(self.is_inverse, low, high) for low, high in pairwise(ends) if low < high]

    def parts_towards(self, point: float, least: float) -> "list[LambdaStretch]":
        """Return parts as wide as they are far from a place inside; the one about it is twice ``least``."""
        steps = least * EDGES_RATIO ** np.arange(np.log(1.0 / least) / np.log(EDGES_RATIO))
        ends = [*(point * (1.0 - steps)).tolist(), *(point * (1.0 + steps)).tolist()]
        inner = sorted(end for end in ends if self.low < end < self.high)
        return [LambdaStretch(self.is_inverse, *pair) for pair in pairwise([self.low, *inner, self.high])]

    @property
    def width(self) -> float:
        """The relative width."""
        return (self.high - self.low) / self.high


@dataclass(frozen=True, slots=True)
class PlainHalves:
    """The half curves of a body and a potential on which g1 and g3 have given signs, for every λ."""

    body: RigidBody
    potential: Potential
    motion: PlanarMotion
    """Gives the signs; its λ has no meaning."""
    shape: Shape

    def loops(self, stretches: Sequence[LambdaStretch]) -> Loops:
        """Return bounds of Z and G on each stretch; all have the same ``is_inverse``."""
        low, high = (np.array([getattr(each, end) for each in stretches]) for end in ("low", "high"))
        # A loop of a stretch is open at its ends: the next doubles enclose them.
        below, above = np.nextafter(low, 0.0), np.minimum(np.nextafter(high, 2.0), 1.0)
        return loops_of_stretches(self.shape, below, above, is_inverse=stretches[0].is_inverse)

    def sent(self, stretch: LambdaStretch) -> tuple[arb, arb]:
        """Return the ends of a stretch as λ of the client's axes, the smaller first."""
        ends = [arb(end) for end in (stretch.low, stretch.high)]
        primed = [1 / end for end in ends] if stretch.is_inverse else ends
        alpha = ball(self.shape.alpha)
        own = [(-alpha * end.log()).exp() for end in primed] if self.shape.is_mirrored else primed
        return (own[0], own[1]) if own[0].mid() <= own[1].mid() else (own[1], own[0])


@dataclass(frozen=True, slots=True)
class HalfCurves(PlainHalves):
    """The half curves of a potential with a formula, of which bounds are known."""

    tape: Tape

    def over(self, stretches: Sequence[LambdaStretch]) -> Curves:
        """Return the curves of each stretch, which all have the same ``is_inverse``."""
        return Curves(self.tape, self._own_body, self.loops(stretches), self._turn)

    @property
    def _own_body(self) -> RigidBody:
        return RigidBody(self.body.A, None, self.body.C, allow_unphysical=True)

    @property
    def _turn(self) -> int:
        is_turned = (self.shape.first_sign * self.shape.third_sign < 0) != self.shape.is_mirrored
        return -1 if is_turned else 1


def grouped(single: Sequence[LambdaStretch]) -> list[list[LambdaStretch]]:
    """Return neighbours with the same ``is_inverse`` together, in their order."""
    return [list(group) for _, group in groupby(single, key=lambda each: each.is_inverse)]


def motion_at(half: PlainHalves, single: LambdaStretch) -> PlanarMotion:
    """Return the motion on a half curve at a single λ: exactly the double that is told for it."""
    value = Fraction(float(half.sent(single)[0].mid()))
    return PlanarMotion(value, g1_sign=half.motion.g1_sign, g3_sign=half.motion.g3_sign)


def plain_halves(body: RigidBody, potential: Potential, motion: PlanarMotion) -> PlainHalves:
    """Return the same of any potential, with or without a formula; A ≠ C."""
    return PlainHalves(body, potential, motion, shape_of(body, motion))


def half_curves(body: RigidBody, potential: Potential, motion: PlanarMotion) -> HalfCurves:
    """Return the half curves on which g1 and g3 have the signs of ``motion``; A ≠ C.

    Raises
    ------
    NoClosedFormError
        The potential has no formula.
    """
    return HalfCurves(body, potential, motion, shape_of(body, motion), tight_form(potential.tape))


MAX_ROOT_STEPS = 80
"""Largest number of steps: some ten are usual, where values are smooth."""
ROOT_RELATIVE_WIDTH = 2.0**-51


def equator_of(half: PlainHalves, stretches: Sequence[LambdaStretch]) -> tuple[FloatArray, FloatArray]:
    """Return Z and G for a λ inside each stretch, shape (stretches, 1)."""
    found: list[tuple[int, float, float]] = []
    for inverse in (False, True):
        points = [k for k, each in enumerate(stretches) if each.is_inverse == inverse]
        if points:
            loops = half.loops([stretches[k] for k in points])
            Z, G = (0.5 * (low + high) for low, high in (loops.Z, loops.G))
            found.extend(zip(points, Z.tolist(), G.tolist(), strict=True))
    ordered = np.array([each[1:] for each in sorted(found)])
    return ordered[:, :1], ordered[:, 1:]


def curve_at(
    half: PlainHalves, Z: FloatArray, G: FloatArray, sine: FloatArray, cosine: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return g1, g2, g3 in the client's axes, and c = g2 / cos v, at the places with these sin v and cos v.

    sin v < 0 is the curve on which the primed g3 has the other sign.
    """
    shape = half.shape
    with np.errstate(all="ignore"):
        first, height, third, c = place_of(
            REALS, sine, cosine, make_equator(Z, G, np.asarray(float(shape.alpha)))
        )
    first, third = shape.first_sign * first, shape.third_sign * third
    g1, g3 = (third, first) if shape.is_mirrored else (first, third)
    return g1, height, g3, c


def d_on_curves(
    half: PlainHalves, Z: FloatArray, G: FloatArray, side: FloatArray, x: FloatArray
) -> FloatArray:
    """Return D at distances x from the pole g2 = ``side``, shape (λ, n)."""
    g1, g2, g3, _ = curve_at(half, Z, G, np.sin(x), side * np.cos(x))
    with np.errstate(all="ignore"):
        found: FloatArray = half.potential.D_real(g1, g2, g3)
    return found


def p_squared(
    half: PlainHalves, Z: FloatArray, G: FloatArray, sine: FloatArray, cosine: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the primed p² and c at places of curves."""
    g1, g2, g3, c = curve_at(half, Z, G, sine, cosine)
    A, C = (half.body.C, half.body.A) if half.shape.is_mirrored else (half.body.A, half.body.C)
    factor = float(C / ((A - C) * A))
    with np.errstate(all="ignore"):
        D = half.potential.D_real(g1, g2, g3)
        ratio = -g1 / g3 if half.shape.is_mirrored else g3 / g1
        return factor * ratio * D, c


def zero_between(
    value: Callable[[FloatArray], FloatArray],
    low: FloatArray,
    high: FloatArray,
    close: float = ROOT_RELATIVE_WIDTH,
) -> FloatArray:
    """Return about where ``value`` changes its sign between ``low`` and ``high``, arrays of one shape.

    By the method of T. R. Chandrupatla (Advances in Engineering Software 28, 1997, 145-149): inverse
    quadratic interpolation where three points admit it, else bisection. It ends where the bracket is
    ``close``, relative.
    """
    point, far = low, high
    f_point, f_far = value(low), value(high)
    share = np.full(np.shape(low), 0.5)
    for _ in range(MAX_ROOT_STEPS):
        x = point + share * (far - point)
        f = value(x)
        # Of the last two places one keeps the bracket; the other is the third point.
        is_same = (f > 0.0) == (f_point > 0.0)
        third, f_third = np.where(is_same, point, far), np.where(is_same, f_point, f_far)
        far, f_far = np.where(is_same, far, point), np.where(is_same, f_far, f_point)
        point, f_point = x, f
        with np.errstate(all="ignore"):
            best = np.where(np.abs(f_point) < np.abs(f_far), point, far)
            least = 0.5 * close * np.abs(best) / np.abs(far - point)
            # NaN is no reason to go on.
            if not ((least < 0.5) & (np.abs(f_point) > 0.0)).any():
                break
            xi, phi = (point - far) / (third - far), (f_point - f_far) / (f_third - f_far)
            is_quadratic = (phi * phi < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
            estimate = f_point / (f_far - f_point) * f_third / (f_far - f_third) + (third - point) / (
                far - point
            ) * f_point / (f_third - f_point) * f_far / (f_third - f_far)
            share = np.where(is_quadratic & np.isfinite(estimate), estimate, 0.5)
            share = np.clip(share, np.minimum(least, 0.5), np.maximum(1.0 - least, 0.5))
            share = np.where(f_point == 0.0, 0.0, share)
    return best


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
