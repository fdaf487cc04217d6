"""Computes one problem: from its document to a solution with its evidence."""

import json
import logging
import time
from collections.abc import Callable
from dataclasses import replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from service.dynamics.accuracy import TIER_TOLERANCES
from service.dynamics.bounds import is_within
from service.dynamics.equations.orientation import orientation_columns
from service.dynamics.errors import BudgetTooSmallError, DynamicsError
from service.dynamics.motion import COLUMNS, CrossCheck, Motion, columns_of
from service.dynamics.problem import PlanarMotion, Problem, StateMotion
from service.dynamics.reduction.windows import hand_on_windows
from service.dynamics.solution.dense_output import DenseOutput
from service.dynamics.verdict.simple_form import simplified
from service.jobs.kernels import NeedsKernelsError, told_way
from service.jobs.records import Refused, Solved, SolveOutcome, StoredSolution
from service.schemas.problem.budgets import choose_tier, window_of, with_tier
from service.schemas.problem.problem import place_sent, read_problem
from service.schemas.problem.trusted import trusted_problem
from service.schemas.reading.documents import Part
from service.storage.codecs.arrays import encode_arrays, encode_dense
from service.storage.solutions.shipped_accuracy import shipped_table
from service.verdicts.cached import Kept, read_windows
from service.verdicts.examination import Examined, examine_document
from workers import solvers
from workers.computation.certification import beside_enclosures, certified_samples, with_tolerance_kept
from workers.computation.compiled_code import (
    GROUPS,
    Group,
    fixed_way,
    is_ready,
    keep_compiled_code,
    way_for,
    why_no_folder,
)
from workers.computation.outputs import InUnits, find_out
from workers.computation.promises import errors_of, in_units, require_promise
from workers.computation.summary import Document, summarise
from workers.solvers.cross_check import compare
from workers.solvers.errors import AccuracyNotMetError, require_error_within, require_period_known
from workers.solvers.planar.choose import choose_enclosures, find_motion
from workers.solvers.units import Units
from workers.solvers.ways import NotReadyError, Way, on_way

FloatArray = NDArray[np.float64]

logger = logging.getLogger(__name__)


def solve_document(
    document_json: str,
    windows_json: str = "",
    way: Way | None = None,
    *,
    waits: bool = False,
    read: Callable[[Part], Problem] = trusted_problem,
) -> SolveOutcome:
    """Solve the problem in ``document_json``; what cannot be solved is told in the outcome, not raised.

    ``windows_json`` has the windows of its curve, if they were kept: they are not found again. Without a
    ``way`` it is the compiled one if its kernels are ready, and a plain one waits for them: no refusal of a
    solver is final. So does a given one that ``waits``. A document that nobody has validated is ``read`` by
    who does.

    Raises
    ------
    NeedsKernelsError
        The plain way waits for kernels, and does not have what they have.
    """
    began = time.perf_counter()
    document = json.loads(document_json)
    try:
        problem = read(document)
    except DynamicsError as fault:
        return _refused(document, fault)
    motion = problem.motion
    if not windows_json or not isinstance(motion, PlanarMotion):
        return _solve_read(document, as_solved(problem), began, way, waits)
    windows = read_windows(windows_json, problem.body, problem.potential, motion)
    if windows:
        # Whether there is a simpler formula was found with them.
        problem = replace(problem, potential=windows[0].arcs[0].loop.potential)
    hand_on_windows(problem.body, problem.potential, motion, windows)
    return _solve_read(document, problem, began, way, waits)


def as_solved(problem: Problem) -> Problem:
    """Return a planar problem with the formula that windows are found with."""
    if not isinstance(problem.motion, PlanarMotion):
        return problem
    potential = simplified(problem.potential)
    return problem if potential is problem.potential else replace(problem, potential=potential)


