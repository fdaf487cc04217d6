"""Writes Arrow streams and Parquet by PyArrow, which has no type hints and is used here only.

It is loaded by the first answer in one of these formats: a service starts without it.
"""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from service.api.formats.columns import ColumnKind, Sink


def arrow_stream(columns: Mapping[str, NDArray[np.float64]], metadata: Mapping[str, str]) -> bytes:
    """Return one record batch of float64 columns in the streaming format, with metadata in its schema."""
    arrays = [pa.array(np.ascontiguousarray(values)) for values in columns.values()]
    return _stream(pa.record_batch(arrays, names=list(columns)), metadata)


def _stream(batch: pa.RecordBatch, metadata: Mapping[str, str]) -> bytes:
    described, sink = batch.replace_schema_metadata(dict(metadata)), pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, described.schema) as writer:
        writer.write_batch(described)
    return bytes(sink.getvalue().to_pybytes())


def matrix_stream(
    columns: Mapping[str, NDArray[np.float64]],
    numbers: Mapping[str, NDArray[np.float64]],
    words: Mapping[str, NDArray[np.object_]],
    metadata: Mapping[str, str],
) -> bytes:
    """Return one record batch with a list for each row of the matrices; NaN and None are null."""
    arrays = {name: pa.array(values) for name, values in columns.items()}
    for name, matrix in {**numbers, **words}.items():
        flat = pa.array(
            matrix.reshape(-1), type=pa.float64() if name in numbers else pa.string(), from_pandas=True
        )
        ends = pa.array(np.arange(len(matrix) + 1, dtype=np.int32) * matrix.shape[1])
        arrays[name] = pa.ListArray.from_arrays(ends, flat)
    return _stream(pa.record_batch(list(arrays.values()), names=list(arrays)), metadata)


def arrow_batches(
    kinds: Mapping[str, ColumnKind],
    batches: Iterable[Mapping[str, NDArray[np.generic]]],
    metadata: Mapping[str, str],
) -> Iterator[bytes]:
    """Yield a stream of record batches, one piece of bytes for each; without batches, the schema alone."""
    schema, sink = schema_of(kinds, metadata), Sink()
    with pa.ipc.new_stream(sink, schema) as writer:
        yield sink.take()
        for batch in batches:
            writer.write_batch(record_batch(schema, kinds, batch))
            yield sink.take()
    yield sink.take()


def schema_of(kinds: Mapping[str, ColumnKind], metadata: Mapping[str, str]) -> pa.Schema:
    """Return the schema of columns of points."""
    fields = [pa.field(name, _TYPES[kind]()) for name, kind in kinds.items()]
    return pa.schema(fields, metadata=dict(metadata))


def record_batch(
    schema: pa.Schema, kinds: Mapping[str, ColumnKind], batch: Mapping[str, NDArray[np.generic]]
) -> pa.RecordBatch:
    """Return points as a record batch."""
    return pa.record_batch([_array(batch[name], kind) for name, kind in kinds.items()], schema=schema)


_TYPES = {
    "integer": pa.int64,
    "number": pa.float64,
    "word": pa.string,
    "instant": lambda: pa.timestamp("us", tz="UTC"),
    "truth": pa.bool_,
    "series": lambda: pa.list_(pa.float64()),
}


def _array(values: NDArray[np.generic], kind: ColumnKind) -> pa.Array:
    if kind != "series":
        return pa.array(values, type=_TYPES[kind](), from_pandas=True)
    points, samples = values.shape
    missing = np.isnan(values.astype(np.float64, copy=False)).all(axis=1)
    ends = pa.array(np.arange(points + 1, dtype=np.int32) * samples)
    numbers = pa.array(np.ascontiguousarray(values).reshape(-1))
    return pa.ListArray.from_arrays(ends, numbers, mask=pa.array(missing))


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
