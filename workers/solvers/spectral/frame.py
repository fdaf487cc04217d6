"""What a body and a planar motion say about the loop, in the slots of :mod:`.curve`."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.problem import PlanarMotion, StartAtEquator, StartAtPoint, StartAtRest
from workers.solvers.spectral import curve
from workers.solvers.spectral.windows import EQUATOR, POINT, REST

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Frame:
    """The part of a problem that sets of a sweep share, in the primed axes of the loop."""

    loop: FloatArray
    log_lambda: float
    half: float
    """Sign of the primed g3."""
    window: int
    """−1: the only one."""
    wishes: FloatArray
    """(Kind of start, sign of s, sign of g2, |g1|)."""


def make_frame(body: RigidBody, motion: PlanarMotion) -> Frame | None:
    """Return the frame, None where the curve does not exist or the start is on the other side."""
    if body.A == body.C or (motion.nu is not None and body.A != 2 * body.C) or not motion.lambda_squared:
        return None
    mirrored = body.A < body.C
    A, C = (body.C, body.A) if mirrored else (body.A, body.C)
    loop = np.zeros(curve.SLOTS)
    loop[curve.ALPHA] = float(A / C)
    loop[curve.FACTOR] = float(C / ((A - C) * A))
    loop[curve.MIRRORED] = float(mirrored)
    loop[curve.SIGN1] = motion.g3_sign if mirrored else motion.sign_of_g1
    half = float(motion.sign_of_g1 if mirrored else motion.g3_sign)
    log_lambda = primed_logarithm(0.5 * math.log(motion.lambda_squared), loop)
    window = -1 if motion.window is None else motion.window
    wishes = _wishes(motion)
    return None if window < -1 or wishes is None else Frame(loop, log_lambda, half, window, wishes)


def primed_logarithm(log_lambda: float, loop: FloatArray) -> float:
    """Return log λ in primed axes: λ' = λ^(−A/C) of the client, where they are mirrored."""
    return -log_lambda / float(loop[curve.ALPHA]) if loop[curve.MIRRORED] else log_lambda


def _wishes(motion: PlanarMotion) -> FloatArray | None:
    start = motion.start
    if isinstance(start, StartAtEquator):
        return np.array([EQUATOR, start.s_sign, 1.0, 0.0])
    if isinstance(start, StartAtRest):
        return np.array([REST, 1.0, start.g2_sign, 0.0])
    if isinstance(start, StartAtPoint):
        if start.g1 * motion.sign_of_g1 <= 0:
            return None
        return np.array([POINT, start.s_sign, start.g2_sign, abs(float(start.g1))])
    return np.array([0.0, 1.0, 1.0, 0.0])
