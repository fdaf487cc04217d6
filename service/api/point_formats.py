"""Points of a sweep as JSON objects, NDJSON, CSV and Arrow, a block at a time."""

from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np
import orjson
from numpy.typing import NDArray

from service.api.arrow import ColumnKind, arrow_batches
from service.api.point_queries import Wish
from service.storage.sweeps.point_query import INDEX, OUTCOME
from service.storage.sweeps.point_reader import Block

JSON, CSV = "application/json", "text/csv"
NDJSON, ARROW = "application/x-ndjson", "application/vnd.apache.arrow.stream"

Writer = Callable[[Wish, Iterable[Block], Mapping[str, str]], Iterator[bytes]]


def rows(wish: Wish, block: Block) -> Iterator[dict[str, object]]:
    """Yield the points of a block as objects; NaN where a point has no such number, None for no series."""
    lists = [_values(block, name) for name in wish.columns]
    for row in zip(*lists, strict=True):
        yield dict(zip(wish.columns, row, strict=True))


def ndjson(wish: Wish, blocks: Iterable[Block], _: Mapping[str, str]) -> Iterator[bytes]:
    """Yield a line for each point."""
    option = orjson.OPT_APPEND_NEWLINE | orjson.OPT_SERIALIZE_NUMPY
    for block in blocks:
        yield b"".join(orjson.dumps(row, option=option) for row in rows(wish, block))


def csv(wish: Wish, blocks: Iterable[Block], _: Mapping[str, str]) -> Iterator[bytes]:
    """Yield the names and a line for each point; empty where a point has no such number."""
    yield (",".join(wish.columns) + "\r\n").encode()
    for block in blocks:
        columns = [_texts(block, name) for name in wish.columns]
        yield "".join(",".join(row) + "\r\n" for row in zip(*columns, strict=True)).encode()


def arrow(wish: Wish, blocks: Iterable[Block], metadata: Mapping[str, str]) -> Iterator[bytes]:
    """Yield an Arrow stream with a record batch for each block."""
    kinds = {name: _kind(wish, name) for name in wish.columns}
    batches = ({name: _column(block, name) for name in wish.columns} for block in blocks)
    return arrow_batches(kinds, batches, metadata)


STREAMS: Mapping[str, Writer] = {NDJSON: ndjson, CSV: csv, ARROW: arrow}
"""The formats that have no pages."""


def _kind(wish: Wish, name: str) -> ColumnKind:
    if name in wish.series:
        return "series"
    return "integer" if name == INDEX else "word" if name == OUTCOME else "number"


def _column(block: Block, name: str) -> NDArray[np.generic]:
    if name == INDEX:
        return block.indices
    if name == OUTCOME:
        return block.outcomes
    return block.series[name] if name in block.series else block.numbers[name]


def _values(block: Block, name: str) -> list[object]:
    if name in block.series:
        series = block.series[name]
        return [None if np.isnan(row).all() else np.ascontiguousarray(row) for row in series]
    values: list[object] = _column(block, name).tolist()
    return values


def _texts(block: Block, name: str) -> list[str]:
    values = _column(block, name).tolist()
    if name in (INDEX, OUTCOME):
        return [str(value) for value in values]
    # repr is the shortest decimal that reads back to the same double.
    return ["" if value != value else repr(value) for value in values]
