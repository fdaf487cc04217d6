"""Describes the half curves of one potential, for many λ or stretches of λ at once.

Everything is in primed axes (:mod:`service.dynamics.reduction.geometry.loop`): a body with A < C is
mirrored, and its primed λ is λ^(−A/C). A stretch of the primed λ is stored as the two doubles that bound
k = λ, or k = 1/λ where λ > 1, because the bounds of the curve are tight for 0 ≤ k ≤ 1.

The functions at the end evaluate the curve and p² in doubles at many λ and many points at once: for estimates
and series, not for proofs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import groupby, pairwise

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.point import REALS, make_equator, place_of
from service.dynamics.reduction.geometry.tight_form import tight_form
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import (
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
