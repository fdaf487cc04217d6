"""Computes a classical motion: by the quadrature of its case, or by integration from its state at time 0.

A steady rotation is a constant.
"""

from dataclasses import replace
from fractions import Fraction

import numpy as np
from flint import ctx

from service.dynamics.classical.classification import relations_of
from service.dynamics.classical.placement import Placed, place
from service.dynamics.classical.protocol import CASE_BITS
from service.dynamics.motion import COLUMNS, Asymptote, Estimate, Motion
from service.dynamics.numerics import largest
from service.dynamics.problem import ClassicalMotion, Problem
from service.dynamics.sampling import SampleTimes
from service.dynamics.solution.dense_output import EPSILON, DenseOutput, Period
from workers.solvers.assembly.dense import nothing_resolved, resolve_motion
from workers.solvers.assembly.families import asked_times
from workers.solvers.classical.curve import Curve
from workers.solvers.classical.momentum import Momentum
from workers.solvers.evidence import with_claim_raised
from workers.solvers.integration.solve import integrate_from

PIECES_ERROR = 1e-14
"""Error of the pieces of the function of time, unless the samples are known to less."""
STATE_RELATIVE_ROUNDING = 2.0**-180
"""Relative rounding error of the state at time 0."""
DISTANCE = "distance_from_relations"
"""Key of the evidence: the largest distance of a sample from the relations of the case, to first order."""


def place_motion(problem: Problem) -> Placed:
    """Return the classical motion of a problem, placed in its body."""
    body = problem.body
    return place(
        problem.motion_as(ClassicalMotion), (body.A, body.B, body.C), allow_unphysical=body.allow_unphysical
    )


def solve_classical(problem: Problem, *, integrates: bool) -> Motion:
    """Return the motion by its quadrature, or, if ``integrates`` or there is none, by integration.

    Raises
    ------
    CaseError classes, AccuracyNotMetError, DynamicsError
        As :func:`.place` and :func:`.integrate_from` do.
    """
    placed = place_motion(problem)
    if integrates or (placed.loop is None and placed.case.form == "hess"):
        motion = integrate_from(problem, placed.start.omega, placed.start.gamma)
    elif placed.case.form == "steady":
        motion = _steady(problem, placed)
    elif placed.case.form == "hess":
        motion = _of_hess(problem, placed)
    else:
        motion = _of_loop(problem, placed)
    return _with_relations(placed, motion)


def _steady(problem: Problem, placed: Placed) -> Motion:
    times = asked_times(problem, None)
    # Each variable is the double nearest to its value.
    state = np.array([float(x) for x in (*placed.start.omega, *placed.start.gamma)])
    rounding = float(np.spacing(np.abs(state).max()))
    dense = DenseOutput(COLUMNS, np.array(_span(times)), state.reshape(1, 1, 6), None, rounding)
    motion = _motion(problem, placed, dense, times)
    g1, g2, g3 = (float(g) for g in placed.start.gamma)
    limit = Asymptote("equilibrium", None, None, (g1, g2, g3))
    return replace(motion, aperiodic="equilibrium", past=limit, future=limit)


def _of_loop(problem: Problem, placed: Placed) -> Motion:
    curve = Curve.of(placed)
    with ctx.workprec(CASE_BITS):
        length = curve.period
        hi = float(length)
        lo = float(length - hi)
        turns = length / curve.clock.mean
        error = float((curve.clock.error * turns).abs_upper()) + float(np.spacing(abs(lo)))
    period: Period | None = Period(hi, lo, error)
    own = curve.error()
    if problem.wants_series:
        found = resolve_motion(
            curve.sample, (0.0, hi), np.zeros(0), scale=hi, atol=max(PIECES_ERROR, 0.25 * own)
        )
    else:
        found = nothing_resolved(hi)
    columns = COLUMNS[: found.coefficients.shape[2]]
    asked = asked_times(problem, period)
    if "orientation" in problem.outputs:
        # What the attitude gains in a period is known of planar motions alone: it needs all the asked times.
        span = _span(asked)
        found = resolve_motion(curve.sample, span, np.zeros(0), scale=hi, atol=max(PIECES_ERROR, 0.25 * own))
        period, own = None, own + found.moved(4.0 * EPSILON * max(map(abs, span)))
    dense = DenseOutput(columns, found.breaks, found.coefficients, period, found.error + own)
    motion = _motion(problem, placed, dense, asked)
    nodes = float(len(curve.clock.doubles))
    return replace(
        motion, evidence={**motion.evidence, "terms_of_time": nodes, "pieces": len(found.breaks) - 1}
    )


def _of_hess(problem: Problem, placed: Placed) -> Motion:
    times = asked_times(problem, None)
    span = _span(times)
    momentum = Momentum.of(placed, span)
    own = momentum.error()
    found = resolve_motion(
        momentum.sample, span, np.zeros(0), scale=span[1] - span[0], atol=max(PIECES_ERROR, 0.25 * own)
    )
    own += found.moved(momentum.time_error(max(map(abs, span))))
    dense = DenseOutput(COLUMNS, found.breaks, found.coefficients, None, found.error + own)
    motion = _motion(problem, placed, dense, times)
    return replace(motion, evidence={**motion.evidence, "pieces": len(found.breaks) - 1})


def _span(times: SampleTimes) -> tuple[float, float]:
    first, last = float(times.doubles.min(initial=0.0)), float(times.doubles.max(initial=0.0))
    return (first, last) if first < last else (first, first + 1.0)


def _motion(problem: Problem, placed: Placed, dense: DenseOutput, asked: SampleTimes) -> Motion:
    times, low_parts = asked.doubles, asked.low_parts
    samples = dense(times, low_parts) if len(times) else np.zeros((0, len(COLUMNS)))
    motion = Motion(
        method="quadrature",
        dense=dense,
        times=times,
        samples=samples,
        error=dense.error_at(times) if len(times) else 0.0,
        samples_kind="estimate",
        function_kind="estimate",
        energy=_energy(problem, placed),
        window=None,
        aperiodic=None,
        past=None,
        future=None,
        cross_check=None,
        conventions=(),
        evidence={"case": placed.case.name},
        low_parts=low_parts,
    )
    return with_claim_raised(problem.body, problem.potential, motion)


def _energy(problem: Problem, placed: Placed) -> Estimate:
    """Return the energy of the state at time 0, exact and then rounded."""
    body, motion = placed.body, problem.motion_as(ClassicalMotion)
    assert body.B is not None
    kinetic = sum(
        (m * w * w for m, w in zip((body.A, body.B, body.C), placed.start.omega, strict=True)), Fraction(0)
    )
    potential = sum((c * g for c, g in zip(motion.centre, placed.start.gamma, strict=True)), Fraction(0))
    h = kinetic / 2 + potential
    # The state is rounded too, to some 70 digits: an energy of 0 is what that leaves.
    error = float(np.spacing(abs(float(h))) + STATE_RELATIVE_ROUNDING * kinetic)
    return Estimate(float(h), error, "estimate")


def _with_relations(placed: Placed, motion: Motion) -> Motion:
    """Return ``motion`` with claims that are not below the distance of its samples from the relations.

    Its evidence has the moments too, of which a problem may leave out what follows from the case.
    """
    distance = relations_of(placed).distance(motion.samples, known=motion.error)
    body = placed.body
    assert body.B is not None
    moments = {"A": float(body.A), "B": float(body.B), "C": float(body.C)}
    evidence = {**motion.evidence, **moments, DISTANCE: distance}
    return replace(motion, evidence=evidence, error=largest((motion.error, distance)))
