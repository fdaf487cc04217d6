"""Checks a whole database: every invariant, and the database's own integrity check.

The invariants of sweeps hold even after a kill: every point is in exactly one chunk. They are repaired here.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from sqlalchemy import CTE, BigInteger, and_, cast, exists, func, not_, or_, select, text, union_all
from sqlalchemy.orm import Session

from service.jobs.queue import PILOT_POINTS, Range, cut
from service.jobs.records import FINISHED, AttemptOutcome, JobKind, JobState
from service.storage.database.database import Database
from service.storage.database.migration import fault_of, newest_revision, stored_revision
from service.storage.inspection.invariants import (
    Broken,
    Invariant,
    Remedy,
    differ,
    invariants_of_jobs,
    invariants_of_keys,
)
from service.storage.jobs.chunks import hold, most_of, queue_chunks, range_of
from service.storage.jobs.rows import end_attempt, move
from service.storage.tables.base import DatabaseNow
from service.storage.tables.jobs import JobRow
from service.storage.tables.solutions import SweepChunkRow, SweepRow

EXAMPLES = 5
"""Largest number of ids of violating rows that are listed for each invariant."""


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of checking one invariant."""

    code: str
    says: str
    broken: int = 0
    """Number of rows that violate it."""
    examples: tuple[str, ...] = ()
    """The ids of some of them."""
    is_warning: bool = False
    remedy: str | None = None
    """The effect of the repair, in words; None if only a person can repair it."""
    mended: int = 0

    @property
    def is_clean(self) -> bool:
        """Nothing is wrong, though work may have stalled."""
        return self.is_warning or self.broken == 0


def inspect(database: Database) -> Iterator[Finding]:
    """Yield the finding about the schema and, if it is that of this version, one for every invariant."""
    schema = check_schema(database)
    yield schema
    if not schema.is_clean:
        return
    yield from _check_file(database)
    for invariant in invariants():
        yield check(database, invariant)


def invariants() -> Sequence[Invariant]:
    """Return every invariant: references first, since their repair violates others, repaired later."""
    return [*invariants_of_jobs(), *invariants_of_sweeps(), *invariants_of_keys()]


def repair(database: Database) -> Iterator[Finding]:
    """Repair what can be repaired; yield each violated invariant with the number of repaired rows."""
    for invariant in invariants():
        finding = check(database, invariant)
        if finding.broken and invariant.remedy is not None:
            yield replace(finding, mended=invariant.remedy.apply(database, invariant.broken))


def check(database: Database, invariant: Invariant) -> Finding:
    """Count the rows that violate an invariant."""
    finding = Finding(
        invariant.code,
        invariant.says,
        is_warning=invariant.is_warning,
        remedy=None if invariant.remedy is None else invariant.remedy.says,
    )
    with database.read() as session:
        # Almost always there are none; then the count is not needed.
        examples = session.scalars(invariant.broken.limit(EXAMPLES)).all()
        if not examples:
            return finding
        broken = session.scalar(select(func.count()).select_from(invariant.broken.subquery()))
    return replace(finding, broken=broken or len(examples), examples=tuple(map(str, examples)))


def check_schema(database: Database) -> Finding:
    """Return the finding about the schema version."""
    with database.read() as session:
        stored = stored_revision(session.connection())
    law, fault = f"the schema is that of this version, {newest_revision()}", fault_of(stored)
    if fault is None:
        return Finding("schema", law)
    return Finding("schema", f"{law}: {fault}", broken=1, examples=(str(stored),))


def _check_file(database: Database) -> Iterator[Finding]:
    """Run SQLite's own integrity check; Postgres has page checksums instead."""
    if database.engine.dialect.name != "sqlite":
        return
    with database.read() as session:
        lines = map(str, session.scalars(text("PRAGMA integrity_check")))
        faults = [line for line in lines if line != "ok"]
    finding = Finding("file", "the pages and indexes of the file are sound")
    yield replace(finding, broken=len(faults), examples=tuple(faults[:EXAMPLES]))
    if database.file is not None:
        says = "the file and those beside it are private to their owner"
        warning = database.file.mode_warning()
        yield Finding(
            "file_mode",
            says,
            broken=int(warning is not None),
            examples=() if warning is None else (warning,),
            is_warning=True,
        )


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
    pieces += [range_of(problem) for problem in session.scalars(to_do)]
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
    return most_of(problem) if problem is not None else max(sweep.chunk_points, 1)


