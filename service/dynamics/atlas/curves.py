"""Describes the half curves of one potential, for many λ or stretches of λ at once.

Everything is in primed axes (:mod:`service.dynamics.reduction.geometry.loop`): a body with A < C is
mirrored, and its primed λ is λ^(−A/C). A stretch of the primed λ is stored as the two doubles that bound
k = λ, or k = 1/λ where λ > 1, because the bounds of the curve are tight for 0 ≤ k ≤ 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import groupby, pairwise

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import ball
from service.dynamics.reduction.geometry.tight_form import tight_form
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import Loops, Shape, shape_of
from service.dynamics.reduction.sign_proofs.cells import Curves
from service.dynamics.reduction.sign_proofs.equators import loops_of_stretches

FloatArray = NDArray[np.float64]

CLOSER = 2.0
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

    def parts_towards(self, place: float, least: float) -> "list[LambdaStretch]":
        """Return parts as wide as they are far from a place inside; the one about it is twice ``least``."""
        steps = least * CLOSER ** np.arange(np.log(1.0 / least) / np.log(CLOSER))
        ends = [*(place * (1.0 - steps)).tolist(), *(place * (1.0 + steps)).tolist()]
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
