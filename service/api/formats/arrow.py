"""Writes Arrow streams; PyArrow, which has no type hints, is used here and for Parquet only."""

import io
from collections.abc import Iterable, Iterator, Mapping
from typing import Literal

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

ColumnKind = Literal["integer", "number", "word", "series"]
"""The values of a column of points; NaN becomes null, and so does a series of NaN only."""


def arrow_stream(columns: Mapping[str, NDArray[np.float64]], metadata: Mapping[str, str]) -> bytes:
    """Return one record batch of float64 columns in the streaming format, with metadata in its schema."""
    arrays = [pa.array(np.ascontiguousarray(values)) for values in columns.values()]
    batch = pa.record_batch(arrays, names=list(columns)).replace_schema_metadata(dict(metadata))
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as writer:
        writer.write_batch(batch)
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
    batch = pa.record_batch(list(arrays.values()), names=list(arrays))
    batch = batch.replace_schema_metadata(dict(metadata))
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as writer:
        writer.write_batch(batch)
    return bytes(sink.getvalue().to_pybytes())


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


class Sink(io.RawIOBase):
    """Buffers written bytes until they are taken."""

    def __init__(self) -> None:
        super().__init__()
        self._held = bytearray()
        self._before = 0

    def writable(self) -> bool:
        """Tell that it can be written to."""
        return True

    def tell(self) -> int:
        """Return how many bytes have been written in all."""
        return self._before + len(self._held)

    def write(self, data: "memoryview | bytes") -> int:  # type: ignore[override]
        """Buffer some bytes."""
        self._held += data
        return len(data)

    def take(self) -> bytes:
        """Return what was written since the last time."""
        piece = bytes(self._held)
        self._before += len(piece)
        self._held.clear()
        return piece
