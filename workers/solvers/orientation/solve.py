r"""Adds the columns of the attitude to the dense output of a motion.

Error estimates. With ε the error of the motion's variables, an angle is wrong by
at most ε ∫ Σ|∂ψ̇/∂(variables)| dt and the quaternion by ε ∫ (√3/2) dt; to these
come the tails of the series, the rounding of their sums, and for a periodic
motion the measured defect of the period: how far the sums miss the advances,
which are known from the curve alone.

On a planar motion errors of the variables do not add up, since its attitude is a function of the place on
the curve: with Q = A g1² + C g3²

.. math:: d\psi_1 = f_1\,dg_2 = -\frac{A g_1 g_3\,dg_2}{Q(g_2^2+g_3^2)} ,\qquad
          d\psi_3 = f_3\,dg_2 = \frac{C g_1 g_3\,dg_2}{Q(g_1^2+g_2^2)} .

So an angle is wrong by what the series and ∫ f dg2 along the computed path differ by, which is seen; by what
the path's distance d from the curve does to that integral, ∫ d (|∇f||dg2| + |df|), d being seen too; and by
ε |dψ| over the largest component of |dg|, at both ends; errors of times, where they are known apart, move it
by |dψ/dt| times them, and ε is what is left. The quaternion is that of ψ1 and g, as far as it is
seen to be. What is seen is seen at twice as many points as the series have nodes: of
the bound that is a measurement, not a theorem.

Along a motion that was integrated errors of the variables do add up, but not all with one sign: their linear
equations have the attitude among them (:mod:`workers.solvers.integration.run_pair`). What these make of the
residual and of roundings is raised as the claim of the variables is above theirs.

The smallest bound holds.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import chebyshev

from service.dynamics.defect.equations import Equations
from service.dynamics.equations.orientation import (
    LOCAL_QUATERNION,
    QUATERNION,
    VERTICAL_ANGLE,
    attitude,
    orientation_columns,
    quaternion_product,
)
from service.dynamics.motion import COLUMNS, Motion, PlaceError
from service.dynamics.numerics import ErrorKind, largest
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.solution.dense_output import (
    EPSILON,
    UNIT_ROUNDOFF,
    Advance,
    DenseOutput,
    FloatArray,
    chebyshev_points,
)
from workers.solvers.assembly.dense import integration_matrix
from workers.solvers.integration.interface import Run
from workers.solvers.integration.run_pair import (
    DIFFERENCE_FACTOR,
    SHARED_RELATIVE_ROUNDING,
    TURN,
    errors_on_the_way,
)
from workers.solvers.integration.solve import LOCAL_TOLERANCE
from workers.solvers.orientation.advance import Precession, estimate, loop_advances
from workers.solvers.orientation.pieces import Pieces, VerticalAxisError, resolve_attitude

PERIODIC_VERTICAL_ANGLE = 1e-10
"""Angle from the vertical where the azimuths cannot be done without: there, the axes are never vertical."""
AXES = {"psi1": 0, "psi3": 2}
RATE_RELATIVE_ROUNDING = 4.0 * EPSILON
"""Rounding error of a rate, relative to its terms; and of a product of quaternions."""
CUT_RELATIVE_ROUNDING = 8.0 * EPSILON
"""Rounding error of the six variables on a part of a piece, relative to the sum of their coefficients."""
SLOWEST = float(np.finfo(np.float64).tiny)
"""Rates below it are none."""
UNSEEN_FACTOR = 2.0
"""Factor for the places between the points that are looked at."""


@dataclass(frozen=True, slots=True)
class Orientation:
    """A motion's dense output with the attitude."""

    dense: DenseOutput
    """The motion's columns, the local quaternion, psi1 and psi3: see dynamics.equations.orientation."""
    precession: Precession | None
    """Per period; None if the motion has none."""
    notices: tuple[str, ...]
    """Why psi1 or psi3 is not there."""
    kind: ErrorKind
    """The way in which errors of quaternion and angles are known: those of a motion are a part of them."""


Advances = Callable[[Loop, int], tuple[Advance, Advance]]
"""Returns the advances of ψ1 and ψ3 round a loop in a sense, as :func:`.advance.loop_advances` does."""


