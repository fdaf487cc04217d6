"""Updates a sweep when one of its chunks ends, within the caller's transaction.

A transaction that changes a sweep's counters or makes chunks always locks the sweep's
row first and its jobs afterwards: two transactions that lock them in different orders
would deadlock.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from sqlalchemy import Connection, bindparam, delete, func, literal_column, select, update
from sqlalchemy.orm import Session, defer

from service.jobs.kernels import Kernels, Way, way_of_sweep
from service.jobs.queue import PARTS, UNKNOWN_POINT_SECONDS, Lane, Range, cut, cut_rest, further, pilot
from service.jobs.records import AttemptOutcome, ChunkOutcome, Claim, JobKind, JobState, sources
from service.schemas.reading.documents import Part
from service.storage.database.rows import database_now, new_id
from service.storage.jobs.queue import next_turns
from service.storage.jobs.rows import end_attempt, fence, may_become, move
from service.storage.keys import charge
from service.storage.tables.base import DatabaseNow, table_of
from service.storage.tables.jobs import JobRow
from service.storage.tables.operations import WorkerRow
from service.storage.tables.solutions import SweepChunkRow, SweepRow

_SWEEPS, _WORKERS = table_of(SweepRow), table_of(WorkerRow)
_BEGUN = select(_SWEEPS.c.document, _SWEEPS.c.way, _SWEEPS.c.points).where(_SWEEPS.c.id == bindparam("sweep"))
_SEEN_SECONDS = 60.0
"""Workers that said nothing for longer do not count when chunks are cut."""
_NO_DIGEST = ""
"""The digest of every chunk: chunks are not looked up by what they compute."""


def hold(session: Session, sweep_id: str | None) -> SweepRow | None:
    """Lock and return a sweep's row; None without an id."""
    if sweep_id is None:
        return None
    # Without the document, which may be long and is not needed here.
    row = select(SweepRow).where(SweepRow.id == sweep_id).options(defer(SweepRow.document))
    return session.scalar(row.with_for_update())


@dataclass(frozen=True, slots=True)
class Begun:
    """The document of a sweep, and the way in which its points are computed."""

    document: Part
    way: str


def begin(connection: Connection, sweep_id: str, worker: str) -> Begun:
    """Mark a sweep running, since ``worker`` has claimed one of its chunks; its first one chooses the way."""
    found = connection.execute(_BEGUN, {"sweep": sweep_id}).one()
    way = found.way or way_of_sweep(found.document, found.points, _kernels_of(connection, worker))
    # Skip a locked row: its holder may be waiting for the claimed chunk, and marks the sweep itself.
    idle = (
        select(_SWEEPS.c.id)
        .where(_SWEEPS.c.id == sweep_id, _SWEEPS.c.state == JobState.QUEUED.value)
        .with_for_update(skip_locked=True)
        .scalar_subquery()
    )
    values = {"state": JobState.RUNNING.value, "started_at": DatabaseNow(), "way": way}
    connection.execute(update(_SWEEPS).where(_SWEEPS.c.id == idle).values(values))
    return Begun(found.document, way)


def _kernels_of(connection: Connection, worker: str) -> Kernels | None:
    stored = connection.scalar(select(_WORKERS.c.kernels).where(_WORKERS.c.name == worker))
    return None if stored is None else Kernels.read(stored)


def queue_chunks(
    session: Session, sweep: SweepRow, ranges: Iterable[Range], most: int, *, alone: bool = False
) -> list[JobRow]:
    """Make a job of each range; ``most`` is the largest chunk that may be made of this sweep."""
    now, whole = database_now(session), list(ranges)
    point_seconds = UNKNOWN_POINT_SECONDS if sweep.point_seconds is None else sweep.point_seconds
    turns = next_turns(
        session.connection(),
        lane=Lane.SWEEP,
        priority=sweep.priority,
        key_id=sweep.key_id,
        seconds=[each.count * point_seconds for each in whole],
    )
    rows = [
        JobRow(
            id=new_id(),
            kind=JobKind.CHUNK.value,
            state=JobState.QUEUED.value,
            priority=sweep.priority,
            lane=Lane.SWEEP.value,
            turn=turn,
            key_id=sweep.key_id,
            sweep_id=sweep.id,
            problem=_problem(each, most),
            digest=_NO_DIGEST,
            alone=alone,
            created_at=now,
        )
        for each, turn in zip(whole, turns, strict=True)
    ]
    session.add_all(rows)
    return rows


