"""Writes points of a sweep: as JSON objects, NDJSON, CSV, Arrow, Parquet or NPZ, and a sweep as one file.

Points are written a block at a time, so that memory does not grow with the sweep.

The file can be read without this program: a ZIP with a Frictionless data package, whose descriptor
``datapackage.json`` (https://datapackage.org, version 2.0) names the files beside it with their sizes,
checksums, columns and units.
"""

import hashlib
import json
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime

import numpy as np
import orjson
from numpy.typing import NDArray

from service.api.formats.columns import ColumnKind, Sink, npz_file, units_of
from service.api.formats.negotiation import ARROW, CSV, NDJSON, NPZ, PARQUET
from service.api.queries.points import Wish
from service.csv_text import CRLF, csv_blocks
from service.schemas.reading.documents import Part, instant_text
from service.storage.sweeps.point_reader import INDEX, OUTCOME, PointBlock

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


POINTS, DOCUMENT, DESCRIPTOR = "points.parquet", "sweep.json", "datapackage.json"
PROFILE = "https://datapackage.org/profiles/2.0/datapackage.json"
ZIP = "application/zip"
_TYPES: Mapping[ColumnKind, str] = {
    "integer": "integer",
    "number": "number",
    "word": "string",
    "series": "list",
}


@dataclass(frozen=True, slots=True)
class Package:
    """The contents of a sweep's descriptor."""

    sweep: str
    """Its id."""
    document: Part
    finished_at: datetime
    kinds: Mapping[str, ColumnKind]
    errors: Mapping[str, str]
    """For each column that has one, the column with the bounds of its errors."""
    provenance: Part


def package(about: Package, parquet: Iterable[bytes]) -> Iterator[bytes]:
    """Yield the ZIP file; ``parquet`` are the pieces of the points' file."""
    sink, archive = Sink(), _Archive(about.finished_at)
    with zipfile.ZipFile(sink, "w") as file:
        for name, pieces in (
            (DOCUMENT, [_json(about.document)]),
            (POINTS, parquet),
            # Last: it has the checksums of the others.
            (DESCRIPTOR, archive.descriptor(about)),
        ):
            with file.open(archive.entry(name), "w", force_zip64=True) as member:
                for piece in pieces:
                    member.write(piece)
                    archive.count(name, piece)
                    yield sink.take()
    yield sink.take()


@dataclass(slots=True)
class _Archive:
    """Sizes and checksums of what has been written."""

    made: datetime
    _sizes: dict[str, int] = field(default_factory=dict)
    _hashes: dict[str, "hashlib._Hash"] = field(default_factory=dict)

    def entry(self, name: str) -> zipfile.ZipInfo:
        """Return the entry of a file; the same sweep gives the same bytes, whenever it is asked for."""
        return zipfile.ZipInfo(name, self.made.timetuple()[:6])

    def count(self, name: str, piece: bytes) -> None:
        """Add a piece to the size and the checksum of a file."""
        self._sizes[name] = self._sizes.get(name, 0) + len(piece)
        self._hashes.setdefault(name, hashlib.sha256()).update(piece)

    def descriptor(self, about: Package) -> Iterator[bytes]:
        """Yield the descriptor, once all else has been written."""
        yield _json(
            {
                "$schema": PROFILE,
                "name": f"polhode-sweep-{about.sweep}",
                "id": f"urn:uuid:{about.sweep}",
                "title": "Motions of a rigid body about a fixed point: a sweep over numbers of one problem",
                "created": instant_text(about.finished_at),
                "provenance": about.provenance,
                "resources": [
                    {
                        **self._resource("points", POINTS, "parquet", "application/vnd.apache.parquet"),
                        "description": "A row for each point; `outcome` is `solved`, or why not.",
                        "schema": {"fields": list(_fields(about)), "primaryKey": ["index"]},
                    },
                    {
                        **self._resource("sweep", DOCUMENT, "json", "application/json"),
                        "description": "The document that POST /v1/sweeps takes to compute the same again.",
                    },
                ],
            }
        )

    def _resource(self, name: str, path: str, format_name: str, media_type: str) -> Part:
        return {
            "name": name,
            "path": path,
            "format": format_name,
            "mediatype": media_type,
            "bytes": self._sizes[path],
            "hash": f"sha256:{self._hashes[path].hexdigest()}",
        }


def _fields(about: Package) -> Iterator[dict[str, object]]:
    units = units_of(about.kinds)
    for name, kind in about.kinds.items():
        described: dict[str, object] = {"name": name, "type": _TYPES[kind]}
        if name in units:
            described["unit"] = units[name]
        if name in about.errors:
            described["errorBound"] = about.errors[name]
        if kind == "series":
            described["itemType"] = "number"
        yield described


def _json(document: Part) -> bytes:
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False).encode() + b"\n"
