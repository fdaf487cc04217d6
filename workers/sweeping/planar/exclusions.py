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
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import Loops, have_no_motion, shape_of
from service.dynamics.reduction.sign_proofs.equators import equators
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
    none = np.zeros_like(g1)
    values, slopes = [g1, g2, g3], [-g3, none, g1]
    for operation, left, right, slot in program.code.tolist():
        x, dx = values[left], slopes[left]
        if operation == CONSTANT:
            value, slope = none + rows[:, slot, None, None], none
        elif operation == ADD:
            value, slope = x + values[right], dx + slopes[right]
        elif operation == SUBTRACT:
            value, slope = x - values[right], dx - slopes[right]
        elif operation == MULTIPLY:
            value, slope = x * values[right], x * slopes[right] + dx * values[right]
        elif operation == DIVIDE:
            value = x / values[right]
            slope = dx / values[right] - value * (slopes[right] / values[right])
        elif operation == NEGATE:
            value, slope = -x, -dx
        elif operation == POWER:
            exponent = rows[:, slot, None, None]
            value = np.power(x, exponent)
            slope = np.where(dx == 0.0, 0.0, exponent * value * (dx / x))
        else:
            value, slope = _called(operation, x, dx)
        values.append(value)
        slopes.append(slope)
    return slopes[program.result]


def _called(operation: int, x: FloatArray, dx: FloatArray) -> tuple[FloatArray, FloatArray]:
    if operation == EXP:
        return np.exp(x), np.exp(x) * dx
    if operation == LOG:
        return np.log(x), dx / x
    if operation == SIN:
        return np.sin(x), np.cos(x) * dx
    if operation == COS:
        return np.cos(x), -np.sin(x) * dx
    if operation == TAN:
        return np.tan(x), (1.0 + np.tan(x) ** 2) * dx
    # A sign, or a power whose exponent is no number: of these nothing is said but for |x|.
    return (np.abs(x), np.sign(x) * dx) if operation == ABS else (x + np.nan, dx + np.nan)


LOG_LAMBDA_ERROR = 2.0**-50
"""More than the error of log λ relative to 1 + |log λ|: λ², its logarithm, α and the quotient are rounded."""


def have_no_motion_at(
    body: RigidBody,
    motion: PlanarMotion,
    group: Group,
    chosen: IntArray,
    lambdas_squared: Sequence[fmpq],
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