def way_to_repeat(stored: StoredSolution) -> Way | None:
    """Return the way of a stored solution, on which its bits can be repeated; None if it is not to be had."""
    if told_way(stored.summary) == "plain":
        return "plain"
    return "compiled" if is_ready(*GROUPS) else None


def kernels_of(problem: Problem) -> tuple[Group, ...]:
    """Return the kernels that a problem may need."""
    groups: list[Group] = []
    if not isinstance(problem.motion, StateMotion) or "invariants" in problem.outputs:
        groups.append("planar")
    if "stability" in problem.outputs:
        groups.append("outputs")
    if isinstance(problem.motion, StateMotion) or problem.method in ("integration", "both"):
        groups.append("states")
    return tuple(groups)


def _solve_read(
    document: Document, problem: Problem, began: float, way: Way | None, waits: bool
) -> SolveOutcome:
    """Solve the ``problem`` that was read from ``document``."""
    chosen = way or way_for(*kernels_of(problem))
    try:
        with on_way(chosen):
            may_wait = chosen == "plain" and (waits or way is None) and _can_wait()
            return _solve_on_way(document, problem, began, waits=may_wait)
    except NotReadyError as fault:
        if way is not None or not _can_wait():
            raise
        logger.warning("solved the plain way: %s", fault)
    with on_way("plain"):
        return _solve_on_way(document, problem, began, waits=False)


def _can_wait() -> bool:
    """Tell whether kernels will be there: else, or if somebody wants it so, the plain way is all there is."""
    return fixed_way() is None and why_no_folder() is None


def _solve_on_way(document: Document, problem: Problem, began: float, *, waits: bool) -> SolveOutcome:
    """Solve it on the present way; one that ``waits`` for kernels takes no refusal of a solver for final.

    What is wrong with the problem itself is final on any way.
    """
    # Its speed is asked of kernels before it is solved.
    keep_compiled_code()
    try:
        summary, dense, columns = in_units(problem, lambda units: _solve_in(document, problem, units))
    except DynamicsError as fault:
        if waits and type(fault).__module__.startswith(solvers.__name__):
            raise NeedsKernelsError(_refused(document, fault).error) from fault
        return _refused(document, fault)
    summary["cost"] = {"compute_seconds": time.perf_counter() - began}
    return Solved(summary, encode_dense(dense), encode_arrays(columns))


def _solve_in(
    document: Document, problem: Problem, units: Units
) -> tuple[Document, DenseOutput, dict[str, FloatArray]]:
    """Return the summary of the solution, its function of time and its columns, solved in ``units``."""
    posed, certified, enclosures = units.pose(problem), None, dict[str, FloatArray]()
    solved = solve(posed)
    if problem.accuracy.tier == "certified":
        solved, proven, enclosures = certified_samples(posed, solved)
        certified, enclosures = units.certified(proven), units.enclosures(enclosures)
    motion = _require_finite(units.motion(solved), problem.tolerance)
    findings = find_out(problem, motion, InUnits(units, posed, solved))
    # The orientation is more columns on the same pieces.
    attitude = None if findings.orientation is None else findings.orientation.dense
    errors = errors_of(motion, attitude)
    require_promise(problem.accuracy, errors)
    summary = summarise(document, problem, motion, findings, certified, errors)
    dense = motion.dense if attitude is None else attitude
    columns = _columns(problem, motion, dense)
    columns |= {name: part for name, part in enclosures.items() if name.partition(".")[0] in columns}
    return summary, dense, columns


def _refused(document: object, fault: DynamicsError) -> Refused:
    pointer = place_sent(document, fault.pointer)
    return Refused({"code": fault.code, "detail": fault.message, "pointer": pointer})


def solve_checked(
    document_json: str,
    *,
    explains: bool = True,
    kept: Kept | None = None,
    way: Way | None = None,
    waits: bool = False,
) -> SolveOutcome:
    """Examine and solve a problem whose potential and motion have not been examined yet.

    Where there is no motion, an error that ``explains`` says for which λ there are. In ``kept`` are verdicts
    that were found before. The way is that of :func:`solve_document`.
    """
    document = json.loads(document_json)
    examined = examine_document(document, explains=explains, kept=kept, read=read_problem)
    return _solve_examined(document, examined, way, waits=waits)


