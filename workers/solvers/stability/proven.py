r"""The multipliers of a periodic motion, proven: by the derivative of the flow over one period.

Validated integration encloses the derivative Φ of the state at a rational time t by that at 0. With the
period T in a ball next to t, Φ(T) = Ψ Φ(t), where Ψ is the derivative of the flow over T − t: with |J| ≤ K on
a box that the motion does not leave meanwhile,

.. math:: |\Psi - 1| \le e^{|T - t| K} - 1 .

Four of the six multipliers are 1 (two Casimir functions, the energy, the shift of time), the other two are μ
and 1/μ: so their sum is tr Φ(T) − 4. The verdict follows where that is enclosed away from ±2.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.accuracy import TIER_TOLERANCES
from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import BallAlgebra, ball
from service.dynamics.formula.tape import Tape
from service.dynamics.motion import Estimate
from service.dynamics.problem import Problem
from service.dynamics.solution.dense_output import Period
from workers.solvers.certified.certify import Certified
from workers.solvers.certified.errors import CertifiedUnavailableError
from workers.solvers.certified.validated.enclose import (
    ProvenTrajectory,
    Start,
    box_until,
    enclose,
    rational_next_to,
)
from workers.solvers.certified.validated.step import ROUND_UP, upper
from workers.solvers.certified.validated.system import EulerPoisson, Recorded, record
from workers.solvers.classical.curve import Curve
from workers.solvers.classical.solve import place_motion
from workers.solvers.stability.assessment import Stability, of_trace, trusted_time
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


@dataclass(frozen=True, slots=True)
class ProvenTurn:
    """The derivative of the flow over one period of a motion, enclosed."""

    period: arb
    trace: arb
    """μ + 1/μ."""
    matrix: FloatArray
    """About Φ(T), shape (6, 6)."""
    excursion: float
    """Largest norm on the way, in parts of the larger one of those at both ends."""
    speed: float
    """About the largest |ω|."""


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
        raise CertifiedUnavailableError("its neighbours part too far in one period to tell its multipliers")
    return ProvenTurn(period, trace, matrix, *_on_the_way(trajectory, matrix))


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
    # Angular velocities in units of 2π/T, as speeds are.
    units = np.array([max(1.0, 2.0 * math.pi / period.hi)] * 3 + [1.0] * 3)
    matrix = turn.matrix * units / units[:, None]
    horizon = trusted_time(matrix, turn.excursion, turn.speed, period.hi, tolerance)
    found = of_trace(trace.value, trace.error, period, horizon)
    return replace(found, proof="theorem", enclosed=turn.trace)


def _growth(recorded: Recorded, state: Sequence[arb], late: arb) -> float:
    """Return a bound of the rows of |Ψ − 1| over a time ``late`` from a state, in any order of entries."""
    box = box_until(recorded, state, late)
    slopes = recorded.jacobian.run(BallAlgebra(), box).values()
    whole = sum((arb(slope.abs_upper()) for slope in slopes), arb(0))
    return upper((late * whole).expm1())


def _on_the_way(trajectory: ProvenTrajectory, last: FloatArray) -> tuple[float, float]:
    """Return the largest norm of the derivative on the way, in parts of the ends', and the largest |ω|."""
    starts = [stretch.start for stretch in trajectory.stretches]
    widest = max(float(np.linalg.norm(start.flow, 2)) for start in starts)
    speeds = [math.hypot(*(float(value) for value in start.middle[:3])) for start in starts]
    return max(1.0, widest / max(1.0, float(np.linalg.norm(last, 2)))), max(speeds)
