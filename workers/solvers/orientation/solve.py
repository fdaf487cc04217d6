r"""Adds the columns of the attitude to the dense output of a motion.

Error estimates. With ε the error of the motion's variables, an angle is wrong by
at most ε ∫ Σ|∂ψ̇/∂(variables)| dt and the quaternion by ε ∫ (√3/2) dt; to these
come the tails of the series, the rounding of their sums, and for a periodic
motion the measured defect of the period: how far the sums miss the advances,
which are known from the curve alone.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from service.dynamics.bounds import largest
from service.dynamics.equations.orientation import (
    LOCAL_QUATERNION,
    QUATERNION,
    VERTICAL,
    attitude,
    orientation_columns,
    quaternion_product,
)
from service.dynamics.motion import Motion
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.solution.dense_output import EPSILON, Advance, DenseOutput, FloatArray
from workers.solvers.orientation.advance import Precession, estimate, loop_advances
from workers.solvers.orientation.pieces import Pieces, VerticalAxisError, resolve_attitude

CLOSEST_PERIODIC = 1e-10
"""Angle from the vertical where the azimuths cannot be done without: there, the axes are never vertical."""
AXES = {"psi1": 0, "psi3": 2}
ROUNDING = 4.0 * EPSILON
"""Of a rate, relative to its terms; of a product of quaternions."""


@dataclass(frozen=True, slots=True)
class Orientation:
    """A motion's dense output with the attitude."""

    dense: DenseOutput
    """The motion's columns, the local quaternion, psi1 and psi3: see dynamics.equations.orientation."""
    precession: Precession | None
    """Per period; None if the motion has none."""
    notices: tuple[str, ...]
    """Why psi1 or psi3 is not there."""


Advances = Callable[[Loop, int], tuple[Advance, Advance]]
"""What ψ1 and ψ3 gain round a loop in a sense, as :func:`.advance.loop_advances` has it."""


def with_orientation(motion: Motion, advances_of: Advances = loop_advances) -> Orientation:
    """Return the dense output of ``motion`` with the attitude added, and the precession per period.

    Pieces are halved where the attitude needs it; the motion's own columns stay
    the same functions with the same errors.

    Raises
    ------
    OrientationNotResolvedError
        The attitude would need too many pieces, or too short ones.
    VerticalAxisError
        A planar motion passes the vertical more closely than doubles can tell.
    QuadratureNotConvergedError, PrecisionLostError
        The precession on too extreme a curve.
    """
    names, pieces, notices = _resolve(motion.dense)
    dense = _with_columns(motion.dense, names, pieces)
    advances = _advances(motion, dense, advances_of)
    dense = replace(dense, advances={name: a for name, a in advances.items() if a != Advance()})
    dense = replace(dense, errors=_errors(dense, names, pieces, advances))
    precession = None
    if advances:
        precession = Precession(*(estimate(advances[name]) for name in AXES))
    return Orientation(dense, precession, notices)


def _resolve(dense: DenseOutput) -> tuple[tuple[str, ...], Pieces, tuple[str, ...]]:
    """Return the angles that have a meaning, the pieces, and the reasons for those that have none."""
    names, notices = list(AXES), list[str]()
    closest = VERTICAL if dense.period is None else CLOSEST_PERIODIC
    while True:
        try:
            axes = tuple(AXES[name] for name in names)
            return tuple(names), resolve_attitude(dense, axes, closest=closest), tuple(notices)
        except VerticalAxisError as vertical:
            if dense.period is not None:
                raise
            name = next(name for name in names if AXES[name] == vertical.axis)
            names.remove(name)
            notices.append(
                f"{name} is left out: axis {vertical.axis + 1} of the body passes the vertical "
                f"within {closest:g} rad"
            )


