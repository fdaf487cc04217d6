"""The store of sweeps in SQL; one method is one transaction.

The estimate of how long a sweep still takes reads the latest attempts at its chunks.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any  # the types of the columns of a table that is not mapped

from sqlalchemy import Select, bindparam, select
from sqlalchemy.orm import Session, defer

from service.jobs.queue import RECENT_SECONDS, ChunkRun, pilot, remaining_seconds
from service.jobs.records import (
    JobState,
    SweepFinishedError,
    SweepNotFoundError,
    SweepPage,
    SweepProgress,
    SweepRecord,
)
from service.schemas.query.terms import ListQuery, facts_of
from service.schemas.reading.documents import UNANNOTATED, Annotation, Part
from service.storage.annotations import annotations_of, insert_labels, rewrite
from service.storage.database.database import Database
from service.storage.database.rows import database_now, instant, is_id, new_id, optional_instant, rows_of_page
from service.storage.jobs import chunks
from service.storage.jobs.queue import announce
from service.storage.keys import Receipt, write_key
from service.storage.searching.pages import find
from service.storage.searching.sources import OF_SWEEP_ROWS
from service.storage.tables.base import table_of
from service.storage.tables.jobs import AttemptRow, JobRow
from service.storage.tables.solutions import SweepChunkRow, SweepRow

_LONG = SweepRow.document, SweepRow.provenances
"""Columns that lists of sweeps do not have."""
_PAGE = 1000
"""Chunks whose descriptions are read at once."""


@dataclass(frozen=True, slots=True)
class StoredChunk:
    """A stored chunk of neighbouring points, without its data."""

    first: int
    count: int
    bounds: Mapping[str, tuple[float, float]]
    """Smallest and largest of each number that any point has."""


class SweepStore:
    """Writes and reads sweeps and their points."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def submit(
        self,
        document: Part,
        *,
        points: int,
        most: int,
        priority: int = 0,
        key_id: str | None = None,
        receipt: Receipt[SweepRecord] | None = None,
        annotation: Annotation = UNANNOTATED,
    ) -> SweepRecord:
        """Store a sweep and its first chunk only, however many points it has, and the answer of a receipt.

        ``most`` is the largest chunk that may be made of it.
        """
        first = pilot(points, most)
        with self._database.write() as session:
            row = SweepRow(
                id=new_id(),
                state=JobState.QUEUED.value,
                document=document,
                facts=_facts(document),
                points=points,
                next_index=first.count,
                done=0,
                refused=0,
                chunk_points=first.count,
                priority=priority,
                key_id=key_id,
                created_at=database_now(session),
                note=annotation.note,
            )
            session.add(row)
            session.flush()
            insert_labels(session, SweepRow, [(row.id, row.created_at, annotation)])
            chunks.queue_chunks(session, row, [first], most)
            session.flush()
            announce(self._database, session.connection())
            record = _record(session, row)
            if receipt is not None:
                write_key(session.connection(), receipt.given, receipt.answer(record))
            return record

    def get(self, sweep_id: str) -> SweepRecord:
        """Return a sweep, or raise :class:`SweepNotFoundError`."""
        with self._database.read() as session:
            return _record(session, _row(session, sweep_id))

    def find(self, query: ListQuery) -> SweepPage:
        """Return one page of the sweeps that match; only the wanted columns of them, if there are any."""
        with self._database.search() as session:
            found = find(session, OF_SWEEP_ROWS, query)
            rows = [] if query.columns else rows_of_page(session, SweepRow, found.ids, *map(defer, _LONG))
            return SweepPage(tuple(_progress(session, rows)), found.total, found.values, found.next)

    def annotate(self, sweep_id: str, change: Callable[[SweepRecord], Annotation]) -> SweepRecord:
        """Give a sweep the labels and the note that ``change`` makes of its present state.

        Nothing is changed if it raises. Raises :class:`SweepNotFoundError`.
        """
        with self._database.write() as session:
            row = chunks.hold(session, sweep_id) if is_id(sweep_id) else None
            if row is None:
                raise SweepNotFoundError(sweep_id)
            record = _record(session, row)
            annotation = change(record)
            rewrite(session, row, annotation, record.annotation.labels)
            return replace(record, annotation=annotation)

    def cancel(self, sweep_id: str) -> SweepRecord:
        """Cancel an unfinished sweep and its chunks at once; cancelling again changes nothing.

        The points that are done stay. Raises :class:`SweepFinishedError` if it
        has succeeded, :class:`SweepNotFoundError`.
        """
        with self._database.write() as session:
            row = chunks.hold(session, sweep_id) if is_id(sweep_id) else None
            if row is None:
                raise SweepNotFoundError(sweep_id)
            if not chunks.cancel(session, row) and row.state != JobState.CANCELLED.value:
                raise SweepFinishedError(row.id, JobState(row.state))
            return _record(session, row)

    def chunks(self, sweep_id: str) -> Iterator[StoredChunk]:
        """Yield the stored chunks in the order of their points; no transaction is open in between."""
        after = -1
        columns = SweepChunkRow.first, SweepChunkRow.count, SweepChunkRow.bounds
        while True:
            further = SweepChunkRow.sweep_id == sweep_id, SweepChunkRow.first > after
            statement = select(*columns).where(*further).order_by(SweepChunkRow.first).limit(_PAGE)
            with self._database.read() as session:
                found = session.execute(statement).all()
            for first, count, bounds in found:
                yield StoredChunk(first, count, _bounds(bounds))
            if len(found) < _PAGE:
                return
            after = found[-1].first

    def data(self, sweep_id: str, firsts: Sequence[int]) -> list[bytes]:
        """Return the encoded points of the chunks that begin at ``firsts``, in that order."""
        statement = select(SweepChunkRow.first, SweepChunkRow.data).where(
            SweepChunkRow.sweep_id == sweep_id, SweepChunkRow.first.in_(firsts)
        )
        with self._database.read() as session:
            found = {row.first: row.data for row in session.execute(statement)}
        return [found[first] for first in firsts]

    def sources(self, sweep_id: str, firsts: Sequence[int]) -> dict[int, tuple[str | None, int | None]]:
        """Return the host, and the place of its provenance, of the stored chunks that begin at ``firsts``."""
        columns = SweepChunkRow.first, SweepChunkRow.host, SweepChunkRow.provenance
        here = SweepChunkRow.sweep_id == sweep_id, SweepChunkRow.first.in_(firsts)
        with self._database.read() as session:
            return {
                first: (host, place) for first, host, place in session.execute(select(*columns).where(*here))
            }


