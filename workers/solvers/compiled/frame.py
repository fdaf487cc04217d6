"""Turns a body and a planar motion into the numbers that kernels need, in axes in which A > C."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from flint import arb, ctx, fmpq
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.identity_cache import IdentityCache
from service.dynamics.problem import PlanarMotion, StartAtEquator, StartAtPoint, StartAtRest
from workers.solvers.compiled.records import LOOP, Loop, Records, copied
from workers.solvers.compiled.windows.arcs import AUTOMATIC, EQUATOR, POINT, REST

FloatArray = NDArray[np.float64]

NORMAL_BITS = 1020
"""Quotients of integers whose lengths differ by less are normal doubles."""
REST_BITS = 160
"""Precision of logarithms, whose doubles and low parts have 106 bits."""

_EMPTY = np.zeros(1, dtype=LOOP)


@dataclass(frozen=True, slots=True)
class Frame:
    """The part of a problem that sets of a sweep share."""

    shared: Records
    """A loop, shape (1,), that is not solved for yet."""

    @property
    def loop(self) -> Loop:
        """Return the only loop."""
        loop: Loop = self.shared[0]
        return loop

    def primed(self, log_lambda: FloatArray) -> FloatArray:
        """Return log λ in primed axes: λ' = λ^(−A/C) of the client, where they are mirrored."""
        loop = self.loop
        return -log_lambda / loop.alpha if loop.mirrored else log_lambda

    def loops(self, logarithms: Sequence[float]) -> Records:
        """Return the loops of the client's λ that have these logarithms, shape (sets,)."""
        loops = copied(self.shared, len(logarithms))
        loops["log_lambda"] = self.primed(np.array(logarithms))
        return loops


@dataclass(frozen=True, slots=True)
class Bodies:
    """The numbers of the bodies of many motions that kernels need, each rounded once, shape (sets,)."""

    alpha: FloatArray
    """The larger of A/C and C/A."""
    factor: FloatArray
    """C/((A − C) A) for A > C, else the same with both exchanged."""
    mirrored: NDArray[np.bool_]
    """A < C."""


def loops_of(bodies: Bodies, motion: PlanarMotion, logarithms: Sequence[float]) -> Records | None:
    """Return the loop of each body on its curve, λ of the client having these logarithms; A ≠ C.

    ``motion`` gives everything but λ. They are what :meth:`Frame.loops` has of each body alone.
    """
    asked = _asked(motion)
    if asked is None:
        return None
    loops = _without_curves(bodies, motion, asked, len(logarithms))
    plain = np.array(logarithms)
    loops["log_lambda"] = np.where(bodies.mirrored, -plain / bodies.alpha, plain)
    return loops


def with_rests(frame: Frame, body: RigidBody, lambdas_squared: Sequence[fmpq]) -> Records:
    """Return the loops of the client's λ² with what the doubles of their numbers leave out, shape (sets,).

    The logarithms are those of :meth:`Frame.loops`, each with its own rest.
    """
    mirrored = body.A < body.C
    alpha, factor = _ratios(body)
    logarithms = [logarithm_of(square) for square in lambdas_squared]
    loops = frame.loops(logarithms)
    loops["alpha_low"], loops["factor_low"] = _rest(*alpha), _rest(*factor)
    known = loops["log_lambda"].tolist() if mirrored else logarithms
    with ctx.workprec(REST_BITS):
        turned = arb(fmpq(-alpha[1], 2 * alpha[0])) if mirrored else arb(0.5)
        loops["log_lambda_low"] = [
            float(arb(square).log() * turned - rounded)
            for square, rounded in zip(lambdas_squared, known, strict=True)
        ]
    return loops