def _with_columns(dense: DenseOutput, names: tuple[str, ...], pieces: Pieces) -> DenseOutput:
    """Return the pieces joined, with the angles 0 and the quaternion that of gamma at t = 0."""
    ends = pieces.increments.sum(axis=1)
    starts = np.cumsum(ends, axis=0) - ends
    angles = pieces.increments.copy()
    angles[:, 0] += starts
    quaternion = quaternion_product(_starts(pieces.propagators.sum(axis=1))[:, None], pieces.propagators)
    count = len(dense.columns)
    joined = DenseOutput(
        (*dense.columns, *LOCAL_QUATERNION, *names),
        _breaks(dense, pieces),
        np.concatenate([pieces.motion, quaternion, angles], axis=2),
        dense.period,
        dense.error,
    )
    at_zero = joined(np.zeros(1))[0]
    there, psi = at_zero[count : count + 4], at_zero[count + 4 :]
    turn = quaternion_product(attitude(at_zero[3:6]), there * np.array([1.0, -1.0, -1.0, -1.0]))
    joined.coefficients[:, :, count : count + 4] = quaternion_product(turn / (there @ there), quaternion)
    joined.coefficients[:, 0, count + 4 :] -= psi
    return joined


def _breaks(dense: DenseOutput, pieces: Pieces) -> FloatArray:
    left, right = dense.breaks[pieces.parent], dense.breaks[pieces.parent + 1]
    inner = np.where(pieces.low == -1.0, left, left + (right - left) * (0.5 * (1.0 + pieces.low)))
    return np.append(inner, dense.breaks[-1])


def _starts(propagators: FloatArray) -> FloatArray:
    """Return the products of all propagators before each one, shape (pieces, 4).

    By doubling the stretches: the rounding grows with their number's logarithm.
    """
    products = np.concatenate([[[1.0, 0.0, 0.0, 0.0]], propagators[:-1]])
    step = 1
    while step < len(products):
        products[step:] = quaternion_product(products[:-step], products[step:])
        products /= np.linalg.norm(products, axis=1, keepdims=True)
        step *= 2
    return products


def _advances(motion: Motion, dense: DenseOutput, advances_of: Advances) -> dict[str, Advance]:
    """Return what psi1 and psi3 gain per period; empty without a period."""
    if motion.dense.period is None:
        return {}
    assert motion.window is not None  # only of planar motions a period is known
    arc = motion.window.arcs[0]
    if not arc.is_whole_loop:
        return dict.fromkeys(AXES, Advance())
    end = dense.coefficients[-1].sum(axis=0)
    psi1, psi3 = (end[dense.columns.index(name)] for name in AXES)
    return dict(zip(AXES, advances_of(arc.loop, 1 if psi1 > psi3 else -1), strict=True))


def _errors(
    dense: DenseOutput, names: tuple[str, ...], pieces: Pieces, advances: dict[str, Advance]
) -> dict[str, float]:
    """Return the bounds within the breaks of the quaternion and the angles; see the head of the module."""
    span = float(dense.breaks[-1] - dense.breaks[0])
    weights = np.array([0.5 * math.sqrt(3.0) * span, *pieces.weights.sum(axis=0)])
    bounds = (dense.error + ROUNDING) * weights + 2.0 * pieces.tails.sum(axis=0)
    bounds += ROUNDING * math.sqrt(len(pieces.parent))
    g2, g3 = dense(np.zeros(1))[0, 4:6].tolist()
    tilt = math.hypot(g2, g3)
    bounds[0] += ROUNDING / (tilt if tilt > VERTICAL else 1.0)
    if dense.period is not None:
        bounds += _defects(dense, names, advances)
    return {
        **dict.fromkeys(LOCAL_QUATERNION, float(bounds[0])),
        **dict(zip(names, bounds[1:].tolist(), strict=True)),
    }


def _defects(dense: DenseOutput, names: tuple[str, ...], advances: dict[str, Advance]) -> FloatArray:
    """Return how far quaternion and angles at the end of a period miss those one period after the start."""
    end = dict(zip(dense.columns, dense.coefficients[-1].sum(axis=0).tolist(), strict=True))
    assert dense.period is not None
    after = orientation_columns(dense, np.array([dense.period.hi]))
    local = zip(LOCAL_QUATERNION, QUATERNION, strict=True)
    quaternion = largest(abs(end[here] - float(after[there][0])) for here, there in local)
    angles = (abs(end[name] - advances.get(name, Advance()).hi) for name in names)
    return np.array([quaternion, *angles])
