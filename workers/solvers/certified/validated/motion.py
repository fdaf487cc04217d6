"""The motion of a body from an exact state, proven: its samples as balls, and a function of time in doubles.

The error of the function of time is a theorem too: what the radius of a step, the terms that are left out and
the roundings of its coefficients and of its evaluation make together.
"""

from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache, partial
from math import comb
from typing import NamedTuple

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.defect.equations import integrals_at
from service.dynamics.equations.orientation import LOCAL_QUATERNION, attitude_in
from service.dynamics.errors import MissingMomentError
from service.dynamics.formula.algebras.ball import BallAlgebra, ball
from service.dynamics.motion import COLUMNS, Estimate, Motion
from service.dynamics.problem import Problem, TimePeriods
from service.dynamics.sampling import exact_instants, sample_times
from service.dynamics.solution.dense_output import UNIT_ROUNDOFF, DenseOutput
from workers.solvers.certified.certify import Certified
from workers.solvers.certified.validated.enclose import (
    Enclosure,
    ProvenStretch,
    ProvenTrajectory,
    Start,
    Watch,
    enclose,
)
from workers.solvers.certified.validated.step import ROUND_UP, upper
from workers.solvers.certified.validated.system import EulerPoisson, TurningBody
from workers.solvers.errors import CertifiedUnavailableError

FloatArray = NDArray[np.float64]

NEGLIGIBLE_RELATIVE_TERM = 2.0**-56
"""Terms of the function of time that are below this part of the largest one are left out."""
AXES = {"psi1": 0, "psi3": 2}
"""The axis of the body that each azimuth belongs to."""
EVALUATION_ROUNDINGS = 8
"""Roundings of the latest time that move a place on a piece: those of the piece's ends, and of the place."""


def prove_motion(
    problem: Problem, body: RigidBody, start: Start, *, watch: Watch | None = None
) -> tuple[Motion, Certified]:
    """Return the motion of a body from a state, rounded to doubles, and its enclosures at the asked times.

    Raises
    ------
    MissingMomentError
        The body has no B.
    CertifiedUnavailableError
        V has no formula, times are in periods, or as :func:`.enclose`.
    """
    potential = problem.potential
    if not potential.has_formula:
        raise CertifiedUnavailableError("its potential has no formula", pointer="/potential")
    if isinstance(problem.time, TimePeriods):
        message = "steps prove no period; accepted are start, stop and samples, or times"
        raise CertifiedUnavailableError(message, pointer="/time/periods")
    if body.B is None:
        raise MissingMomentError("an integration needs the moment B", pointer="/body/B")
    instants = exact_instants(problem.time) if problem.wants_series else []
    bits = problem.accuracy.bits
    columns: tuple[str, ...] = COLUMNS
    system = EulerPoisson(body, potential.tape)
    if "orientation" in problem.outputs:
        columns, found = _turning(system, start, instants, bits, watch)
    else:
        found = enclose(system, start, instants, bits, watch=watch)
    with ctx.workprec(found.precision):
        state = start()
        value = potential.tape.evaluate(BallAlgebra(), state[3:6])
        integrals = integrals_at(BallAlgebra(), body, state, value)
    certified = Certified(
        None,
        integrals.energy,
        found.states,
        tuple(map(ball, instants)),
        bits,
        "steps",
        areas=integrals.areas,
        geometric=integrals.geometric,
        columns=columns,
    )
    dense = function_of_time(found, columns)
    times = sample_times(problem.time, None)
    samples = np.array([[float(value) for value in state[: len(COLUMNS)]] for state in found.states])
    motion = Motion(
        method="integration",
        dense=dense,
        times=times.doubles[: len(instants)],
        samples=samples.reshape(-1, len(COLUMNS)),
        error=dense.error,
        samples_kind="theorem",
        function_kind="theorem",
        energy=Estimate.of(integrals.energy),
        window=None,
        aperiodic=None,
        past=None,
        future=None,
        cross_check=None,
        conventions=(),
        evidence={"steps": len(dense.breaks) - 1, "precision": found.precision},
        low_parts=times.low_parts[: len(instants)],
    )
    return motion, certified


def _turning(
    system: EulerPoisson, start: Start, instants: Sequence[Fraction], bits: int, watch: Watch | None
) -> tuple[tuple[str, ...], Enclosure]:
    """Return the motion with its attitude, without the azimuths that axes lose by becoming vertical.

    Raises
    ------
    CertifiedUnavailableError
        As :func:`.enclose`, without any azimuth.
    """
    for names in (("psi1", "psi3"), ("psi1",), ("psi3",), ()):
        axes = tuple(AXES[name] for name in names)
        try:
            found = enclose(
                TurningBody(system, axes), partial(with_attitude, start, axes), instants, bits, watch=watch
            )
        except CertifiedUnavailableError:
            if not names:
                raise
        else:
            return (*COLUMNS, *LOCAL_QUATERNION, *names), found
    raise AssertionError


