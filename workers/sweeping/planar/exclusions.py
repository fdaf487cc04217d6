"""Points of a sweep that no block solves: proven to have no motion, or perhaps with a zero next to a pole.

Points without a motion end with ``no_motion``, like single jobs. Near the poles D of many programs is looked
at where a solver in doubles does not look any more.
"""

from collections.abc import Sequence

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import Loops, equators, have_no_motion, shape_of
from workers.solvers.compiled.evaluation.program import (
    ABS,
    ADD,
    CONSTANT,
    COS,
    DIVIDE,
    EXP,
    LOG,
    MULTIPLY,
    NEGATE,
    POWER,
    SIGN,
    SIN,
    SUBTRACT,
    TAN,
    Program,
)
from workers.solvers.compiled.frame import make_frame
from workers.sweeping.parameters.programs import Group
from workers.sweeping.planar.doubles import logarithms_of

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
FloatArray = NDArray[np.floating]


KNOWN_POLE_DEPTHS = 4
"""Depths at which D must be known."""


def keep_their_sign(program: Program, rows: FloatArray, approaches: FloatArray) -> BoolArray:
    """Say for each row of constants (points, k) whether p² has one sign all the way to each pole.

    ``approaches`` (points, 2, depths, 3) are the way, begun where a solver
    in doubles stops looking. On it g1 and g3 keep their signs, hence p² has
    that of D up to a factor.
    """
    g1, g2, g3 = (approaches[..., k] for k in range(3))
    D = slopes_along(program, rows, g1, g2, g3)
    # What is beyond the numbers tells nothing.
    signs = np.sign(np.where(np.isfinite(D) & (g1 != 0.0) & (g3 != 0.0), D, np.nan))
    begun = signs[..., :1]
    same: BoolArray = ((signs == begun) | np.isnan(signs)).all(axis=(1, 2))
    return same & np.abs(begun).all(axis=(1, 2)) & ~np.isnan(signs[..., :KNOWN_POLE_DEPTHS]).any(axis=(1, 2))


@np.errstate(all="ignore")
def slopes_along(
    program: Program, rows: FloatArray, g1: FloatArray, g2: FloatArray, g3: FloatArray
) -> FloatArray:
    """Return D = g1 V_3 − g3 V_1: points by the rows of their constants, and any points of each.

    Far down the terms of D are beyond the range of doubles, but not of what processors have besides. Where
    nothing has a larger range the caller finds that it knows less.
    """
    g1, g2, g3, rows = (np.asarray(each, dtype=np.longdouble) for each in (g1, g2, g3, rows))
    values = [g1, g2, g3]
    for operation, left, right, slot in program.turn.code.tolist():
        x = values[left]
        if operation in (CONSTANT, POWER):
            number = right + (rows[:, slot, None, None] if slot >= 0 else np.zeros_like(g1))
            values.append(number + np.zeros_like(g1) if operation == CONSTANT else np.power(x, number))
        elif operation in _ARITHMETIC:
            values.append(_ARITHMETIC[operation](x, values[right]))
        else:
            values.append(_FUNCTIONS[operation](x))
    D: FloatArray = values[program.turn.results[0]]
    return D


_ARITHMETIC = {ADD: np.add, SUBTRACT: np.subtract, MULTIPLY: np.multiply, DIVIDE: np.divide}
_FUNCTIONS = {
    NEGATE: np.negative,
    EXP: np.exp,
    LOG: np.log,
    SIN: np.sin,
    COS: np.cos,
    TAN: np.tan,
    ABS: np.abs,
    SIGN: np.sign,
}


LOG_LAMBDA_ERROR = 2.0**-50
"""More than the error of log λ relative to 1 + |log λ|: λ², its logarithm, α and the quotient are rounded."""


def have_no_motion_at(
    body: RigidBody, motion: PlanarMotion, group: Group, chosen: IntArray, lambdas_squared: Sequence[fmpq]
) -> BoolArray:
    """Tell which ``chosen`` points of a group, on the curves of these λ², are proved to have no motion.

    ``motion`` gives everything but λ. False means not proved.
    """
    frame = make_frame(body, motion)
    if frame is None or not len(chosen):
        return np.zeros(len(chosen), dtype=np.bool_)
    shape = shape_of(body, motion)
    logarithms = frame.primed(np.array(logarithms_of(lambdas_squared)))
    errors = LOG_LAMBDA_ERROR * (1.0 + np.abs(logarithms))
    Z, G = equators(shape.alpha, logarithms - errors, logarithms + errors)
    inputs = tuple(column[chosen] for column in group.inputs())
    return have_no_motion(group.tape_of_all(), Loops(shape, Z, G, inputs))