def solve_judged(document_json: str, report_json: str) -> SolveOutcome:
    """Solve a problem of which ``report_json`` is what :func:`.examine_problem` answers."""
    document, report = json.loads(document_json), json.loads(report_json)
    problem = None if "error" in report else trusted_problem(document)
    return _solve_examined(document, Examined(report, problem), None)


def _solve_examined(
    document: Document, examined: Examined, way: Way | None, *, waits: bool = False
) -> SolveOutcome:
    began = time.perf_counter()
    problem, report = examined.problem, examined.answer
    if problem is None or "error" in report:
        error = report["error"]
        assert isinstance(error, dict)
        return Refused(error)
    if problem.accuracy.budget_seconds is not None:
        verdict = report["verdict"]
        assert verdict is None or isinstance(verdict, dict)
        # Without a database there is only the table that comes with the program.
        try:
            choice = choose_tier(problem, window_of(verdict), shipped_table())
        except BudgetTooSmallError as fault:
            return _refused(document, fault)
        # Another document: it states a tier where the first one had a budget.
        document = with_tier(document, choice)
        problem = trusted_problem(document)
    return _solve_read(document, as_solved(problem), began, way, waits)


def solve(problem: Problem) -> Motion:
    """Solve a problem by what the table of solvers names for it; ``auto`` prefers the quadrature.

    ``auto`` and ``both`` keep every tolerance that can be kept: where doubles do
    not, the samples are rounded from enclosures. The tolerance holds for the period
    too, relative to it; beside enclosures that of the tier standard does.

    Raises
    ------
    DynamicsError
        One class per cause; the solvers' functions name theirs.
    """
    enclosing = choose_enclosures(problem).when
    if enclosing == "always":
        # The enclosures come on top; this is the function of time between them.
        problem = replace(problem, accuracy=beside_enclosures(problem))
    motion = find_motion(problem)
    if motion.method == "integration":
        return motion
    if enclosing != "where needed":
        require_error_within(motion.error, problem.tolerance)
        is_beside = enclosing == "always"
        require_period_known(
            motion.dense.period, TIER_TOLERANCES["standard"] if is_beside else problem.tolerance
        )
    if problem.method == "both":
        motion = replace(motion, cross_check=_cross_check(problem, motion))
    if enclosing == "where needed":
        return with_tolerance_kept(problem, motion)
    return motion


def _require_finite(motion: Motion, tolerance: float) -> Motion:
    """Refuse a motion whose numbers are not all finite: no bound is one of them."""
    numbers = (motion.samples, motion.dense.coefficients, motion.dense.breaks)
    # A sum is finite only of finite numbers, and takes half the time.
    if not all(isfinite(part.sum()) or np.isfinite(part).all() for part in numbers):
        raise AccuracyNotMetError(float("nan"), tolerance)
    if not (isfinite(motion.dense.error) and is_within(motion.error, float("inf"))):
        raise AccuracyNotMetError(float("nan"), tolerance)
    return motion


def _cross_check(problem: Problem, motion: Motion) -> CrossCheck:
    # Beyond a pole that is passed by convention an integrator may follow another branch.
    return compare(
        motion, problem.body, problem.potential, tolerance=problem.tolerance, limit=motion.first_passage
    )


def _columns(problem: Problem, motion: Motion, dense: DenseOutput) -> dict[str, FloatArray]:
    """Return t, rounded to doubles, and the columns that were asked for, at the exact times."""
    if not problem.wants_series:
        return {}
    series = {name: motion.samples[:, COLUMNS.index(name)] for name in columns_of(problem.outputs)}
    return {"t": motion.times, **series, **orientation_columns(dense, motion.times, motion.rests)}