def invariants_of_sweeps() -> Iterator[Invariant]:
    """Yield the invariants of sweeps and their chunks."""
    remedy = Remedy("it is recounted, and missing points are queued", repair_sweeps)
    pieces = _pieces()
    before = func.lag(pieces.c.end).over(partition_by=pieces.c.sweep_id, order_by=pieces.c.first)
    starts = select(pieces.c.sweep_id, pieces.c.first, func.coalesce(before, 0).label("before")).subquery()
    yield Invariant(
        "sweep_overlaps",
        "no point of a sweep is in two chunks, stored or to be computed",
        select(starts.c.sweep_id).where(starts.c.first < starts.c.before).distinct(),
    )
    # The chunks of a cancelled sweep are cancelled with it.
    is_whole = SweepRow.state != JobState.CANCELLED.value
    yield Invariant(
        "sweep_gaps",
        "no point of a sweep is forgotten between its chunks, stored or to be computed",
        select(SweepRow.id)
        .join(starts, starts.c.sweep_id == SweepRow.id)
        .where(is_whole, starts.c.first > starts.c.before)
        .distinct(),
        remedy,
    )
    ends = (
        select(pieces.c.sweep_id, func.max(pieces.c.end).label("end")).group_by(pieces.c.sweep_id).subquery()
    )
    yield Invariant(
        "sweep_ends",
        "the chunks of a sweep, stored or to be computed, reach up to its next point",
        select(SweepRow.id)
        .outerjoin(ends, ends.c.sweep_id == SweepRow.id)
        .where(is_whole, SweepRow.next_index != func.coalesce(ends.c.end, 0)),
        remedy,
    )
    yield from _counts(remedy)


def _counts(remedy: Remedy) -> Iterator[Invariant]:
    counted = (
        select(
            SweepChunkRow.sweep_id,
            func.sum(SweepChunkRow.count).label("done"),
            func.sum(SweepChunkRow.refused).label("refused"),
        )
        .group_by(SweepChunkRow.sweep_id)
        .subquery()
    )
    yield Invariant(
        "sweep_counts",
        "a sweep counts the points of its stored chunks, and the refused ones among them",
        select(SweepRow.id)
        .outerjoin(counted, counted.c.sweep_id == SweepRow.id)
        .where(
            or_(
                SweepRow.done != func.coalesce(counted.c.done, 0),
                SweepRow.refused != func.coalesce(counted.c.refused, 0),
            )
        ),
        remedy,
    )
    is_live = SweepRow.state.in_(_LIVE)
    is_done = SweepRow.done == SweepRow.points
    succeeded = SweepRow.state == JobState.SUCCEEDED.value
    yield Invariant(
        "sweep_success",
        "a sweep has succeeded exactly if all of its points are done",
        select(SweepRow.id).where(or_(and_(succeeded, not_(is_done)), and_(is_live, is_done))),
        remedy,
    )
    its_chunks = and_(
        JobRow.sweep_id == SweepRow.id, JobRow.kind == JobKind.CHUNK.value, JobRow.state.in_(_LIVE)
    )
    yield Invariant(
        "sweep_stands_still",
        "a sweep that is not finished has chunks to be computed",
        select(SweepRow.id).where(is_live, not_(is_done), not_(exists().where(its_chunks))),
        remedy,
    )
    yield Invariant(
        "sweep_leftovers",
        "a finished sweep has no chunks to be computed",
        select(JobRow.id).join(SweepRow, its_chunks).where(not_(is_live)),
        Remedy("the chunk is cancelled", cancel_chunks),
    )
    ended, is_dated = not_(is_live), SweepRow.finished_at.is_not(None)
    yield Invariant(
        "sweep_finished_at",
        "a sweep has the instant of its end exactly if it has ended",
        select(SweepRow.id).where(differ(ended, is_dated)),
    )


def _pieces() -> CTE:
    """Return sweep_id, first and end of every chunk that is stored or to be computed."""
    stored = select(
        SweepChunkRow.sweep_id,
        SweepChunkRow.first,
        (SweepChunkRow.first + SweepChunkRow.count).label("end"),
    )
    first, count = (cast(JobRow.problem[name].as_string(), BigInteger) for name in ("first", "count"))
    to_do = select(JobRow.sweep_id, first, first + count).where(
        JobRow.kind == JobKind.CHUNK.value, JobRow.state.in_(_LIVE)
    )
    return union_all(stored, to_do).cte("pieces")
