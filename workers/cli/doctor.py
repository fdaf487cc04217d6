"""``python -m workers doctor``: checks the database, repairs it if asked, and solves samples again.

One check is of stored solutions of earlier versions in windows next to a place where p² is infinite: versions
before COLLISIONS took some such places for zeros of p², or passed them, so that what they said of a window
that ends there is not to be believed. Whether a solution is in such a window is found anew.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from random import Random

from sqlalchemy import func, select
from sqlalchemy.exc import SQLAlchemyError

from service.dynamics.errors import DynamicsError
from service.dynamics.formula.vanishing import vanishing_parts
from service.dynamics.problem import PlanarMotion, Problem
from service.dynamics.reduction.geometry.tight_form import tight_form
from service.dynamics.reduction.windows import choose_window, find_windows
from service.jobs.records import Refused, StoredSolution
from service.logs import one_line
from service.sandbox import Sandbox, SandboxError
from service.schemas.problem.problem import read_problem
from service.schemas.reading.documents import InvalidProblemError
from service.settings import Settings, read_settings
from service.storage.database.database import Database
from service.storage.inspection.blob_inspection import check_blobs, repair_examinations
from service.storage.inspection.inspect import EXAMPLES, Finding, check_schema, inspect, repair
from service.storage.jobs.claiming import stored_solutions
from service.storage.tables.solutions import SolutionRow
from service.terminal import answer, say
from workers.computation.audit import Sameness, audit_document

PACKETS = 100
"""Packets of each kind that are read without --all."""


@dataclass(frozen=True, slots=True)
class Repetition:
    """The result of solving one solution again."""

    solution: str
    sameness: Sameness
    detail: str

    @property
    def is_clean(self) -> bool:
        """The stored numbers are confirmed."""
        return self.sameness in (Sameness.IDENTICAL, Sameness.WITHIN_ERRORS)


@dataclass(frozen=True, slots=True)
class Report:
    """The result of all checks."""

    findings: Sequence[Finding]
    mended: Sequence[Finding]
    repetitions: Sequence[Repetition]

    @property
    def is_clean(self) -> bool:
        """Nothing is wrong, or everything was repaired."""
        holds = all(finding.is_clean for finding in self.findings)
        return holds and all(repetition.is_clean for repetition in self.repetitions)


def examine(*, fix: bool, sample: int, every: bool, seed: int | None, as_json: bool) -> int:
    """Print the report; return 0 if nothing is wrong, 1 if something is or the check failed."""
    settings = read_settings()
    database = Database(settings.database_url)
    try:
        random = Random(seed)
        report = _examine(database, settings, fix=fix, sample=sample, every=every, random=random)
    except SQLAlchemyError as fault:
        reason = str(getattr(fault, "orig", None) or fault).splitlines()[0]
        say(f"the database cannot be checked: {reason}")
        return 1
    finally:
        database.close()
    lines = [json.dumps(_document(report))] if as_json else _describe(report)
    answer("".join(f"{one_line(line)}\n" for line in lines))
    return 0 if report.is_clean else 1


def _examine(
    database: Database, settings: Settings, *, fix: bool, sample: int, every: bool, random: Random
) -> Report:
    if not (schema := check_schema(database)).is_clean:
        return Report([schema], [], [])
    mended = list(_mend(database)) if fix else []
    findings = list(inspect(database))
    findings += check_blobs(database, sample=None if every else PACKETS, random=random)
    findings.append(check_windows(database))
    return Report(findings, mended, _repeat(database, settings, sample, random))


def _mend(database: Database) -> Iterator[Finding]:
    yield from repair(database)
    damaged = repair_examinations(database)
    if damaged is not None:
        yield damaged


def _repeat(database: Database, settings: Settings, count: int, random: Random) -> list[Repetition]:
    if count == 0:
        return []
    sandbox = Sandbox(1, memory_mb=settings.job_memory_mb, preload=[audit_document.__module__])
    try:
        seconds = settings.job_seconds
        return list(repeat_solutions(database, sandbox, count=count, seconds=seconds, random=random))
    finally:
        sandbox.close()


def repeat_solutions(
    database: Database, sandbox: Sandbox, *, count: int, seconds: float, random: Random
) -> Iterator[Repetition]:
    """Solve ``count`` of the stored problems, chosen by ``random``, in ``seconds`` each at most; compare."""
    with database.read() as session:
        total = session.scalar(select(func.count()).select_from(SolutionRow)) or 0
    for position in random.sample(range(total), min(count, total)):
        one = select(SolutionRow.id).order_by(SolutionRow.id).offset(position).limit(1)
        with database.read() as session:
            stored = stored_solutions(session.connection(), session.scalars(one).all())
        for solution_id, solution in stored.items():
            yield _audited(solution_id, solution, sandbox, seconds)


def _audited(solution_id: str, stored: StoredSolution, sandbox: Sandbox, seconds: float) -> Repetition:
    """Return what an audit of a solution finds."""
    try:
        outcome = sandbox.run(audit_document, json.dumps(stored.problem), "", stored, seconds=seconds)
    except SandboxError as fault:
        return Repetition(solution_id, Sameness.FAILED, f"it cannot be solved again: {fault}")
    if isinstance(outcome, Refused):
        detail = "it cannot be solved again: {code}: {detail}".format(**outcome.error)
        return Repetition(solution_id, Sameness.FAILED, detail)
    comparison = outcome.comparison
    assert comparison is not None
    if comparison["identical"]:
        sameness = Sameness.IDENTICAL
    else:
        sameness = Sameness.WITHIN_ERRORS if comparison["verdict"] == "agrees" else Sameness.DIFFERENT
    return Repetition(solution_id, sameness, str(comparison["detail"]))


def _document(report: Report) -> dict[str, object]:
    return {
        "clean": report.is_clean,
        "findings": [_plain(finding) for finding in report.findings],
        "mended": [_plain(finding) for finding in report.mended],
        "solved_again": [asdict(repetition) for repetition in report.repetitions],
    }


def _plain(finding: Finding) -> dict[str, object]:
    return {**asdict(finding), "examples": list(finding.examples)}


def _describe(report: Report) -> Iterator[str]:
    for finding in report.mended:
        yield f"repaired {_broken(finding)}: {finding.remedy}"
    broken = [finding for finding in report.findings if finding.broken]
    for finding in broken:
        yield f"{'warning' if finding.is_warning else 'BROKEN':<9}{_broken(finding)}"
        yield from (f"         {example}" for example in finding.examples)
        if finding.remedy is not None:
            yield f"         polhode doctor --fix repairs it: {finding.remedy}"
    yield f"{len(report.findings) - len(broken)} of {len(report.findings)} laws hold"
    yield from _describe_repetitions(report.repetitions)
    yield "clean" if report.is_clean else "not clean"


def _broken(finding: Finding) -> str:
    return f"{finding.code}: {finding.says}; broken {finding.broken} times"


def _describe_repetitions(repetitions: Iterable[Repetition]) -> Iterator[str]:
    same = 0
    for repetition in repetitions:
        same += repetition.sameness is Sameness.IDENTICAL
        if repetition.sameness is not Sameness.IDENTICAL:
            word = "note" if repetition.is_clean else "BROKEN"
            yield f"{word:<9}solution {repetition.solution}: {repetition.detail}"
    yield f"{same} solutions were solved again with the same bits"


COLLISIONS = 10
"""The first numerics version that proves where p² is infinite."""
_PAGE = 500


def check_windows(database: Database) -> Finding:
    """Return the finding about solutions of earlier versions in windows that end where p² is infinite."""
    broken, examples = 0, list[str]()
    for solution, problem, motion in _earlier(database):
        doubt = _doubt_of(problem, motion)
        if doubt is not None:
            broken += 1
            if len(examples) < EXAMPLES:
                examples.append(f"{solution}: {doubt}")
    says = f"no solution of numerics before {COLLISIONS} is in a window next to a place where p² is infinite"
    return Finding("windows_at_infinities", says, broken, tuple(examples), is_warning=True)


def _earlier(database: Database) -> Iterator[tuple[str, Problem, PlanarMotion]]:
    """Yield the planar motions that earlier versions solved, with the ids of their solutions."""
    columns = SolutionRow.id, SolutionRow.problem, SolutionRow.summary
    last = ""
    while True:
        page = select(*columns).order_by(SolutionRow.id).limit(_PAGE)
        with database.read() as session:
            rows = session.execute(page.where(SolutionRow.id > last) if last else page).all()
        if not rows:
            return
        last = rows[-1][0]
        for solution, document, summary in rows:
            provenance = summary.get("provenance")
            if isinstance(provenance, Mapping) and provenance.get("numerics", 0) >= COLLISIONS:
                continue
            try:
                problem = read_problem(document)
            except InvalidProblemError:
                # A problem of another version of documents is another check's.
                continue
            if isinstance(problem.motion, PlanarMotion):
                yield solution, problem, problem.motion


def _doubt_of(problem: Problem, motion: PlanarMotion) -> str | None:
    """Return what is the matter with the window of a motion, None if nothing is."""
    potential = problem.potential
    part = potential if potential.has_formula else potential.formula_part(motion.sign_of_g1, motion.g3_sign)
    if part is None or not vanishing_parts(tight_form(part.tape)):
        return None
    try:
        window = choose_window(find_windows(problem.body, potential, motion), motion)
    except DynamicsError as refusal:
        return refusal.code
    ends = {
        end
        for arc in window.arcs
        for v, end in ((arc.lower, arc.lower_end), (arc.upper, arc.upper_end))
        if not v.sin().contains(0)
    }
    return f"window {window.index} ends in a collision" if "collision" in ends else None