def with_attitude(start: Start, axes: tuple[int, ...]) -> tuple[arb, ...]:
    """Return the state with its attitude, and azimuths of 0."""
    state = tuple(start())
    turn = attitude_in(BallAlgebra(), state[3:6], [float(g) for g in state[3:6]])
    return (*state, *turn, *(arb(0) for _ in axes))


def function_of_time(found: Enclosure, columns: tuple[str, ...]) -> DenseOutput:
    """Return the variables, named ``columns``, in doubles over all steps, with bounds of their errors."""
    pieces = [
        (trajectory, stretch)
        for trajectory, order in ((found.backward, -1), (found.forward, 1))
        if trajectory is not None
        for stretch in trajectory.stretches[::order]
    ]
    edges = [min(each.step.begin, each.step.begin + each.step.length) for _, each in pieces]
    last = pieces[-1][1].step
    edges.append(max(last.begin, last.begin + last.length))
    breaks = np.array([float(edge) for edge in edges])
    made = [_chebyshev(stretch) for _, stretch in pieces]
    sizes = np.max([np.abs(each.series).max(axis=1) for each in made], axis=0)
    needed = np.nonzero(sizes > NEGLIGIBLE_RELATIVE_TERM * sizes.max())[0]
    degree = max(1, int(needed.max()))
    latest = float(np.abs(breaks).max())
    errors = np.max(
        [
            _radius(trajectory, stretch) + _rounding(stretch, each, degree, latest)
            for (trajectory, stretch), each in zip(pieces, made, strict=True)
        ],
        axis=0,
    )
    coefficients = np.array([each.series[: degree + 1] for each in made])
    by_name = dict(zip(columns, (ROUND_UP * errors).tolist(), strict=True))
    error = max(by_name[name] for name in COLUMNS)
    return DenseOutput(columns, breaks, coefficients, None, error, by_name)


def _radius(trajectory: ProvenTrajectory, stretch: ProvenStretch) -> FloatArray:
    unit = arb(2) ** -trajectory.precision
    return np.array([upper(unit * width) for width in stretch.step.spread.tolist()])


def _rounding(stretch: ProvenStretch, piece: "_Piece", degree: int, latest: float) -> FloatArray:
    """Return bounds of what a piece leaves out and of all its roundings.

    The place of a time in its piece is known to a few roundings of the latest time, and a derivative of T_k
    is at most k². In Clenshaw's recurrence a rounding of b_j, which is below Σ (k − j + 1)|a_k|, grows j + 1
    times at most: all of them together are below Σ (k + 1)³|a_k|.
    """
    sizes, numbers = np.abs(piece.series), np.arange(len(piece.series))[:, None]
    late = latest / abs(float(stretch.step.length)) + 1.0
    moved = EVALUATION_ROUNDINGS * late * (numbers**2 * sizes).sum(axis=0)
    evaluated = ((numbers + 1.0) ** 3 * sizes).sum(axis=0)
    made = (len(sizes) + 4.0) * piece.terms
    left_out = sizes[degree + 1 :].sum(axis=0)
    return np.asarray(left_out + UNIT_ROUNDOFF * (moved + evaluated + made))


class _Piece(NamedTuple):
    series: FloatArray
    """Coefficients of Chebyshev polynomials on the piece, in the direction of time: (terms, columns)."""
    terms: FloatArray
    """Sum of the sizes of the polynomial's coefficients, from which they are made, shape (columns,)."""


def _chebyshev(stretch: ProvenStretch) -> _Piece:
    curves = stretch.step.curves
    terms = np.zeros((max(curve.length() for curve in curves), len(curves)))
    for column, curve in enumerate(curves):
        terms[: curve.length(), column] = [float(c) for c in curve.coeffs()]
    series: FloatArray = _to_chebyshev(len(terms)) @ terms
    if stretch.step.length < 0:
        series[1::2] *= -1.0
    return _Piece(series, np.abs(terms).sum(axis=0))


@lru_cache(maxsize=16)
def _to_chebyshev(count: int) -> FloatArray:
    """Return the matrix from coefficients of τ^k to those of T_j(x), τ = (1 + x)/2, all of which are ≥ 0.

    With x = cos 2φ: τ^k = cos^2k φ = 2^(1 − 2k) Σ' C(2k, k − j) cos 2jφ, the first of the sum halved.
    """
    matrix = np.zeros((count, count))
    for k in range(count):
        for j in range(k + 1):
            matrix[j, k] = float(Fraction(comb(2 * k, k - j) * (2 if j else 1), 4**k))
    return matrix
