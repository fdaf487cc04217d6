"""Writes Parquet, whole or in row groups, by PyArrow, which has no type hints."""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from service.api.formats.arrow import record_batch, schema_of
from service.api.formats.columns import ColumnKind, Sink


def parquet_file(columns: Mapping[str, NDArray[np.float64]], metadata: Mapping[str, str]) -> bytes:
    """Return float64 columns as a file with metadata in its schema."""
    arrays = [pa.array(np.ascontiguousarray(values)) for values in columns.values()]
    table = pa.table(arrays, names=list(columns)).replace_schema_metadata(dict(metadata))
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd")
    return bytes(sink.getvalue().to_pybytes())


def parquet_groups(
    kinds: Mapping[str, ColumnKind],
    batches: Iterable[Mapping[str, NDArray[np.generic]]],
    metadata: Mapping[str, str],
) -> Iterator[bytes]:
    """Yield a file with a row group for each batch, one piece of bytes for each."""
    schema, sink = schema_of(kinds, metadata), Sink()
    with pq.ParquetWriter(sink, schema, compression="zstd") as writer:
        yield sink.take()
        for batch in batches:
            writer.write_batch(record_batch(schema, kinds, batch))
            yield sink.take()
    yield sink.take()
