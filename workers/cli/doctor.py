"""``python -m workers doctor``: checks the database, repairs it if asked, and solves samples again."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from random import Random

from sqlalchemy.exc import SQLAlchemyError

from service.escaping import one_line
from service.sandbox import Sandbox
from service.settings import Settings, read_settings
from service.storage.database.database import Database
from service.storage.inspection.blob_inspection import check_blobs, repair_examinations
from service.storage.inspection.inspect import Finding, check_schema, inspect, repair
from service.terminal import answer, say
from workers.computation.comparison import Sameness
from workers.computation.outdated import check_windows
from workers.computation.reproduction import Repetition, repeat_solutions

PACKETS = 100
"""Packets of each kind that are read without --all."""


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
    sandbox = Sandbox(1, memory_mb=settings.job_memory_mb, preload=["workers.computation.compute"])
    try:
        seconds = settings.job_seconds
        return list(repeat_solutions(database, sandbox, count=count, seconds=seconds, random=random))
    finally:
        sandbox.close()


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
