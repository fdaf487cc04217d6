"""Computes one problem: from its document to a solution with its evidence.

Motions of the certified tier, and those that fall back on it, are sampled from proven enclosures.
"""

import json
import logging
import time
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from service.dynamics.accuracy import TIER_TOLERANCES
from service.dynamics.equations.orientation import orientation_columns
from service.dynamics.errors import BudgetTooSmallError, DynamicsError
from service.dynamics.motion import COLUMNS, CrossCheck, Motion, columns_of
from service.dynamics.numerics import is_within
from service.dynamics.problem import Accuracy, PlanarMotion, Problem, StateMotion
from service.dynamics.reduction.windows import hand_on_windows
from service.dynamics.solution.dense_output import DenseOutput, parts_for, split
from service.dynamics.verdict.simple_form import simplified
from service.jobs.kernels import NeedsKernelsError, way_of_solution
from service.jobs.records import Refused, Solved, SolveOutcome, StoredSolution
from service.local.workers import why_no_folder
from service.schemas.problem.problem import choose_tier, place_sent, read_problem, window_of, with_tier
from service.schemas.problem.trusted import trusted_problem
from service.schemas.reading.documents import Document, Part
from service.schemas.replies.summary import SolutionSummary
from service.settings import Settings
from service.storage.codecs.packing import encode_arrays, encode_dense
from service.storage.solutions.shipped_accuracy import shipped_table
from service.verdicts.cached import ResultCache, read_windows
from service.verdicts.examination import Examined, examine_document
from workers import solvers
from workers.computation.compiled_code import GROUPS, Group, fixed_way, is_ready, keep_compiled_code, way_for
from workers.computation.enclosures import (
    columns_of_enclosures,
    enclosed_motion,
    errors_of_enclosed,
    with_attitude,
    with_period_known,
    with_samples,
    with_tolerance_kept,
)
from workers.computation.outputs import InUnits, compute_outputs, errors_of, in_units, require_promise
from workers.computation.summary import has_proven_attitude, summarise
from workers.solvers.certified.certify import Certified
from workers.solvers.certified.validated.enclose import Watch
from workers.solvers.certified.validated.motion import prove_motion
from workers.solvers.choose import choose_enclosures, find_motion, proven_start
from workers.solvers.cross_check import compare
from workers.solvers.errors import (
    AccuracyNotMetError,
    CertifiedUnavailableError,
    require_error_within,
    require_period_known,
)
from workers.solvers.units import Units
from workers.solvers.ways import NotReadyError, Way, on_way

logger = logging.getLogger(__name__)
FloatArray = NDArray[np.float64]