def finish(session: Session, claim: Claim, outcome: ChunkOutcome) -> list[JobRow] | None:
    """Store the points of a chunk and make further chunks; do nothing and return None if the claim was lost.

    Returns the jobs that are queued now.
    """
    sweep = hold(session, claim.sweep_id)
    if sweep is None or not move(session, JobState.SUCCEEDED, *fence(claim), progress=1.0):
        return None
    end_attempt(session, claim.job_id, claim.attempt, AttemptOutcome.SUCCEEDED)
    sweep.way = sweep.way or claim.way
    asked, most = range_of(claim.problem), most_of(claim.problem)
    if not 1 <= outcome.count <= asked.count:
        raise ValueError(f"{outcome.count} points came back of a chunk of {asked.count}")
    sweep.point_seconds = outcome.seconds / outcome.count
    rest = Range(asked.first + outcome.count, asked.count - outcome.count)
    left = cut_rest(rest, sweep.point_seconds) if rest.count else ()
    return _store(session, sweep, asked.first, outcome, left, most)


def replace_failed(session: Session, sweep: SweepRow | None, job_id: str) -> list[JobRow]:
    """Split a chunk that has failed for good, or store its only point as refused.

    ``sweep`` is its locked row, None if the job is not a chunk. Returns the jobs that are queued now.
    """
    if sweep is None:
        return []
    job = session.get_one(JobRow, job_id, populate_existing=True)
    if job.state != JobState.FAILED.value:
        return []
    asked, most = range_of(job.problem), most_of(job.problem)
    if asked.count > 1:
        return queue_chunks(session, sweep, cut(asked, PARTS), most, alone=job.alone)
    # Here and not at the top: it loads NumPy, which a worker needs for nothing else.
    from service.storage.codecs.packing import ChunkPoints, chunk_outcome  # noqa: PLC0415

    code = str((job.error or {}).get("code", "internal_error"))
    refused = chunk_outcome(ChunkPoints(outcomes=[code], numbers={}), seconds=0.0)
    return _store(session, sweep, asked.first, refused, (), most)


def first_problem(sweep: SweepRow, claim: Claim) -> Part:
    """Return what the chunk of ``claim`` is to compute if its sweep begins again."""
    most = most_of(claim.problem)
    return _problem(pilot(sweep.points, most), most)


def begin_again(session: Session, sweep: SweepRow, claim: Claim, way: Way) -> None:
    """Forget all points of a locked sweep; the chunk of ``claim``, from its first point on, is its only one.

    The others are deleted: who computes one has lost it.
    """
    most = most_of(claim.problem)
    points = SweepChunkRow.sweep_id == sweep.id
    freed = session.scalar(select(func.sum(func.length(SweepChunkRow.data))).where(points)) or 0
    session.execute(delete(SweepChunkRow).where(points).execution_options(synchronize_session=False))
    others = JobRow.sweep_id == sweep.id, JobRow.id != claim.job_id
    session.execute(delete(JobRow).where(*others).execution_options(synchronize_session=False))
    sweep.way, sweep.done, sweep.refused, sweep.point_seconds = way, 0, 0, None
    sweep.next_index = sweep.chunk_points = pilot(sweep.points, most).count
    sweep.provenances = None
    session.flush()
    charge(session.connection(), sweep.key_id, -int(freed))


