r"""The multipliers of a periodic motion, proven: by the derivative of the flow over one period.

Validated integration encloses the derivative Φ of the state at a rational time t by that at 0. With the
period T in a ball next to t, Φ(T) = Ψ Φ(t), where Ψ is the derivative of the flow over T − t: with |J| ≤ K on
a box that the motion does not leave meanwhile,

.. math:: |\Psi - 1| \le e^{|T - t| K} - 1 .

Four of the six multipliers are 1 (two Casimir functions, the energy, the shift of time), the other two are μ
and 1/μ: so their sum is τ = tr Φ(T) − 4. The verdict follows where that is enclosed away from ±2.

What k periods do is M^k, M = Φ(T). The gradients of the three integrals are left eigenvectors of M to 1, and
independent at a state that moves: M − 1 = N has rank 3 at most, hence no chain to 1 is longer than 2 (4 where
τ = 2), and N²(M² − τM + 1) = 0. With the projector E on the pair μ, 1/μ, and S_k = (μ^k − μ^−k)/(μ − 1/μ),

.. math:: M^k = (1 + kN)(1 - E) + (S_k M - S_{k-1}) E, \qquad E = N^2 (N + 1 - τ)/(2 - τ) .
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from flint import arb, arb_mat, ctx
from numpy.typing import NDArray

from service.dynamics.accuracy import TIER_TOLERANCES
from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import BallAlgebra, ball
from service.dynamics.formula.tape import Tape
from service.dynamics.motion import Estimate
from service.dynamics.problem import Problem
from service.dynamics.solution.dense_output import UNIT_ROUNDOFF, Period
from workers.solvers.certified.certify import Certified
from workers.solvers.certified.validated.enclose import (
    ProvenTrajectory,
    Start,
    box_until,
    enclose,
    rational_next_to,
)
from workers.solvers.certified.validated.step import ROUND_UP, SUM_ROUNDING, upper
from workers.solvers.certified.validated.system import EulerPoisson, Recorded, record
from workers.solvers.classical.curve import Curve
from workers.solvers.classical.solve import place_motion
from workers.solvers.errors import CertifiedUnavailableError
from workers.solvers.stability.assessment import MAX_PERIODS, Proof, Stability, of_trace, trusted_time
from workers.solvers.stability.monodromy import StabilityUndefinedError

FloatArray = NDArray[np.float64]
Origin = tuple[RigidBody, Start]
"""A body with all its moments, and balls of its state at t = 0."""

FLOW_BITS = 40
"""Bits of the state along the way: the derivative of the flow is one of doubles."""
STEP_DIVISOR = 2
"""So many times shorter are steps, for the derivative of the flow: else some motions leave no digit of it."""
RETURN_BITS = 128
"""Bits of the state at the time at which it comes back."""
TRIVIAL_MULTIPLIERS = 4
"""Number of multipliers that are 1."""
NEWTON_TRIES = 6
PERIOD_RELATIVE_ERROR = 1e-9
"""Share of the period of a classical motion within which its quadrature is taken to know it."""
MAX_TRACE_RELATIVE_RADIUS = 2.0**-20
"""Radius of a trace, relative to it where it is above 1, from which on nothing is told of it."""
MOST_GROWTH = 700.0
"""Logarithm of the largest factor that is told from an infinite one."""
SUMMED = 1.0 + 2.0**-32
"""More than the roundings of a sum and of a time: those of an exponent below 700 are the largest."""


@dataclass(frozen=True, slots=True)
class ProvenTurn:
    """The derivative of the flow over one period of a motion, enclosed; ω in units of max(1, 2π/T)."""

    period: arb
    trace: arb
    """μ + 1/μ."""
    matrix: FloatArray
    """About Φ(T), shape (6, 6)."""
    speed: float
    """Bound of |ω|, in units of 1."""
    begins: tuple[float, ...]
    """Times from 0 on, at which the steps begin."""
    sizes: FloatArray
    """Bounds of the norms of Φ(t) X from 0 to the end of each step, shape (steps, 5): X is 1 and the four
    :func:`parts_of_powers`; shape (steps, 1) where these are not known."""


def proven_turn(body: RigidBody, potential: Tape, start: Start, period: arb) -> ProvenTurn:
    """Return what one period of the motion from ``start`` does to its neighbours.

    Raises
    ------
    CertifiedUnavailableError
        The motion is not enclosed, or its neighbours part too far in a period.
    """
    system = EulerPoisson(body, potential)
    recorded = record(system)
    time = rational_next_to(period)
    found = enclose(system, start, [time], FLOW_BITS, shorter=STEP_DIVISOR)
    trajectory = found.forward
    assert trajectory is not None
    with ctx.workprec(found.precision):
        late = arb(abs(period - ball(time)).abs_upper())
        matrix, lost = trajectory.flow(time)
        size = np.abs(matrix) + lost
        growth = _growth(recorded, found.states[0], late)
        lost = ROUND_UP * (lost + growth * np.ones_like(size) @ size)
        trace = sum(
            (arb(value, radius) for value, radius in zip(matrix.diagonal(), lost.diagonal(), strict=True)),
            arb(-TRIVIAL_MULTIPLIERS),
        )
        if not trace.rad() < MAX_TRACE_RELATIVE_RADIUS * abs(trace).max(arb(1)):
            text = "its neighbours part too far in one period to tell its multipliers"
            raise CertifiedUnavailableError(text)
        units = np.array([_unit(float(period))] * 3 + [1.0] * 3)
        scale = units / units[:, None]
        matrix, lost = matrix * scale, ROUND_UP * lost * scale
        rows = zip(matrix.tolist(), lost.tolist(), strict=True)
        turn = arb_mat([[arb(*entry) for entry in zip(*row, strict=True)] for row in rows])
        parts = [arb_mat(len(size), len(size), 1), *parts_of_powers(turn, trace)]
        sizes, speed = _on_the_way(trajectory, scale, [_in_doubles(part) for part in parts])
    begins = tuple(float(stretch.step.begin) for stretch in trajectory.stretches)
    # Φ(T) = Ψ Φ(t), and no entry of Ψ − 1 is above ``growth``.
    sizes = ROUND_UP * (1.0 + len(size) * growth * float(scale.max())) * sizes
    return ProvenTurn(period, trace, matrix, speed, begins, sizes)


def planar_stability(problem: Problem, origin: Origin, proven: Certified, about: Stability) -> Stability:
    """Return the stability of a planar motion with a proven trace; what is estimated where there is none."""
    if proven.period is None:
        return about
    body, start = origin
    try:
        turn = proven_turn(body, problem.potential.tape, start, proven.period)
    except CertifiedUnavailableError:
        return about
    return proven_stability(turn, _tolerance(problem))


def classical_stability(problem: Problem, origin: Origin) -> Stability:
    """Return the stability of a classical motion that closes.

    That it closes, about when its quadrature says, is taken from its case.

    Raises
    ------
    StabilityUndefinedError
        It does not close, or its multipliers are not enclosed.
    """
    placed = place_motion(problem)
    if placed.loop is None:
        raise StabilityUndefinedError(
            "multipliers belong to periodic motions, and this one does not close", pointer="/outputs"
        )
    about = float(Curve.of(placed).period)
    body, start = origin
    try:
        period = return_time(body, problem.potential.tape, start, about, PERIOD_RELATIVE_ERROR * about)
        turn = proven_turn(body, problem.potential.tape, start, period)
    except CertifiedUnavailableError as fault:
        text = f"its multipliers are not enclosed: {fault.message}"
        raise StabilityUndefinedError(text, pointer="/outputs") from fault
    found = proven_stability(turn, min(_tolerance(problem), TIER_TOLERANCES["draft"]))
    return found if problem.accuracy.tier == "certified" else replace(found, enclosed=None)


def return_time(body: RigidBody, potential: Tape, start: Start, about: float, within: float) -> arb:
    """Return the period of a motion that is known to close within so much of a time.

    The variable that changes fastest there comes back to its first value at the period: a zero of a function
    of time that is monotone on the whole interval, enclosed by Newton's method.

    Raises
    ------
    CertifiedUnavailableError
        It is not known to be monotone there.
    """
    system = EulerPoisson(body, potential)
    recorded = record(system)
    time, half = Fraction(about), Fraction(within)
    for _ in range(NEWTON_TRIES):
        found = enclose(system, start, [time, time + half], RETURN_BITS)
        trajectory = found.forward
        assert trajectory is not None
        with ctx.workprec(found.precision):
            first, here = start(), found.states[0]
            over = trajectory.over(time - half, time + half)
            rates = recorded.right_side.run(BallAlgebra(), over)
            fastest = max(rates, key=lambda name: float(abs(rates[name]).lower()))
            if not abs(rates[fastest]) > 0:
                break
            zero = ball(time) - (here[fastest] - first[fastest]) / rates[fastest]
            if not zero.overlaps(arb(ball(time), ball(half))):
                break
            if zero.rad() < arb(2) ** (8 - RETURN_BITS) * abs(zero):
                return zero
            time = rational_next_to(zero)
            half = Fraction(upper(zero.rad() * 2))
    raise CertifiedUnavailableError("it is not known to close there")


def _tolerance(problem: Problem) -> float:
    """Return the error that doubles may reach: that of the tier standard where balls are asked for."""
    is_proven = problem.accuracy.tier == "certified"
    return TIER_TOLERANCES["standard"] if is_proven else problem.tolerance


def proven_stability(turn: ProvenTurn, tolerance: float) -> Stability:
    """Return the stability that the trace tells, and until when doubles reach ``tolerance``."""
    trace, period = Estimate.of(turn.trace), Period.of(turn.period)
    is_known = turn.sizes.shape[1] > 1
    proof: Proof = "theorem" if is_known else "estimate"
    if is_known:
        horizon = proven_time(turn, tolerance)
    else:
        excursion = max(1.0, float(turn.sizes[-1, 0]) / max(1.0, float(np.linalg.norm(turn.matrix, 2))))
        horizon = trusted_time(turn.matrix, excursion, turn.speed, period.hi, tolerance)
    found = of_trace(trace.value, trace.error, period, horizon)
    return replace(found, proof="theorem", trusted_time_proof=proof, enclosed=turn.trace)


def proven_time(turn: ProvenTurn, tolerance: float) -> float | None:
    """Return a time until which roundings, carried on by the equations of variation, are below ``tolerance``.

    At the beginning of every period the state is disturbed by a rounding of all its numbers, or by less: with
    ω₀ = 2π/T, by u hypot(1, max|ω|/ω₀) at most, ω in units of max(1, ω₀). None if they stay below for
    MAX_PERIODS.
    """
    period = upper(turn.period)
    size = UNIT_ROUNDOFF * math.hypot(1.0, turn.speed * period / (2.0 * math.pi)) * _unit(period)

    def reached(count: int) -> FloatArray:
        """Return what it is at most after ``count`` periods, until the end of each step."""
        found: FloatArray = SUMMED * size * (turn.sizes[:, 1:] @ weights_of_powers(turn.trace, count))
        return found

    count = 0
    for by in reversed(range(MAX_PERIODS.bit_length())):
        if reached(count + 2**by - 1)[-1] <= tolerance:
            count += 2**by
    if count >= MAX_PERIODS:
        return None
    within = np.count_nonzero(reached(count) <= tolerance)
    return (count * float(turn.period.lower()) + turn.begins[within]) / SUMMED


def parts_of_powers(matrix: arb_mat, trace: arb) -> list[arb_mat]:
    """Return 1 − E, N (1 − E), M E and E of a matrix M with the trace τ; nothing if μ may be 1."""
    gap = 2 - trace
    if gap.contains(0):
        return []
    one = arb_mat(matrix.nrows(), matrix.ncols(), 1)
    moved = matrix - one
    across = moved * moved * (moved + (gap - 1) * one) * (1 / gap)
    still = one - across
    return [still, moved * still, matrix * across, across]


def weights_of_powers(trace: arb, count: int) -> FloatArray:
    """Return bounds of what M^0 + … + M^count has of each of the parts, shape (4,).

    |S_k| is at most |μ|^k min(k, w), with w = 2/√(4 − τ²) for a pair on the unit circle, 1/√(τ² − 4) for a
    real one.
    """
    size, apart = arb(abs(trace).abs_upper()).max(arb(2)), arb(abs(trace * trace - 4).abs_lower())
    most = upper((2 if abs(trace) < 2 else 1) / apart.sqrt()) if apart > 0 else math.inf
    # Not below |μ|, and never 1.
    multiplier = upper((size + abs(size * size - 4).sqrt()) / 2)
    exponent = (count + 1) * math.log1p(multiplier - 1.0)
    if not exponent < MOST_GROWTH:
        return np.full(4, math.inf)
    waves = min(float(count), most) * math.expm1(exponent) / (multiplier - 1.0)
    return np.array([count + 1.0, 0.5 * count * (count + 1.0), waves, 1.0 + waves])


def _growth(recorded: Recorded, state: Sequence[arb], late: arb) -> float:
    """Return a bound of the rows of |Ψ − 1| over a time ``late`` from a state, in any order of entries."""
    box = box_until(recorded, state, late)
    slopes = recorded.jacobian.run(BallAlgebra(), box).values()
    whole = sum((arb(slope.abs_upper()) for slope in slopes), arb(0))
    return upper((late * whole).expm1())


def _unit(period: float) -> float:
    return max(1.0, 2.0 * math.pi / period)


def _in_doubles(matrix: arb_mat) -> tuple[FloatArray, FloatArray]:
    """Return a matrix in doubles and a bound of what it misses."""
    middles = [[float(entry) for entry in row] for row in matrix.tolist()]
    pairs = (zip(*rows, strict=True) for rows in zip(matrix.tolist(), middles, strict=True))
    return np.array(middles), np.array([[upper(entry - middle) for entry, middle in pair] for pair in pairs])


def _on_the_way(
    trajectory: ProvenTrajectory, scale: FloatArray, parts: Sequence[tuple[FloatArray, FloatArray]]
) -> tuple[FloatArray, float]:
    """Return bounds of the norms of Φ X until the end of each step, and a bound of |ω|."""
    sizes, speed = list[list[float]](), 0.0
    for stretch in trajectory.stretches:
        corners, lost = trajectory.flow_along(stretch)
        corners, lost = corners * scale, lost * scale
        around = np.abs(corners).max(axis=0)
        row = list[float]()
        for part, missed in parts:
            off = around @ (missed + SUM_ROUNDING * np.abs(part)) + lost @ (np.abs(part) + missed)
            row.append(float(np.linalg.norm(corners @ part, axis=(1, 2)).max() + np.linalg.norm(off)))
        sizes.append(row)
        places, radius = trajectory.along(stretch)
        omega = np.linalg.norm(places[:, :3], axis=1).max() + np.linalg.norm(radius[:3])
        speed = max(speed, ROUND_UP * float(omega))
    return np.maximum.accumulate(np.array(sizes)), speed
