"""Repairs sweeps with wrong counters or missing chunks: recounts them and queues what is missing."""

from collections.abc import Iterator, Sequence

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from service.jobs.chunking import PILOT_POINTS, Range, cut
from service.jobs.records import FINISHED, AttemptOutcome, JobKind, JobState
from service.storage.database.clock import DatabaseNow
from service.storage.database.database import Database
from service.storage.inspection.repairs import Broken
from service.storage.jobs.chunks import hold, queue_chunks
from service.storage.jobs.moves import end_attempt, move
from service.storage.tables.jobs import JobRow
from service.storage.tables.sweeps import SweepChunkRow, SweepRow

_LIVE = [state.value for state in JobState if state not in FINISHED]


def repair_sweeps(database: Database, broken: Broken) -> int:
    """Repair sweeps one by one; stored points are kept."""
    with database.read() as session:
        found = session.scalars(broken).all()
    for sweep_id in found:
        with database.write() as session:
            sweep = hold(session, sweep_id)
            if sweep is not None:
                _mend(session, sweep)
    return len(found)


def cancel_chunks(database: Database, broken: Broken) -> int:
    """Cancel chunks whose sweep is finished."""
    with database.write() as session:
        jobs = session.execute(select(JobRow.id, JobRow.attempt).where(JobRow.id.in_(broken))).all()
        for job_id, attempt in jobs:
            move(session, JobState.CANCELLED, JobRow.id == job_id)
            end_attempt(session, job_id, attempt, AttemptOutcome.CANCELLED)
    return len(jobs)


def _mend(session: Session, sweep: SweepRow) -> None:
    sums = select(func.sum(SweepChunkRow.count), func.sum(SweepChunkRow.refused))
    done, refused = session.execute(sums.where(SweepChunkRow.sweep_id == sweep.id)).one()
    sweep.done, sweep.refused = int(done or 0), int(refused or 0)
    if sweep.state == JobState.CANCELLED.value:
        return
    covered = _covered(session, sweep.id)
    end = max((piece.first + piece.count for piece in covered), default=0)
    sweep.next_index = max(sweep.next_index, end)
    missing = list(_missing(covered, sweep.next_index))
    if not missing and sweep.done == sum(piece.count for piece in covered) < sweep.points:
        # No running chunk is left that would make further ones.
        missing = [Range(sweep.next_index, min(PILOT_POINTS, sweep.points - sweep.next_index))]
        sweep.next_index += missing[0].count
    if sweep.done < sweep.points:
        sweep.state, sweep.finished_at = _unfinished(sweep), None
    elif sweep.state != JobState.SUCCEEDED.value:
        sweep.state = JobState.SUCCEEDED.value
        sweep.finished_at = session.scalars(select(DatabaseNow())).one()
    most = _most(session, sweep)
    parts = [part for whole in missing for part in cut(whole, -(-whole.count // most))]
    queue_chunks(session, sweep, parts, most)


def _unfinished(sweep: SweepRow) -> str:
    begun = sweep.done > 0 or sweep.state != JobState.QUEUED.value
    return (JobState.RUNNING if begun else JobState.QUEUED).value


def _covered(session: Session, sweep_id: str) -> list[Range]:
    """Return the points that are stored or to be computed, in order."""
    stored = select(SweepChunkRow.first, SweepChunkRow.count).where(SweepChunkRow.sweep_id == sweep_id)
    to_do = select(JobRow.problem).where(
        JobRow.sweep_id == sweep_id, JobRow.kind == JobKind.CHUNK.value, JobRow.state.in_(_LIVE)
    )
    pieces = [Range(first, count) for first, count in session.execute(stored)]
    pieces += [Range(_number(each["first"]), _number(each["count"])) for each in session.scalars(to_do)]
    return sorted(pieces, key=lambda piece: piece.first)


def _missing(covered: Sequence[Range], end: int) -> Iterator[Range]:
    reached = 0
    for piece in covered:
        if piece.first > reached:
            yield Range(reached, piece.first - reached)
        reached = max(reached, piece.first + piece.count)
    if end > reached:
        yield Range(reached, end - reached)


def _most(session: Session, sweep: SweepRow) -> int:
    """Return the largest chunk size that the sweep's jobs record, else the size of the last chunk made."""
    problem = session.scalar(select(JobRow.problem).where(JobRow.sweep_id == sweep.id).limit(1))
    return _number(problem["most"]) if problem is not None else max(sweep.chunk_points, 1)


def _number(value: object) -> int:
    assert isinstance(value, int)
    return value
