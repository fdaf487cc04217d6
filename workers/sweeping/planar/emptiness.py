"""Proves points of a sweep to have no motion; they end with ``no_motion``, like single jobs."""

from collections.abc import Sequence

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import Loops, have_no_motion, shape_of
from service.dynamics.reduction.sign_proofs.equators import equators
from workers.solvers.compiled.frame import make_frame
from workers.sweeping.parameters.programs import Group
from workers.sweeping.planar.doubles import logarithms_of

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

LOGARITHM = 2.0**-50
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
    errors = LOGARITHM * (1.0 + np.abs(logarithms))
    Z, G = equators(shape.alpha, logarithms - errors, logarithms + errors)
    inputs = tuple(column[chosen] for column in group.inputs())
    return have_no_motion(group.tape_of_all(), Loops(shape, Z, G, inputs))
