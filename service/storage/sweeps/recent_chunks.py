"""Reads the latest attempts at chunks, for the estimate of how long a sweep still takes."""

from collections.abc import Collection, Mapping

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.jobs.chunking import RECENT_SECONDS, ChunkRun
from service.jobs.records import JobState
from service.storage.tables.jobs import AttemptRow, JobRow
from service.storage.tables.sweeps import SweepChunkRow

_LATEST = 1000
"""Only so many of the latest attempts are read, so that the cost does not grow with their number."""


def complete_since(session: Session, now: float) -> float:
    """Return the instant from which on :func:`chunk_runs` sees every ended attempt."""
    nth = select(AttemptRow.ended_at).where(AttemptRow.ended_at > now - RECENT_SECONDS)
    oldest = session.scalar(nth.order_by(AttemptRow.ended_at.desc()).offset(_LATEST - 1).limit(1))
    return now - RECENT_SECONDS if oldest is None else oldest


def chunk_runs(session: Session, sweep_ids: Collection[str], since: float) -> dict[str, list[ChunkRun]]:
    """Return by sweep the attempts at its chunks that ended after ``since`` or still run.

    The first chunk of each sweep is left out: it includes the start-up of workers.
    """
    latest = (
        select(AttemptRow.job_id, AttemptRow.started_at, AttemptRow.ended_at)
        .where(AttemptRow.ended_at > since)
        .order_by(AttemptRow.ended_at.desc())
        .limit(_LATEST)
        .subquery()
    )
    ended = (
        select(JobRow.sweep_id, JobRow.problem, latest.c.started_at, latest.c.ended_at)
        .join(latest, latest.c.job_id == JobRow.id)
        .where(JobRow.sweep_id.in_(sweep_ids))
    )
    at_work = select(JobRow.sweep_id, JobRow.problem, JobRow.started_at).where(
        JobRow.state == JobState.RUNNING.value, JobRow.sweep_id.in_(sweep_ids)
    )
    rows = [(str(each[0]), _first(each[1]), each[2], each[3]) for each in session.execute(ended)]
    brought = _points(session, {(sweep_id, first) for sweep_id, first, _, _ in rows})
    runs: dict[str, list[ChunkRun]] = {sweep_id: [] for sweep_id in sweep_ids}
    for sweep_id, first, started_at, ended_at in rows:
        if first:
            runs[sweep_id].append(ChunkRun(started_at, ended_at, brought.get((sweep_id, first), 0)))
    for each in session.execute(at_work):
        if _first(each[1]) and each[2] is not None:
            runs[str(each[0])].append(ChunkRun(each[2], None, 0))
    return runs


def _points(session: Session, places: Collection[tuple[str, int]]) -> dict[tuple[str, int], int]:
    """Return the number of points of the chunks that begin at ``places``, by sweep and first point."""
    if not places:
        return {}
    statement = select(SweepChunkRow.sweep_id, SweepChunkRow.first, SweepChunkRow.count).where(
        SweepChunkRow.sweep_id.in_({sweep_id for sweep_id, _ in places}),
        SweepChunkRow.first.in_({first for _, first in places}),
    )
    return {(sweep_id, first): count for sweep_id, first, count in session.execute(statement)}


def _first(problem: Mapping[str, object]) -> int:
    first = problem["first"]
    assert isinstance(first, int)
    return first