def cancel(session: Session, sweep: SweepRow) -> bool:
    """Cancel a locked, unfinished sweep and its chunks; tell whether it did."""
    if sweep.state not in sources(JobState.CANCELLED):
        return False
    _end(session, sweep, JobState.CANCELLED)
    cancelled = session.execute(
        update(JobRow)
        .where(JobRow.sweep_id == sweep.id, may_become(JobState.CANCELLED))
        .values(state=JobState.CANCELLED.value, owner=None, lease_until=None, finished_at=DatabaseNow())
        .returning(JobRow.id, JobRow.attempt)
        .execution_options(synchronize_session=False)
    ).all()
    for job_id, attempt in cancelled:
        end_attempt(session, job_id, attempt, AttemptOutcome.CANCELLED)
    return True


def _store(
    session: Session, sweep: SweepRow, first: int, outcome: ChunkOutcome, left: Iterable[Range], most: int
) -> list[JobRow]:
    session.add(
        SweepChunkRow(
            sweep_id=sweep.id,
            first=first,
            count=outcome.count,
            refused=outcome.refused,
            bounds={name: list(bounds) for name, bounds in outcome.bounds.items()},
            data=outcome.data,
            **_noted_source(sweep, outcome.source),
        )
    )
    sweep.done += outcome.count
    sweep.refused += outcome.refused
    rows = queue_chunks(session, sweep, left, most)
    session.flush()
    rows += _top_up(session, sweep, most)
    if sweep.done == sweep.points:
        _end(session, sweep, JobState.SUCCEEDED)
    elif sweep.state == JobState.QUEUED.value:
        sweep.state, sweep.started_at = JobState.RUNNING.value, database_now(session)
    session.flush()
    charge(session.connection(), sweep.key_id, len(outcome.data))
    return rows


def _noted_source(sweep: SweepRow, source: Mapping[str, object] | None) -> dict[str, object]:
    """Return what a chunk stores of its source, after the sweep has noted what is new of it."""
    if source is None:
        return {}
    provenance = {name: value for name, value in source.items() if name != "host"}
    host = str(source.get("host"))
    known: list[Part] = list(sweep.provenances or ())
    found = (k for k, each in enumerate(known) if {**each, "hosts": None} == {**provenance, "hosts": None})
    place = next(found, len(known))
    if place == len(known):
        known.append({**provenance, "hosts": []})
    if host not in (hosts := known[place]["hosts"]):
        known[place] = {**known[place], "hosts": [*hosts, host]}
        sweep.provenances = list(map(dict, known))
    return {"host": host, "provenance": place}


def _top_up(session: Session, sweep: SweepRow, most: int) -> list[JobRow]:
    """Make chunks of the next points until enough chunks are queued."""
    if sweep.next_index >= sweep.points:
        return []
    waiting = session.scalar(
        select(func.count())
        .select_from(JobRow)
        # A literal, not a parameter, so that SQLite can use the partial index of queued jobs.
        .where(JobRow.sweep_id == sweep.id, JobRow.state == literal_column("'queued'"))
    )
    seconds = UNKNOWN_POINT_SECONDS if sweep.point_seconds is None else sweep.point_seconds
    lately = _WORKERS.c.seen_at >= DatabaseNow() - _SEEN_SECONDS
    places = session.scalar(select(func.sum(_WORKERS.c.slots)).where(lately)) or 1
    ranges = list(further(sweep.next_index, sweep.points, waiting or 0, seconds, most, places))
    if ranges:
        sweep.chunk_points = ranges[-1].count
        sweep.next_index = ranges[-1].first + ranges[-1].count
    return queue_chunks(session, sweep, ranges, most)


def _end(session: Session, sweep: SweepRow, state: JobState) -> None:
    sweep.state, sweep.finished_at = state.value, database_now(session)
    session.flush()


def _problem(chunk: Range, most: int) -> Part:
    return {"first": chunk.first, "count": chunk.count, "most": most}


def range_of(problem: Part) -> Range:
    """Return the points that a chunk's job computes."""
    return Range(int(str(problem["first"])), int(str(problem["count"])))


def most_of(problem: Part) -> int:
    """Return how large a chunk of the sweep of a chunk's job may be."""
    return int(str(problem["most"]))