def _ratios(body: RigidBody) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return A/C and C/((A − C) A), A > C, each as two integers, which Python divides with one rounding.

    Fractions would look for common factors at each of the steps.
    """
    A, C = (body.C, body.A) if body.A < body.C else (body.A, body.C)
    a, b, c, d = A.numerator, A.denominator, C.numerator, C.denominator
    return (a * d, b * c), (c * b * b, (a * d - b * c) * a)


def _rest(numerator: int, denominator: int) -> float:
    """Return what the double nearest to a quotient leaves out."""
    n, d = (numerator / denominator).as_integer_ratio()
    return (numerator * d - n * denominator) / (denominator * d)


def logarithm_of(square: fmpq) -> float:
    """Return log λ of λ²."""
    return _half_logarithm(int(square.p), int(square.q))


def _half_logarithm(numerator: int, denominator: int) -> float:
    """Return half the logarithm of a quotient of integers, also of one that is no double."""
    if -NORMAL_BITS < numerator.bit_length() - denominator.bit_length() < NORMAL_BITS:
        # Python divides integers of any size with one rounding.
        return 0.5 * math.log(numerator / denominator)
    with ctx.workprec(REST_BITS):
        return float(arb(fmpq(numerator, denominator)).log() / 2)


def make_frame(body: RigidBody, motion: PlanarMotion) -> Frame | None:
    """Return the frame, None where the curve does not exist or the start is on the other side."""
    known, square = _of_body(body), motion.lambda_squared
    if known is None or (motion.nu is not None and not known.is_double) or not square:
        return None
    asked = _asked(motion)
    if asked is None:
        return None
    logarithm = _half_logarithm(square.numerator, square.denominator)
    key = motion.sign_of_g1, motion.g3_sign, *asked
    template = known.templates.get(key)
    if template is None:
        template = _without_curves(known, motion, asked, 1)
        # Starts at points may be all different.
        if asked[1] != POINT:
            known.templates[key] = template
    shared = copied(template)
    shared["log_lambda"] = -logarithm / known.alpha if known.mirrored else logarithm
    return Frame(shared)


def _without_curves(bodies: "Bodies | _OfBody", motion: PlanarMotion, asked: "_Asked", count: int) -> Records:
    """Return the loops, shape (count,), without their λ."""
    loops, mirrored = copied(_EMPTY, count), bodies.mirrored
    loops["alpha"], loops["factor"], loops["mirrored"] = bodies.alpha, bodies.factor, mirrored
    loops["sign1"] = np.where(mirrored, motion.g3_sign, motion.sign_of_g1)
    loops["half"] = np.where(mirrored, motion.sign_of_g1, motion.g3_sign)
    loops["window"], loops["kind"], loops["s_sign"], loops["g2_sign"], loops["size_of_g1"] = asked
    return loops


@dataclass(frozen=True, slots=True)
class _OfBody:
    alpha: float
    factor: float
    mirrored: bool
    is_double: bool
    """A = 2C."""
    templates: dict[tuple[float, ...], Records] = field(default_factory=dict)
    """Loops without their λ, by all else that is asked; a window has one of a thousand numbers at most."""


def _numbers_of(body: RigidBody) -> _OfBody | None:
    """Return what kernels know of a body, None where A = C."""
    if body.A == body.C:
        return None
    (alpha, factor), mirrored = _ratios(body), body.A < body.C
    return _OfBody(alpha[0] / alpha[1], factor[0] / factor[1], mirrored, body.A == 2 * body.C)


_of_body = IdentityCache(_numbers_of)


_Asked = tuple[int, int, float, float, float]
"""The window (−1: the only one), the kind of start, the signs of s and g2, and |g1|."""


def _asked(motion: PlanarMotion) -> _Asked | None:
    """Return what is asked of a motion; None for a window or a start that there is none of."""
    start, window = motion.start, -1 if motion.window is None else motion.window
    if window < -1:
        return None
    if isinstance(start, StartAtEquator):
        return window, EQUATOR, float(start.s_sign), 1.0, 0.0
    if isinstance(start, StartAtRest):
        return window, REST, 1.0, float(start.g2_sign), 0.0
    if isinstance(start, StartAtPoint):
        if start.g1 * motion.sign_of_g1 <= 0:
            return None
        return window, POINT, float(start.s_sign), float(start.g2_sign), abs(float(start.g1))
    return window, AUTOMATIC, 1.0, 1.0, 0.0