def solve_document(
    document_json: str,
    windows_json: str = "",
    way: Way | None = None,
    *,
    waits: bool = False,
    read: Callable[[Part], Problem] = trusted_problem,
) -> SolveOutcome:
    """Solve the problem in ``document_json``; what cannot be solved is told in the outcome, not raised.

    ``windows_json`` has the windows of its curve, if they were cached: they are not found again. Without a
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
    if way_of_solution(stored.summary) == "plain":
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


def _solve_read(document: Part, problem: Problem, began: float, way: Way | None, waits: bool) -> SolveOutcome:
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


def _solve_on_way(document: Part, problem: Problem, began: float, *, waits: bool) -> SolveOutcome:
    """Solve it on the present way; one that ``waits`` for kernels takes no refusal of a solver for final.

    What is wrong with the problem itself is final on any way.
    """
    # Its speed is asked of kernels before it is solved.
    keep_compiled_code()
    try:
        deadline = _Deadline()
        summary, dense, columns = in_units(
            problem, lambda units: _solve_in(document, problem, units, deadline)
        )
    except DynamicsError as fault:
        if waits and type(fault).__module__.startswith(solvers.__name__):
            raise NeedsKernelsError(_refused(document, fault).error) from fault
        return _refused(document, fault)
    summary["cost"] = {"compute_seconds": time.perf_counter() - began}
    return Solved(summary, encode_dense(dense), encode_arrays(columns))


def _solve_in(
    document: Part, problem: Problem, units: Units, deadline: "_Deadline"
) -> tuple[SolutionSummary, DenseOutput, dict[str, FloatArray]]:
    """Return the summary of the solution, its function of time and its columns, solved in ``units``."""
    posed, enclosures = units.pose(problem), dict[str, FloatArray]()
    proven, certified = None, None
    if problem.accuracy.tier == "certified":
        slow = Fraction(units.slow)
        solved, proven, enclosures = certified_samples(posed, watch=lambda t: deadline.reach(t * slow))
        certified, enclosures = units.certified(proven), units.enclosures(enclosures)
    else:
        solved = solve(posed)
    motion = _require_finite(units.motion(solved), problem.tolerance)
    outputs = compute_outputs(problem, motion, InUnits(units, posed, solved, proven))
    # The orientation is more columns on the same pieces.
    attitude = None if outputs.orientation is None else outputs.orientation.dense
    errors = errors_of(motion, attitude)
    if has_proven_attitude(certified):
        errors |= errors_of_enclosed(enclosures, errors)
    require_promise(problem.accuracy, errors)
    summary = summarise(document, problem, motion, outputs, certified, errors)
    dense = motion.dense if attitude is None else attitude
    columns = _columns(problem, motion, dense)
    columns |= {name: part for name, part in enclosures.items() if name.partition(".")[0] in columns}
    return summary, dense, columns


def _refused(document: object, fault: DynamicsError) -> Refused:
    pointer = place_sent(document, fault.pointer)
    error: Document = {"code": fault.code, "detail": fault.message, "pointer": pointer}
    if isinstance(fault, AccuracyNotMetError) and fault.accepted:
        error["accepted"] = dict(fault.accepted)
    return Refused(error)


def solve_checked(
    document_json: str,
    *,
    explains: bool = True,
    cache: ResultCache | None = None,
    way: Way | None = None,
    waits: bool = False,
) -> SolveOutcome:
    """Examine and solve a problem whose potential and motion have not been examined yet.

    Where there is no motion, an error that ``explains`` says for which λ there are. In ``cache`` are verdicts
    that were found before. The way is that of :func:`solve_document`.
    """
    document = json.loads(document_json)
    examined = examine_document(document, explains=explains, cache=cache, read=read_problem)
    return _solve_examined(document, examined, way, waits=waits)


def solve_judged(document_json: str, report_json: str) -> SolveOutcome:
    """Solve a problem of which ``report_json`` is what :func:`.examine_problem` answers."""
    document, report = json.loads(document_json), json.loads(report_json)
    problem = None if "error" in report else trusted_problem(document)
    return _solve_examined(document, Examined(report, problem), None)


def _solve_examined(
    document: Part, examined: Examined, way: Way | None, *, waits: bool = False
) -> SolveOutcome:
    began = time.perf_counter()
    problem, report = examined.problem, examined.answer
    if problem is None or "error" in report:
        return Refused(report["error"])
    if problem.accuracy.budget_seconds is not None:
        # Without a database there is only the table that comes with the program.
        try:
            choice = choose_tier(problem, window_of(report["verdict"]), shipped_table())
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
        # Enclosures have a period too; a cross-check has this one only.
        if enclosing == "never" or problem.method == "both":
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
    return {"t": motion.times, **series, **orientation_columns(dense, motion.times, motion.low_parts)}


CROSS_CHECK_TOLERANCE = 1e-9
"""Tolerance of the function of time that is stored beside the enclosures, where a cross-check wants it."""


def beside_enclosures(problem: Problem) -> Accuracy:
    """Return the accuracy of the function of time between the enclosures.

    Its error is reported separately and never blocks the enclosures; only a cross-check
    needs it to be small.
    """
    return Accuracy(CROSS_CHECK_TOLERANCE if problem.method == "both" else float("inf"), "certified")


TIME_SHARE = 0.9
"""Part of the seconds of a job that proven steps may take: the rest is for the answer."""


class _Deadline:
    """The end of the time of a job, which is told with the time until which its motion is proven."""

    def __init__(self) -> None:
        self._began = time.monotonic()
        self._limit: float | None = None
        self._missed: CertifiedUnavailableError | None = None

    def reach(self, t: Fraction) -> None:
        """Say that so much is proven; raises CertifiedUnavailableError when the time is over, and again."""
        if self._limit is None:
            self._limit = Settings().job_seconds
        if self._missed is None and time.monotonic() - self._began > TIME_SHARE * self._limit:
            message = (
                f"POLHODE_JOB_SECONDS = {self._limit:g} are over; it is proven until t = {float(t):.10g}"
            )
            self._missed = CertifiedUnavailableError(message, pointer="/time")
        if self._missed is not None:
            raise self._missed


def certified_samples(
    problem: Problem, *, watch: Watch | None = None
) -> tuple[Motion, Certified, dict[str, FloatArray]]:
    """Return the motion with proven samples, the enclosures, and the columns that hold them.

    The columns hold the times too: the values belong to the exact times, of which the motion has doubles.

    Raises
    ------
    CertifiedUnavailableError
        There is no enclosure of this kind of motion.
    """
    if not isinstance(problem.motion, PlanarMotion) or problem.method == "integration":
        motion, enclosed = prove_motion(problem, *proven_start(problem), watch=watch)
    else:
        motion = solve(problem)
        if motion.aperiodic is None:
            enclosed = with_attitude(problem, motion, enclosed_motion(problem, motion))
            motion = with_period_known(motion, enclosed, TIER_TOLERANCES["standard"])
        else:
            # What the reduction tells of it stays.
            stepped, enclosed = prove_motion(problem, *proven_start(problem), watch=watch)
            motion = replace(
                stepped,
                window=motion.window,
                aperiodic=motion.aperiodic,
                past=motion.past,
                future=motion.future,
                cross_check=motion.cross_check,
            )
    parts = parts_for(problem.accuracy.bits)
    rows = [[split(ball, parts) for ball in state] for state in enclosed.states]
    first = np.array([[doubles[0] for doubles, _ in row[: len(COLUMNS)]] for row in rows])
    proven = replace(with_samples(problem, motion, enclosed, first), conventions=enclosed.conventions)
    return proven, enclosed, columns_of_enclosures(enclosed, motion, rows, parts)
