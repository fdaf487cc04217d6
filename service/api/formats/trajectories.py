"""Writes trajectories as JSON, CSV, NPZ or Arrow, chosen by the Accept header."""

import io
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from http import HTTPStatus

import numpy as np
import orjson
from fastapi import Response
from numpy.typing import NDArray

from service.api.formats.arrow import arrow_stream
from service.api.formats.negotiation import preferred
from service.api.replies.errors import ApiError
from service.csv_text import CRLF, data_lines, header_line

FloatArray = NDArray[np.float64]

ERROR_HEADER = "Polhode-Error"


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Equally long columns and the bound of the absolute error of every number in them."""

    columns: Mapping[str, FloatArray]
    error: float


def choose_format(accept: str | None) -> str:
    """Return the media type that the client prefers; JSON without a header.

    Raises
    ------
    ApiError
        406 if it accepts none of ours.
    """
    return preferred(list(_FORMATS), accept)


def write(trajectory: Trajectory, media_type: str, headers: Mapping[str, str]) -> Response:
    """Return the answer in one of our formats."""
    _require_finite(trajectory)
    own = {ERROR_HEADER: repr(trajectory.error), "Vary": "Accept"}
    return Response(_FORMATS[media_type](trajectory), media_type=media_type, headers={**own, **headers})


def media_types() -> dict[str, object]:
    """Return the formats other than JSON, for the OpenAPI document."""
    binary = {"schema": {"type": "string", "format": "binary"}}
    return {name: binary for name in _FORMATS if name != "application/json"}


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


def _csv(trajectory: Trajectory) -> bytes:
    return (header_line(trajectory.columns, CRLF) + data_lines(trajectory.columns.values(), CRLF)).encode()


def _npz(trajectory: Trajectory) -> bytes:
    buffer = io.BytesIO()
    columns: dict[str, FloatArray] = dict(trajectory.columns)
    np.savez(buffer, allow_pickle=False, **columns)
    return buffer.getvalue()


def _arrow(trajectory: Trajectory) -> bytes:
    return arrow_stream(trajectory.columns, {ERROR_HEADER: repr(trajectory.error)})


_FORMATS: Mapping[str, Callable[[Trajectory], bytes]] = {
    "application/json": _json,
    "text/csv": _csv,
    "application/x-npz": _npz,
    "application/vnd.apache.arrow.stream": _arrow,
}
