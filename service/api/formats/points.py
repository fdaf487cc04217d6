"""Writes points of a sweep as JSON objects, NDJSON, CSV, Arrow, Parquet or NPZ, a block at a time."""

from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np
import orjson
from numpy.typing import NDArray

from service.api.formats.columns import ColumnKind, npz_file
from service.api.formats.negotiation import ARROW, CSV, NDJSON, NPZ, PARQUET
from service.api.queries.points import Wish
from service.csv_text import CRLF, csv_blocks
from service.storage.sweeps.point_query import INDEX, OUTCOME
from service.storage.sweeps.point_reader import PointBlock

TEXT_NUMBERS = 15_000
"""Numbers that are written as text at a time."""

Writer = Callable[[Wish, Iterable[PointBlock], Mapping[str, str]], Iterator[bytes]]


def rows(wish: Wish, block: PointBlock) -> Iterator[dict[str, object]]:
    """Yield the points of a block as objects; a missing number is NaN, a missing series None."""
    lists = [_values(block, name) for name in wish.columns]
    for row in zip(*lists, strict=True):
        yield dict(zip(wish.columns, row, strict=True))


def ndjson(wish: Wish, blocks: Iterable[PointBlock], _: Mapping[str, str]) -> Iterator[bytes]:
    """Yield a line for each point."""
    option = orjson.OPT_APPEND_NEWLINE | orjson.OPT_SERIALIZE_NUMPY
    for block in _short(wish, blocks):
        yield b"".join(orjson.dumps(row, option=option) for row in rows(wish, block))


def csv(wish: Wish, blocks: Iterable[PointBlock], _: Mapping[str, str]) -> Iterator[bytes]:
    """Yield the header line and a line for each point; missing numbers are empty."""
    columns = ([_column(block, name) for name in wish.columns] for block in _short(wish, blocks))
    return csv_blocks(wish.columns, columns, CRLF)


def arrow(wish: Wish, blocks: Iterable[PointBlock], metadata: Mapping[str, str]) -> Iterator[bytes]:
    """Yield an Arrow stream with a record batch for each block."""
    from service.api.formats.arrow import arrow_batches  # noqa: PLC0415

    return arrow_batches(kinds_of(wish), _batches(wish, blocks), metadata)


def parquet(wish: Wish, blocks: Iterable[PointBlock], metadata: Mapping[str, str]) -> Iterator[bytes]:
    """Yield a Parquet file with a row group for each block."""
    from service.api.formats.arrow import parquet_groups  # noqa: PLC0415

    return parquet_groups(kinds_of(wish), _batches(wish, blocks), metadata)


def npz(wish: Wish, blocks: Iterable[PointBlock], _: Mapping[str, str]) -> Iterator[bytes]:
    """Yield the columns as arrays of NumPy, which are made at once; outcomes are text of fixed length."""
    batches = list(_batches(wish, blocks))
    columns = {
        name: np.concatenate([batch[name] for batch in batches]) if batches else np.empty(0)
        for name in wish.columns
    }
    if OUTCOME in columns:
        columns[OUTCOME] = columns[OUTCOME].astype(np.str_)
    yield npz_file(columns)


def _short(wish: Wish, blocks: Iterable[PointBlock]) -> Iterator[PointBlock]:
    """Yield the same points, fewer at a time: so many as are written as text in some 20 ms."""
    for block in blocks:
        samples = sum(block.series[name].shape[1] for name in wish.series)
        rows = max(1, TEXT_NUMBERS // (len(wish.columns) + samples))
        for start in range(0, len(block.indices), rows):
            yield block.taken(slice(start, start + rows))


STREAMS: Mapping[str, Writer] = {NDJSON: ndjson, CSV: csv, ARROW: arrow, PARQUET: parquet, NPZ: npz}
"""The streaming formats, which have no pages."""


def kinds_of(wish: Wish) -> dict[str, ColumnKind]:
    """Return the columns that are asked for with their kinds."""
    return {name: _kind(wish, name) for name in wish.columns}


def _batches(wish: Wish, blocks: Iterable[PointBlock]) -> Iterator[dict[str, NDArray[np.generic]]]:
    return ({name: _column(block, name) for name in wish.columns} for block in blocks)


def _kind(wish: Wish, name: str) -> ColumnKind:
    if name in wish.series:
        return "series"
    return "integer" if name == INDEX else "word" if name == OUTCOME else "number"


def _column(block: PointBlock, name: str) -> NDArray[np.generic]:
    if name == INDEX:
        return block.indices
    if name == OUTCOME:
        return block.outcomes
    return block.series[name] if name in block.series else block.numbers[name]


def _values(block: PointBlock, name: str) -> list[object]:
    if name in block.series:
        series = block.series[name]
        return [None if np.isnan(row).all() else np.ascontiguousarray(row) for row in series]
    values: list[object] = _column(block, name).tolist()
    return values
