"""Inserts new jobs, within the caller's transaction."""

from collections.abc import Mapping, Sequence
from itertools import zip_longest

from sqlalchemy import insert
from sqlalchemy.orm import Session

from service.jobs.queue import Lane
from service.jobs.records import JobKind, JobState
from service.schemas.query.facts import facts_of
from service.schemas.reading.marks import Marks
from service.storage.database.clock import database_now
from service.storage.database.ids import new_id
from service.storage.jobs.finishing import solved
from service.storage.jobs.turns import next_turns
from service.storage.marks.mark_rows import insert_labels
from service.storage.tables.audits import AuditRow
from service.storage.tables.base import table_of
from service.storage.tables.jobs import JobRow
from service.verdicts.cache_rows import Examination

_INSERT, _INSERT_AUDITS = insert(table_of(JobRow)), insert(table_of(AuditRow))


def insert_jobs(
    session: Session,
    problems: Sequence[tuple[Mapping[str, object], str]],
    *,
    lane: Lane,
    priority: int,
    key_id: str | None,
    examinations: Sequence[Examination | None] = (),
    marks: Sequence[Marks] = (),
    audited: str | None = None,
    kind: JobKind = JobKind.SOLVE,
) -> list[JobRow]:
    """Insert a job for each problem and its digest; it has succeeded already if an equal one was solved.

    If they are audits of the solution ``audited``, which this transaction has locked, or of another ``kind``,
    nothing is reused.
    The returned rows are detached from the session.
    """
    now = database_now(session)
    connection = session.connection()
    solutions: dict[str, str] = {}
    if audited is None and kind is JobKind.SOLVE:
        solutions = solved(connection, sorted({digest for _, digest in problems}), hold=True)
    waiting = [digest for _, digest in problems if digest not in solutions]
    given = next_turns(connection, lane=lane, priority=priority, key_id=key_id, seconds=[None] * len(waiting))
    turns = iter(given)
    values: list[dict[str, object]] = []
    for (problem, digest), examination, mark in zip_longest(problems, examinations, marks):
        solution_id = solutions.get(digest)
        reused = solution_id is not None
        values.append(
            {
                "id": new_id(),
                "kind": kind.value,
                "state": (JobState.SUCCEEDED if reused else JobState.QUEUED).value,
                "priority": priority,
                "lane": int(lane),
                "turn": 0.0 if reused else next(turns),
                "ready_at": 0.0,
                "attempt": 0,
                "progress": 1.0 if reused else 0.0,
                "reused": reused,
                "solution_id": solution_id,
                "key_id": key_id,
                "problem": problem,
                "examination": None if examination is None else examination.windows,
                "examined_seconds": None if examination is None else examination.seconds,
                "facts": facts_of(problem),
                "digest": digest,
                "created_at": now,
                "finished_at": now if reused else None,
                "note": None if mark is None else mark.note,
            }
        )
    if values:
        session.execute(_INSERT, values)
    if audited is not None:
        audits = [{"job_id": each["id"], "solution_id": audited} for each in values]
        session.execute(_INSERT_AUDITS, audits)
    made = zip(values, marks, strict=False)
    insert_labels(session, JobRow, [(str(each["id"]), now, mark) for each, mark in made])
    return [JobRow(**each) for each in values]
