"""Checks that every stored packet of arrays can be decoded and agrees with its row."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from random import Random
from typing import Any  # the columns depend on the kind

from sqlalchemy import ColumnElement, Select, and_, delete, func, or_, select
from sqlalchemy.orm import InstrumentedAttribute

from service.storage.codecs.packing import (
    SOLVED,
    CodecError,
    bounds_of,
    decode_arrays,
    decode_dense,
    decode_document,
    decode_points,
)
from service.storage.database.database import Database
from service.storage.examinations import is_sound
from service.storage.inspection.inspect import EXAMPLES, Finding
from service.storage.tables.base import Base
from service.storage.tables.jobs import ResultRow
from service.storage.tables.operations import ExaminationRow
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SweepChunkRow

Fields = tuple[Any, ...]

_PAGE = 50
"""Packets that are in memory at once."""


@dataclass(frozen=True, slots=True)
class _Kind:
    """A table whose rows hold packets."""

    code: str
    says: str
    table: type[Base]
    key: tuple[InstrumentedAttribute[Any], ...]
    columns: tuple[InstrumentedAttribute[Any], ...]
    """Columns to read; the first is the primary key."""
    read: Callable[[Fields], object]
    """Raises CodecError."""
    is_warning: bool = False
    remedy: str | None = None


def check_blobs(database: Database, *, sample: int | None, random: Random) -> Iterator[Finding]:
    """Read packets of every kind, ``sample`` of each chosen by ``random``, or all of them."""
    for kind in _kinds():
        broken, examples = 0, list[str]()
        for row in _rows(database, kind, sample, random):
            try:
                kind.read(row)
            except CodecError as fault:
                broken += 1
                if len(examples) < EXAMPLES:
                    examples.append(f"{row[0]}: {fault}")
        yield Finding(
            kind.code, kind.says, broken, tuple(examples), is_warning=kind.is_warning, remedy=kind.remedy
        )


def repair_examinations(database: Database) -> Finding | None:
    """Delete the cached verdicts and windows that are damaged; None if there are none."""
    kind = next(kind for kind in _kinds() if kind.table is ExaminationRow)
    damaged = []
    for row in _rows(database, kind, None, Random(0)):
        try:
            kind.read(row)
        except CodecError:
            damaged.append(row[0])
    if not damaged:
        return None
    for start in range(0, len(damaged), _PAGE):
        with database.write() as session:
            session.execute(
                delete(ExaminationRow).where(ExaminationRow.key.in_(damaged[start : start + _PAGE]))
            )
    examples = tuple(damaged[:EXAMPLES])
    count = len(damaged)
    return Finding(kind.code, kind.says, count, examples, is_warning=True, remedy=kind.remedy, mended=count)


def _kinds() -> Iterator[_Kind]:
    dense, samples, chunk = DenseOutputRow, SamplesRow, SweepChunkRow
    yield _packets(
        "dense_packets", "functions of time can be read", dense.solution_id, dense.data, decode_dense
    )
    yield _packets("samples_packets", "samples can be read", samples.solution_id, samples.data, decode_arrays)
    row = ExaminationRow
    yield _Kind(
        "examinations",
        "kept verdicts and windows are as they were when they were found",
        row,
        (row.key,),
        (row.key, row.seal, row.content),
        _read_kept,
        is_warning=True,
        remedy="damaged ones are deleted, and found again when they are needed",
    )
    atlas = ResultRow
    yield _packets(
        "atlas_packets",
        "atlases and answers of studies can be read",
        atlas.job_id,
        atlas.data,
        decode_document,
    )
    yield _Kind(
        "chunk_packets",
        "the points of sweeps can be read, and are as many and as large as is said of them",
        chunk,
        (chunk.sweep_id, chunk.first),
        (chunk.sweep_id, chunk.first, chunk.count, chunk.refused, chunk.bounds, chunk.data),
        _read_chunk,
    )


def _packets(
    code: str,
    says: str,
    key: InstrumentedAttribute[str],
    data: InstrumentedAttribute[bytes],
    decode: Callable[[bytes], object],
) -> _Kind:
    """Return packets that are checked by themselves."""
    return _Kind(code, says, key.parent.class_, (key,), (key, data), lambda fields: decode(fields[-1]))


def _read_kept(fields: Fields) -> None:
    key, seal, content = fields
    if not is_sound(key, content, seal):
        raise CodecError("the checksum is not that of the content")


def _read_chunk(fields: Fields) -> None:
    _, first, count, refused, bounds, data = fields
    points = decode_points(data)
    unsolved = sum(outcome != SOLVED for outcome in points.outcomes)
    if (len(points.outcomes), unsolved) != (count, refused):
        raise CodecError(
            f"the chunk at {first} holds {len(points.outcomes)} points, {unsolved} of them refused, "
            f"where its row says {count} and {refused}"
        )
    if {name: list(pair) for name, pair in bounds_of(points.numbers).items()} != bounds:
        raise CodecError(f"the numbers of the chunk at {first} are not within the bounds of its row")


def _rows(database: Database, kind: _Kind, sample: int | None, random: Random) -> Iterator[Fields]:
    ordered = select(*kind.columns).order_by(*kind.key)
    if sample is not None:
        with database.read() as session:
            total = session.scalar(select(func.count()).select_from(kind.table)) or 0
        if sample < total:
            for offset in sorted(random.sample(range(total), sample)):
                yield from _page(database, ordered.offset(offset).limit(1))
            return
    page = _page(database, ordered.limit(_PAGE))
    while page:
        yield from page
        page = _page(database, ordered.where(_after(kind.key, page[-1])).limit(_PAGE))


def _after(key: tuple[InstrumentedAttribute[Any], ...], last: Fields) -> ColumnElement[bool]:
    first, *rest = key
    beyond = first > last[0]
    return or_(beyond, and_(first == last[0], _after(tuple(rest), last[1:]))) if rest else beyond


def _page(database: Database, statement: Select[*tuple[Any, ...]]) -> list[Fields]:
    with database.read() as session:
        return [tuple(row) for row in session.execute(statement)]
