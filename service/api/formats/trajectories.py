"""Writes trajectories as JSON, NDJSON, CSV, NPZ, Arrow or Parquet."""

import io
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from http import HTTPStatus

import numpy as np
import orjson
from fastapi import Response
from numpy.typing import NDArray

from service.api.formats.metadata import metadata, units_of
from service.api.formats.negotiation import ARROW, CSV, JSON, MEDIA_TYPES, NDJSON, NPZ, PARQUET
from service.api.replies.errors import ApiError
from service.csv_text import CRLF, data_lines, header_line

FloatArray = NDArray[np.float64]

ERROR_HEADER = "Polhode-Error"


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Equally long columns and the bounds of their absolute errors."""

    columns: Mapping[str, FloatArray]
    error: float
    """The bound for every number."""
    errors: Mapping[str, float]
    """The bound for each column."""


def write(
    trajectory: Trajectory, media_type: str, headers: Mapping[str, str], about: Mapping[str, object]
) -> Response:
    """Return the answer in one of our formats; ``about`` goes into the metadata of Parquet."""
    _require_finite(trajectory)
    own = {ERROR_HEADER: repr(trajectory.error), "Vary": "Accept"}
    if media_type == PARQUET:
        from service.api.formats.parquet import parquet_file  # noqa: PLC0415

        told = {**about, "errors": dict(trajectory.errors), "units": units_of(trajectory.columns)}
        content = parquet_file(trajectory.columns, metadata(told))
    else:
        content = _FORMATS[media_type](trajectory)
    return Response(content, media_type=media_type, headers={**own, **headers})


def media_types() -> dict[str, object]:
    """Return the formats other than JSON, for the OpenAPI document."""
    binary = {"schema": {"type": "string", "format": "binary"}}
    return {name: binary for name in MEDIA_TYPES.values() if name != JSON}


def _require_finite(trajectory: Trajectory) -> None:
    """Refuse non-finite values, which no solver writes, rather than send null."""
    bad = [name for name, values in trajectory.columns.items() if not np.isfinite(values).all()]
    if bad or not math.isfinite(trajectory.error):
        what = ", ".join(bad) or "the error"
        detail = f"the stored solution has values of {what} that are not finite; it cannot be sent"
        raise ApiError(HTTPStatus.INTERNAL_SERVER_ERROR, "not_finite", detail)


def _json(trajectory: Trajectory) -> bytes:
    columns = {name: np.ascontiguousarray(values) for name, values in trajectory.columns.items()}
    return orjson.dumps({"columns": columns, "error": trajectory.error}, option=orjson.OPT_SERIALIZE_NUMPY)


def _ndjson(trajectory: Trajectory) -> bytes:
    names, lists = list(trajectory.columns), [values.tolist() for values in trajectory.columns.values()]
    rows = (dict(zip(names, row, strict=True)) for row in zip(*lists, strict=True))
    return b"".join(orjson.dumps(row, option=orjson.OPT_APPEND_NEWLINE) for row in rows)


def _csv(trajectory: Trajectory) -> bytes:
    return (header_line(trajectory.columns, CRLF) + data_lines(trajectory.columns.values(), CRLF)).encode()


def _npz(trajectory: Trajectory) -> bytes:
    buffer = io.BytesIO()
    columns: dict[str, FloatArray] = dict(trajectory.columns)
    np.savez(buffer, allow_pickle=False, **columns)
    return buffer.getvalue()


def _arrow(trajectory: Trajectory) -> bytes:
    from service.api.formats.arrow import arrow_stream  # noqa: PLC0415

    return arrow_stream(trajectory.columns, {ERROR_HEADER: repr(trajectory.error)})


_FORMATS: Mapping[str, Callable[[Trajectory], bytes]] = {
    JSON: _json,
    NDJSON: _ndjson,
    CSV: _csv,
    NPZ: _npz,
    ARROW: _arrow,
}
