"""One computation: a problem document in, a solution with its evidence out."""

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from fractions import Fraction
from importlib.metadata import version

import numpy as np
from numpy.typing import NDArray

from service.dynamics.errors import DynamicsError
from service.dynamics.motion import COLUMNS, CrossCheck, Motion
from service.dynamics.numerics import NUMERICS
from service.dynamics.problem import Problem, StateMotion
from service.dynamics.sampling import sample_times
from service.examination import examine_problem
from service.jobs.outcome import SolveOutcome
from service.schemas.problem import read_problem
from service.storage.codec import encode_arrays, encode_dense
from workers.solvers.cross_check import compare
from workers.solvers.integration.solve import integrate_state
from workers.solvers.invariants import measure_drifts
from workers.solvers.quadrature.description import FIRST_PASSAGE
from workers.solvers.quadrature.solve import planar_start, solve_planar

FloatArray = NDArray[np.float64]


def solve_document(document_json: str) -> SolveOutcome:
    """Solve the problem in ``document_json``; what cannot be solved is told in the outcome, not raised."""
    began = time.perf_counter()
    document = json.loads(document_json)
    try:
        problem = read_problem(document)
        motion = solve(problem)
        summary = summarise(document, problem, motion)
    except DynamicsError as fault:
        error: dict[str, object] = {"code": fault.code, "detail": fault.message, "pointer": fault.pointer}
        return SolveOutcome(summary=None, dense=b"", samples=b"", error=error)
    summary["cost"] = {"compute_seconds": time.perf_counter() - began}
    return SolveOutcome(summary, encode_dense(motion.dense), encode_arrays(_columns(problem, motion)), None)


def solve_checked(document_json: str) -> SolveOutcome:
    """Solve a problem whose potential and motion nobody has judged yet."""
    report = json.loads(examine_problem(document_json))
    if "error" in report:
        return SolveOutcome(summary=None, dense=b"", samples=b"", error=report["error"])
    return solve_document(document_json)


def solve(problem: Problem) -> Motion:
    """Solve a problem by the method it asks for; ``auto`` prefers the quadrature.

    Raises
    ------
    DynamicsError
        One class per cause; the solvers' functions name theirs.
    """
    if isinstance(problem.motion, StateMotion):
        return _integrate(problem, problem.motion.omega, problem.motion.gamma)
    if problem.method == "integration":
        state = planar_start(problem.body, problem.potential, problem.motion)
        return _integrate(problem, state[:3], state[3:])
    motion = solve_planar(problem)
    if problem.method == "both":
        return replace(motion, cross_check=_cross_check(problem, motion))
    return motion


def _integrate(
    problem: Problem, omega: Sequence[Fraction | float], gamma: Sequence[Fraction | float]
) -> Motion:
    times = sample_times(problem.time, None)
    return integrate_state(problem.body, problem.potential, omega, gamma, times, tolerance=problem.tolerance)


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


def summarise(document: dict[str, object], problem: Problem, motion: Motion) -> dict[str, object]:
    """Return the solution resource without its ids and cost."""
    period, window = motion.dense.period, motion.window
    return {
        "problem": document,
        "method": motion.method,
        "tier": "standard",
        "period": None
        if period is None
        else {
            "value": period.hi,
            "error": abs(period.lo) + period.error,
        },
        "aperiodic": motion.aperiodic,
        "asymptotes": None
        if motion.past is None or motion.future is None
        else {"past": asdict(motion.past), "future": asdict(motion.future)},
        "energy": asdict(motion.energy),
        "window": None
        if window is None
        else {
            "index": window.index,
            "ends": window.ends,
            "g1": window.g1,
            "g2": window.g2,
        },
        "invariants": _invariants(problem, motion),
        "error": motion.error,
        "cross_check": None if motion.cross_check is None else asdict(motion.cross_check),
        "stability": None,
        "conventions": motion.conventions,
        "evidence": dict(motion.evidence),
        "provenance": {"version": version("polhode"), "numerics": NUMERICS},
    }


def _invariants(problem: Problem, motion: Motion) -> dict[str, object] | None:
    if "invariants" not in problem.outputs:
        return None
    drifts = measure_drifts(problem.body, problem.potential, motion)
    return {name: {"drift": drift} for name, drift in asdict(drifts).items()}


def _columns(problem: Problem, motion: Motion) -> dict[str, FloatArray]:
    """Return t and the columns that were asked for."""
    wanted = [name for name in COLUMNS if ("gamma" if name.startswith("g") else "omega") in problem.outputs]
    series = {name: motion.samples[:, COLUMNS.index(name)] for name in wanted}
    return {"t": motion.times, **series}
