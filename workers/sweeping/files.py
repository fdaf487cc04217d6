"""Writes points to Parquet, Arrow and CSV files as they arrive."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Protocol

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv, ipc, parquet

from service.schemas.sweep.sweep import Sweep
from service.storage.codecs.packing import ChunkPoints
from service.terminal import STANDARD_STREAM, OutputFile

FloatArray = NDArray[np.float64]

INDEX, OUTCOME = "index", "outcome"


class PointFile(Protocol):
    """A file that is valid once it is closed, however many points were written."""

    def write_table(self, table: pa.Table) -> None:
        """Add points."""
        ...

    def close(self) -> None:
        """Finish the file."""
        ...


_OPENERS: Mapping[str, Callable[[OutputFile, pa.Schema], PointFile]] = MappingProxyType(
    {".parquet": parquet.ParquetWriter, ".arrow": ipc.new_file, ".csv": csv.CSVWriter}
)
SUFFIXES = tuple(_OPENERS)
WITH_LISTS = (".parquet", ".arrow")
"""Suffixes of files that can hold series."""


def suffix_of(path: Path) -> str:
    """Return the suffix that selects the format; stdout gets CSV."""
    return ".csv" if path == STANDARD_STREAM else path.suffix


@contextmanager
def opened_points(path: Path, sweep: Sweep) -> Iterator[PointFile]:
    """Open a new file in the format of the path's suffix, one of ``SUFFIXES``.

    It is always closed at the end, so that it can be read.

    Raises
    ------
    FileFaultError
        It cannot be opened; every method raises it if the file cannot be written.
    """
    with OutputFile(path) as output:
        points = _OPENERS[suffix_of(path)](output, schema_of(sweep))
        try:
            yield points
        finally:
            points.close()


def schema_of(sweep: Sweep) -> pa.Schema:
    """Return the columns: index, axes by their pointers, kept numbers, outcome, series."""
    numbers = [(name, pa.float64()) for name in (*sweep.pointers, *sweep.keep)]
    series = [(name, pa.list_(pa.float64())) for name in sweep.series_columns]
    return pa.schema([(INDEX, pa.int64()), *numbers, (OUTCOME, pa.string()), *series])


def table_of(sweep: Sweep, first: int, points: ChunkPoints) -> pa.Table:
    """Return the points from ``first`` on; null where a point has no such number or no series."""
    count = len(points.outcomes)
    columns: dict[str, object] = {INDEX: np.arange(first, first + count, dtype=np.int64)}
    columns |= sweep.columns(first, count)
    columns |= {name: pa.array(values, from_pandas=True) for name, values in points.numbers.items()}
    columns[OUTCOME] = pa.array(points.outcomes)
    columns |= {name: _lists(rows) for name, rows in points.series.items()}
    schema = schema_of(sweep)
    return pa.table([columns[name] for name in schema.names], schema=schema)


def _lists(rows: FloatArray) -> pa.Array:
    """Return a list for each row without the NaN behind its last number, null if there is none."""
    known = ~np.isnan(rows)
    lengths = known.shape[1] - np.argmax(known[:, ::-1], axis=1)
    lengths[~known.any(axis=1)] = 0
    used = np.arange(rows.shape[1]) < lengths[:, None]
    offsets = pa.array(np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32))
    return pa.ListArray.from_arrays(offsets, pa.array(rows[used]), mask=pa.array(lengths == 0))
