"""The invariants of sweeps, even after a kill: every point is in exactly one chunk."""

from collections.abc import Iterator

from sqlalchemy import CTE, BigInteger, and_, cast, exists, func, not_, or_, select, union_all

from service.jobs.records import FINISHED, JobKind, JobState
from service.storage.inspection.invariants import Invariant, Remedy, differ
from service.storage.inspection.sweep_repairs import cancel_chunks, repair_sweeps
from service.storage.tables.jobs import JobRow
from service.storage.tables.sweeps import SweepChunkRow, SweepRow

_LIVE = [state.value for state in JobState if state not in FINISHED]


def invariants_of_sweeps() -> Iterator[Invariant]:
    """Yield the invariants of sweeps and their chunks."""
    remedy = Remedy("it is recounted, and missing points are queued", repair_sweeps)
    pieces = _pieces()
    before = func.lag(pieces.c.end).over(partition_by=pieces.c.sweep_id, order_by=pieces.c.first)
    places = select(pieces.c.sweep_id, pieces.c.first, func.coalesce(before, 0).label("before")).subquery()
    yield Invariant(
        "sweep_overlaps",
        "no point of a sweep is in two chunks, stored or to be computed",
        select(places.c.sweep_id).where(places.c.first < places.c.before).distinct(),
    )
    # The chunks of a cancelled sweep are cancelled with it.
    is_whole = SweepRow.state != JobState.CANCELLED.value
    yield Invariant(
        "sweep_gaps",
        "no point of a sweep is forgotten between its chunks, stored or to be computed",
        select(SweepRow.id)
        .join(places, places.c.sweep_id == SweepRow.id)
        .where(is_whole, places.c.first > places.c.before)
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
