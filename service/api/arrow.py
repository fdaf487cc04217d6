"""Arrow streams. PyArrow has no types: it stops here."""

from collections.abc import Mapping

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray


def arrow_stream(columns: Mapping[str, NDArray[np.float64]], metadata: Mapping[str, str]) -> bytes:
    """Return one record batch of float64 columns in the streaming format, with metadata in its schema."""
    arrays = [pa.array(np.ascontiguousarray(values)) for values in columns.values()]
    batch = pa.record_batch(arrays, names=list(columns)).replace_schema_metadata(dict(metadata))
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as writer:
        writer.write_batch(batch)
    return bytes(sink.getvalue().to_pybytes())