def _row(session: Session, sweep_id: str) -> SweepRow:
    row = session.get(SweepRow, sweep_id) if is_id(sweep_id) else None
    if row is None:
        raise SweepNotFoundError(sweep_id)
    return row


def _facts(document: Part) -> Part:
    base = document.get("base")
    return facts_of(base) if isinstance(base, Mapping) else {}


def _bounds(stored: Part) -> dict[str, tuple[float, float]]:
    return {name: (float(lower), float(upper)) for name, (lower, upper) in stored.items()}


def _record(session: Session, row: SweepRow) -> SweepRecord:
    (progress,) = _progress(session, [row])
    known = {each.name: getattr(progress, each.name) for each in fields(progress)}
    return SweepRecord(**known, document=row.document, provenances=row.provenances or ())


def _progress(session: Session, rows: Sequence[SweepRow]) -> Iterator[SweepProgress]:
    remaining = _remaining(session, [row for row in rows if row.state == JobState.RUNNING.value])
    for row, annotation in zip(rows, annotations_of(session, rows), strict=True):
        yield SweepProgress(
            id=row.id,
            state=JobState(row.state),
            points=row.points,
            done=row.done,
            refused=row.refused,
            point_seconds=row.point_seconds,
            remaining_seconds=remaining.get(row.id),
            priority=row.priority,
            key_id=row.key_id,
            created_at=instant(row.created_at),
            started_at=optional_instant(row.started_at),
            finished_at=optional_instant(row.finished_at),
            way=row.way,
            annotation=annotation,
        )


def _remaining(session: Session, running: Sequence[SweepRow]) -> Mapping[str, float | None]:
    """Return how long running sweeps still take, by their ids."""
    if not running:
        return {}
    now = database_now(session)
    since = complete_since(session, now)
    runs = chunk_runs(session, [row.id for row in running], since)
    return {
        row.id: remaining_seconds(row.points - row.done, runs[row.id], since=since, now=now)
        for row in running
    }


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
    rows = [
        (str(each[0]), chunks.range_of(each[1]).first, each[2], each[3]) for each in session.execute(ended)
    ]
    brought = _points(session, {(sweep_id, first) for sweep_id, first, _, _ in rows})
    runs: dict[str, list[ChunkRun]] = {sweep_id: [] for sweep_id in sweep_ids}
    for sweep_id, first, started_at, ended_at in rows:
        if first:
            runs[sweep_id].append(ChunkRun(started_at, ended_at, brought.get((sweep_id, first), 0)))
    for each in session.execute(at_work):
        if chunks.range_of(each[1]).first and each[2] is not None:
            runs[str(each[0])].append(ChunkRun(each[2], None, 0))
    return runs


def _points(session: Session, starts: Collection[tuple[str, int]]) -> dict[tuple[str, int], int]:
    """Return the number of points of the chunks that begin at ``starts``, by sweep and first point."""
    if not starts:
        return {}
    statement = select(SweepChunkRow.sweep_id, SweepChunkRow.first, SweepChunkRow.count).where(
        SweepChunkRow.sweep_id.in_({sweep_id for sweep_id, _ in starts}),
        SweepChunkRow.first.in_({first for _, first in starts}),
    )
    return {(sweep_id, first): count for sweep_id, first, count in session.execute(statement)}


_SWEEPS = table_of(SweepRow)


@dataclass(frozen=True, slots=True)
class SweepStanding:
    """The facts that decide which points there are: as long as the way is one, chunks are only ever added."""

    id: str
    done: int
    refused: int
    way: str | None
    is_finished: bool


def standing_in(record: SweepRecord) -> SweepStanding:
    """Return how far a sweep was when its record was read."""
    return SweepStanding(record.id, record.done, record.refused, record.way, record.finished_at is not None)


def sweep_standing_of(database: Database, sweep_id: str) -> SweepStanding:
    """Return how far a sweep is, or raise :class:`SweepNotFoundError`."""
    if not is_id(sweep_id):
        raise SweepNotFoundError(sweep_id)
    with database.read_rows() as connection:
        found = connection.execute(_statement(), {"id": sweep_id}).one_or_none()
    if found is None:
        raise SweepNotFoundError(sweep_id)
    return SweepStanding(str(found.id), found.done, found.refused, found.way, found.finished_at is not None)


@cache
def _statement() -> Select[Any]:
    """Return the statement, which takes longer to build than to execute."""
    columns = _SWEEPS.c.id, _SWEEPS.c.done, _SWEEPS.c.refused, _SWEEPS.c.way, _SWEEPS.c.finished_at
    return select(*columns).where(_SWEEPS.c.id == bindparam("id"))
