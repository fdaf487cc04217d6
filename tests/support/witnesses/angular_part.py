"""The angular part V1[F] of one function, and a potential from its decomposition: V1[F] + Q G, in doubles."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.real import RealAlgebra, ScalarAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.inverse.decomposition import Decomposition
from service.dynamics.inverse.section import Values
from service.dynamics.potentials.angular_part.field import angular_values
from service.dynamics.potentials.families.general_solution import SIGNS, Quadrant

FloatArray = NDArray[np.float64]


def angular_part(
    body: RigidBody,
    F: Callable[[FloatArray], FloatArray],
    gamma: FloatArray,
    reference_angle: float = math.pi / 4,
) -> FloatArray:
    """Return V1[F] at ``gamma`` of shape (..., 3), shape (...).

    The error is some 1e-15 of |V1| + max|F| along the path of integration, plus
    what a relative error of 1e-16·max(1, |log w|) of its argument makes of F;
    NaN where the integral does not exist or was not resolved.

    Parameters
    ----------
    F
        From an array of w > 0 to values of the same shape (or a constant).
    reference_angle
        φ0, strictly between 0 and π/2, where V1 = 0. Another one changes V1 by
        Q times an even function of g2.

    Raises
    ------
    EqualMomentsError
        A = C.
    """
    body.require_planar()
    gamma = np.asarray(gamma, dtype=np.float64)

    def single(w: FloatArray) -> FloatArray:
        return np.broadcast_to(F(w), w.shape)[None]

    result: FloatArray = angular_values(body, single, gamma[..., 0], gamma[..., 2], reference_angle)[0]
    return result


def reconstruct(found: Decomposition, gamma: FloatArray) -> Values:
    """Return V1[F] + Q G at ``gamma`` of shape (..., 3), shape (...); the error is the departure from V.

    NaN where g1 g3 = 0 and outside the quadrants where V has values.
    """
    gamma = np.asarray(gamma, dtype=np.float64)
    value = np.full(gamma.shape[:-1], np.nan)
    for quadrant in found.F:
        first, third = SIGNS[quadrant]
        inside = (first * gamma[..., 0] > 0.0) & (third * gamma[..., 2] > 0.0)
        if inside.any():
            value[inside] = _reconstruct_in(found, quadrant, gamma[inside])
    return Values(value, np.abs(value - found.potential.value(gamma)))


def _reconstruct_in(found: Decomposition, quadrant: Quadrant, gamma: FloatArray) -> FloatArray:
    Q = float(found.body.A) * gamma[:, 0] ** 2 + float(found.body.C) * gamma[:, 2] ** 2
    angle = float(compile_tape(parse(found.reference_angle), ()).evaluate(ScalarAlgebra(), ()))
    V1 = angular_part(found.body, _F_in_doubles(found, quadrant), gamma, angle)
    result: FloatArray = V1 + Q * found.G_at(quadrant, gamma[:, 1]).value
    return result


def _F_in_doubles(found: Decomposition, quadrant: Quadrant) -> Callable[[FloatArray], FloatArray]:
    formula = found.F[quadrant]
    if formula is None:
        return lambda w: found.F_at(quadrant, w).value
    tape = compile_tape(parse(formula), ("w",))
    return lambda w: tape.evaluate(RealAlgebra(), (w,))