def with_orientation(
    motion: Motion, advances_of: Advances = loop_advances, equations: Equations | None = None
) -> Orientation:
    """Return the dense output of ``motion`` with the attitude added, and the precession per period.

    Pieces are halved where the attitude needs it; the motion's own columns stay
    the same functions but for the rounding of their coefficients, which is added to their error. With its
    ``equations`` the errors of a motion that was integrated are carried on to its attitude.

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
    loop = None if motion.window is None else motion.window.arcs[0].loop
    place = motion.place_error or PlaceError(off=motion.dense.error)
    # Pieces that were cut have a rounding more.
    place = replace(place, off=place.off + dense.error - motion.dense.error)
    bounds = _errors(dense, names, pieces, advances, None if loop is None else (loop, place))
    if equations is not None and LOCAL_TOLERANCE in motion.evidence:
        carried = _carried(equations, dense, names, pieces, float(motion.evidence[LOCAL_TOLERANCE]))
        # NaN, where the equations tell nothing, is no bound.
        bounds = np.fmin(bounds, carried)
    dense = replace(dense, errors=_named(bounds, names))
    precession = None
    if advances:
        precession = Precession(*(estimate(advances[name]) for name in AXES))
    # Beside that of the motion they are sums of what is seen of series and of roundings.
    kind: ErrorKind = "difference" if motion.function_kind == "difference" else "estimate"
    return Orientation(dense, precession, notices, kind)


def _resolve(dense: DenseOutput) -> tuple[tuple[str, ...], Pieces, tuple[str, ...]]:
    """Return the angles that have a meaning, the pieces, and the reasons for those that have none."""
    names, notices = list(AXES), list[str]()
    closest = VERTICAL_ANGLE if dense.period is None else PERIODIC_VERTICAL_ANGLE
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
    is_cut = pieces.high - pieces.low < 2.0
    rounding = CUT_RELATIVE_ROUNDING * np.abs(pieces.motion[is_cut]).sum(axis=1).max(initial=0.0)
    joined = DenseOutput(
        (*dense.columns, *LOCAL_QUATERNION, *names),
        _breaks(dense, pieces),
        np.concatenate([pieces.motion, quaternion, angles], axis=2),
        dense.period,
        dense.error + float(rounding),
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
    dense: DenseOutput,
    names: tuple[str, ...],
    pieces: Pieces,
    advances: dict[str, Advance],
    curve: tuple[Loop, PlaceError] | None,
) -> FloatArray:
    """Return the bounds within the breaks of the quaternion and the angles; see the head of the module."""
    span = float(dense.breaks[-1] - dense.breaks[0])
    weights = np.array([0.5 * math.sqrt(3.0) * span, *pieces.weights.sum(axis=0)])
    bounds: FloatArray = (dense.error + RATE_RELATIVE_ROUNDING) * weights + 2.0 * pieces.tails.sum(axis=0)
    bounds += RATE_RELATIVE_ROUNDING * math.sqrt(len(pieces.parent))
    bounds[0] += RATE_RELATIVE_ROUNDING / _tilt_at_zero(dense)
    if curve is not None and names == tuple(AXES):
        # NaN, where the curve tells nothing, is no bound.
        bounds = np.fmin(bounds, _along_the_curve(dense, *curve))
    if dense.period is not None:
        bounds += _defects(dense, names, advances)
    return bounds


def _named(bounds: FloatArray, names: tuple[str, ...]) -> dict[str, float]:
    """Return the bounds of the quaternion and of the angles by the names of their columns."""
    first, *others = bounds.tolist()
    return {**dict.fromkeys(LOCAL_QUATERNION, first), **dict(zip(names, others, strict=True))}


@np.errstate(all="ignore")
def _carried(
    equations: Equations, dense: DenseOutput, names: tuple[str, ...], pieces: Pieces, left_out: float
) -> FloatArray:
    """Return the bounds of the quaternion and of the angles by the equations of their errors.

    NaN where the equations tell nothing.
    """
    home, span = int(np.searchsorted(dense.breaks, 0.0)), np.diff(dense.breaks)
    motion = dense.coefficients[:, :, : len(COLUMNS)]
    mirrored = motion[:home][::-1].copy()
    mirrored[:, 1::2] *= -1.0
    backward, forward = (
        Run(dense.breaks[home::-1], mirrored, None),
        Run(dense.breaks[home:], motion[home:], None),
    )
    at_zero = UNIT_ROUNDOFF * np.abs(dense(np.zeros(1))[0, : len(COLUMNS)])
    axes, bounds = [AXES[name] for name in names], np.zeros(1 + len(names))
    for run in (backward, forward):
        if not len(run.coefficients):
            continue
        found = errors_on_the_way(equations, run, at_zero, left_out, axes)
        shown = DIFFERENCE_FACTOR * float(np.max(found.by_residual) + np.max(found.deviations))
        turned = DIFFERENCE_FACTOR * (found.turned_by_residual + found.turned_deviations)
        turned *= largest([1.0, dense.error / shown])
        # Half the length of φ is the quaternion's.
        half = 0.5 * np.linalg.norm(turned[:, :TURN], axis=1).max()
        bounds = np.maximum(bounds, [half, *turned[:, TURN:].max(axis=0)])
    # Roundings of the rates of a piece go together, those of different ones do not.
    weights = np.column_stack([span, pieces.weights])
    bounds += RATE_RELATIVE_ROUNDING * DIFFERENCE_FACTOR * np.sqrt(np.square(weights).sum(axis=0))
    # The table that integrates has roundings of its own, the same in all of them.
    bounds += RATE_RELATIVE_ROUNDING * len(pieces.parent)
    bounds += 2.0 * pieces.tails.sum(axis=0)
    bounds[0] += RATE_RELATIVE_ROUNDING / _tilt_at_zero(dense)
    # The time is rounded, and so are the numbers that set how fast the motion goes through it.
    turn = 0.5 * np.linalg.norm(np.abs(motion[:, :, :TURN]).sum(axis=1), axis=1).max()
    rates = (np.abs(pieces.increments.sum(axis=1)) / span[:, None]).max(axis=0)
    latest = float(np.abs(dense.breaks).max())
    carried: FloatArray = bounds + SHARED_RELATIVE_ROUNDING * latest * np.array([turn, *rates])
    return carried


def _tilt_at_zero(dense: DenseOutput) -> float:
    """Return the length by which the direction of the first axis at t = 0 is known."""
    g2, g3 = dense(np.zeros(1))[0, 4:6].tolist()
    tilt = math.hypot(g2, g3)
    return tilt if tilt > VERTICAL_ANGLE else 1.0


@np.errstate(all="ignore")
def _along_the_curve(dense: DenseOutput, loop: Loop, place: PlaceError) -> FloatArray:
    """Return the bounds of the quaternion and of both angles by the place; see the head of the module."""
    degree = dense.coefficients.shape[1] - 1
    points = chebyshev_points(2 * degree)
    values = chebyshev.chebvander(points, degree) @ dense.coefficients
    series = chebyshev.chebder(dense.coefficients[:, :, : len(COLUMNS)], axis=1)
    slopes = chebyshev.chebvander(points, degree - 1) @ series
    slope, fastest = slopes[:, :, 4], np.abs(slopes).max(axis=2)
    # As parts of half a piece.
    late = place.late * 2.0 / np.diff(dense.breaks)[:, None]
    besides = place.moved / np.maximum(fastest, SLOWEST)
    integration = integration_matrix(2 * degree)
    g1, g2, g3 = np.moveaxis(values[:, :, 3:6], -1, 0)
    off = _distances(loop, g1, g2, g3)
    A, C = (float(moment) for moment in ((loop.C, loop.A) if loop.mirrored else (loop.A, loop.C)))
    Q = A * g1 * g1 + C * g3 * g3
    widest = np.maximum(Q, np.maximum(np.abs(A * g1 * g2), np.abs(C * g3 * g2)))
    bounds = list[float]()
    for name, moment in (("psi1", -A), ("psi3", C)):
        own = values[:, :, 3 + AXES[name]]
        square = g1 * g1 + g2 * g2 + g3 * g3 - own * own
        both = moment * g1 * g3
        f = np.where(both == 0.0, 0.0, both / (Q * square))
        # Of f, by that of its logarithm; at a pole, where it is not bounded, the path has no length in g2.
        gradient = [
            moment * g3 / (Q * square) * (1.0 - 2.0 * A * g1 * g1 / Q),
            np.zeros_like(f),
            moment * g1 / (Q * square) * (1.0 - 2.0 * C * g3 * g3 / Q),
        ]
        for k, g in enumerate((g1, g2, g3)):
            gradient[k] = gradient[k] - (0.0 if k == AXES[name] else 2.0 * f * g / square)
        steepness = np.sqrt(sum(part * part for part in gradient)) * np.abs(slope) * off
        moved = float((np.where(np.isfinite(steepness), steepness, 0.0) @ integration[0]).sum())
        moved += float((np.abs(np.diff(f, axis=1)) * np.maximum(off[:, 1:], off[:, :-1])).sum())
        along = (f * slope) @ integration.T
        psi = values[:, :, dense.columns.index(name)]
        seen = float(np.ptp(psi - along - (np.cumsum(along[:, 0]) - along[:, 0])[:, None]))
        reach = float(np.nanmax(np.abs(both) / (square * widest)))
        bounds.append(
            UNSEEN_FACTOR * (seen + moved)
            + 2.0 * reach * place.off
            + float((np.abs(f * slope) * (place.ends * late + 2.0 * besides)).max())
            + RATE_RELATIVE_ROUNDING * float(np.abs(psi).max())
        )
    psi1, lean = values[:, :, dense.columns.index("psi1")], np.sqrt(g2 * g2 + g3 * g3)
    first = dense.columns.index(LOCAL_QUATERNION[0])
    q0, q1, q2, q3 = np.moveaxis(values[:, :, first : first + 4], -1, 0)
    # The first column and the third row of the rotation; what an error of g does to its tilt.
    turned = 2.0 * (q1 * q2 + q0 * q3) * np.cos(psi1) - (q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3) * np.sin(psi1)
    row = (2.0 * (q1 * q3 - q0 * q2), 2.0 * (q2 * q3 + q0 * q1), q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3)
    tilted = np.sqrt(sum((there - g) ** 2 for there, g in zip(row, (g1, g2, g3), strict=True)))
    seen = float(((np.abs(turned) + tilted) / lean).max())
    moved = np.linalg.norm(slopes[:, :, 3:6], axis=2) * (late + besides) + math.sqrt(3.0) * place.off
    tilt = float((moved / lean).max())
    return np.array([0.5 * (bounds[0] + tilt + UNSEEN_FACTOR * seen) + RATE_RELATIVE_ROUNDING, *bounds])


def _distances(loop: Loop, g1: FloatArray, g2: FloatArray, g3: FloatArray) -> FloatArray:
    """Return how far points are from the curve, to first order: the length of Newton's least step onto it."""
    if loop.mirrored:
        g1, g3 = g3, g1
    alpha, Z, G = float(loop.alpha), float(loop.Z), float(loop.G)
    law = loop.g1_sign * G * np.abs(g3 / Z) ** alpha
    steep = np.where(g3 == 0.0, 0.0, alpha * law / g3)
    size = np.hypot(1.0, steep)
    length, astray = 0.5 * (g1 * g1 + g2 * g2 + g3 * g3 - 1.0), (g1 - law) / size
    cosine = (g1 - steep * g3) / size
    distances: FloatArray = (np.abs(length) + np.abs(astray)) / np.sqrt(1.0 - cosine * cosine)
    return distances


def _defects(dense: DenseOutput, names: tuple[str, ...], advances: dict[str, Advance]) -> FloatArray:
    """Return how far quaternion and angles at the end of a period miss those one period after the start."""
    end = dict(zip(dense.columns, dense.coefficients[-1].sum(axis=0).tolist(), strict=True))
    assert dense.period is not None
    after = orientation_columns(dense, np.array([dense.period.hi]))
    local = zip(LOCAL_QUATERNION, QUATERNION, strict=True)
    quaternion = largest(abs(end[here] - float(after[there][0])) for here, there in local)
    angles = (abs(end[name] - advances.get(name, Advance()).hi) for name in names)
    return np.array([quaternion, *angles])
