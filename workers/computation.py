"""One computation: a problem document in, a solution with its evidence out."""

import json
import time
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from service.dynamics.bounds import is_within
from service.dynamics.dense_output import DenseOutput
from service.dynamics.errors import BudgetTooSmallError, DynamicsError
from service.dynamics.motion import COLUMNS, CrossCheck, Motion
from service.dynamics.orientation import orientation_columns
from service.dynamics.problem import Problem, StateMotion
from service.dynamics.sampling import sample_times
from service.examination import examine_problem
from service.jobs.outcome import SolveOutcome
from service.schemas.budgets import choose_tier, window_of, with_tier
from service.schemas.problem import place_sent, read_problem
from service.storage.solutions.accuracy_store import shipped_table
from service.storage.solutions.codec import encode_arrays, encode_dense
from workers.certification import beside_enclosures, certified_samples, with_tolerance_kept
from workers.findings import find_out
from workers.solvers.cross_check import compare
from workers.solvers.errors import AccuracyNotMetError
from workers.solvers.integration.solve import integrate_state
from workers.solvers.quadrature.description import FIRST_PASSAGE
from workers.solvers.quadrature.solve import attempt_planar, planar_start, solve_planar
from workers.summary import summarise

FloatArray = NDArray[np.float64]


def solve_document(document_json: str) -> SolveOutcome:
    """Solve the problem in ``document_json``; what cannot be solved is told in the outcome, not raised."""
    began = time.perf_counter()
    document = json.loads(document_json)
    try:
        problem = read_problem(document)
        motion, certified, enclosures = solve(problem), None, dict[str, FloatArray]()
        if problem.accuracy.tier == "certified":
            motion, certified, enclosures = certified_samples(problem, motion)
        motion = _require_finite(motion, problem.tolerance)
        findings = find_out(problem, motion)
        summary = summarise(document, problem, motion, findings, certified)
    except DynamicsError as fault:
        return _refused(document, fault)
    # The orientation is more columns on the same pieces.
    dense = motion.dense if findings.orientation is None else findings.orientation.dense
    summary["cost"] = {"compute_seconds": time.perf_counter() - began}
    columns = _columns(problem, motion, dense)
    columns |= {name: part for name, part in enclosures.items() if name.partition(".")[0] in columns}
    return SolveOutcome(summary, encode_dense(dense), encode_arrays(columns), None)


def _refused(document: object, fault: DynamicsError) -> SolveOutcome:
    pointer = place_sent(document, fault.pointer)
    error: dict[str, object] = {"code": fault.code, "detail": fault.message, "pointer": pointer}
    return SolveOutcome(summary=None, dense=b"", samples=b"", error=error)


def solve_checked(document_json: str, *, explains: bool = True) -> SolveOutcome:
    """Solve a problem whose potential and motion nobody has judged yet.

    Where there is no motion, an error that ``explains`` says for which λ there are.
    """
    report = json.loads(examine_problem(document_json, explains=explains))
    if "error" in report:
        return SolveOutcome(summary=None, dense=b"", samples=b"", error=report["error"])
    document = json.loads(document_json)
    problem = read_problem(document)
    if problem.accuracy.budget_seconds is not None:
        # Without a database there is only the table that comes with the program.
        try:
            choice = choose_tier(problem, window_of(report["verdict"]), shipped_table())
        except BudgetTooSmallError as fault:
            return _refused(document, fault)
        document_json = json.dumps(with_tier(document, choice))
    return solve_document(document_json)


def solve(problem: Problem) -> Motion:
    """Solve a problem by the method it asks for; ``auto`` prefers the quadrature.

    ``auto`` and ``both`` keep every tolerance that can be kept: where doubles do
    not, the samples are rounded from enclosures.

    Raises
    ------
    DynamicsError
        One class per cause; the solvers' functions name theirs.
    """
    if problem.accuracy.tier == "certified":
        # The enclosures come on top; this is the function of time between them.
        problem = replace(problem, accuracy=beside_enclosures(problem))
    if isinstance(problem.motion, StateMotion):
        return _integrate(problem, problem.motion.omega, problem.motion.gamma)
    if problem.method == "integration":
        state = planar_start(problem.body, problem.potential, problem.motion)
        return _integrate(problem, state[:3], state[3:])
    # The method quadrature does without enclosures; those of the certified tier come on top of this.
    is_alone = problem.method == "quadrature" or problem.accuracy.tier == "certified"
    motion = solve_planar(problem) if is_alone else attempt_planar(problem)
    if problem.method == "both":
        motion = replace(motion, cross_check=_cross_check(problem, motion))
    return with_tolerance_kept(problem, motion)


def _require_finite(motion: Motion, tolerance: float) -> Motion:
    """Refuse a motion whose numbers are not all finite: no bound is one of them."""
    numbers = (motion.samples, motion.dense.coefficients, motion.dense.breaks)
    if not all(np.isfinite(part).all() for part in numbers):
        raise AccuracyNotMetError(float("nan"), tolerance)
    if not (isfinite(motion.dense.error) and is_within(motion.error, float("inf"))):
        raise AccuracyNotMetError(float("nan"), tolerance)
    return motion


def _integrate(
    problem: Problem, omega: Sequence[Fraction | float], gamma: Sequence[Fraction | float]
) -> Motion:
    times = sample_times(problem.time, None)
    return integrate_state(
        problem.body,
        problem.potential,
        omega,
        gamma,
        times.doubles,
        tolerance=problem.tolerance,
        rests=times.rests,
    )


def _cross_check(problem: Problem, motion: Motion) -> CrossCheck:
    # Beyond a pole that is passed by convention an integrator may follow another branch.
    limit = motion.evidence.get(FIRST_PASSAGE)
    return compare(
        motion,
        problem.body,
        problem.potential,
        tolerance=problem.tolerance,
        limit=limit if isinstance(limit, float) else None,
    )


def _columns(problem: Problem, motion: Motion, dense: DenseOutput) -> dict[str, FloatArray]:
    """Return t, rounded to doubles, and the columns that were asked for, at the exact times."""
    if not problem.wants_series:
        return {}
    wanted = [name for name in COLUMNS if ("gamma" if name.startswith("g") else "omega") in problem.outputs]
    series = {name: motion.samples[:, COLUMNS.index(name)] for name in wanted}
    return {"t": motion.times, **series, **orientation_columns(dense, motion.times, motion.rests)}
