"""Writes trajectories in six formats, and motions as functions of time that keep every bit."""

import io
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from http import HTTPStatus

import numpy as np
import orjson
from fastapi import Response
from numpy.typing import NDArray

from service.api.formats.columns import metadata, units_of
from service.api.formats.negotiation import ARROW, CSV, JSON, MEDIA_TYPES, NDJSON, NPZ, PARQUET
from service.api.replies import ApiError, PiecedAnswer
from service.csv_text import CRLF, csv_blocks
from service.dynamics.solution.dense_output import DenseOutput
from service.schemas.reading.documents import Document

FloatArray = NDArray[np.float64]

ERROR_HEADER = "Polhode-Error"
ROWS = 2000
"""Rows of text, or numbers of a column of JSON, that are written at a time: some 15 ms."""


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Equally long columns and the bounds of their absolute errors."""

    columns: Mapping[str, FloatArray]
    error: float
    """The bound for every number."""
    errors: Mapping[str, float]
    """The bound for each column."""

    @property
    def rows(self) -> int:
        """The length of a column."""
        return len(next(iter(self.columns.values())))

    @property
    def size(self) -> int:
        """The bytes of all columns."""
        return sum(values.nbytes for values in self.columns.values())


def write(trajectory: Trajectory, media_type: str, headers: Mapping[str, str], about: Document) -> Response:
    """Return the answer in one of our formats; ``about`` goes into the metadata of Parquet.

    Long text is made while it is sent.
    """
    _require_finite(trajectory)
    own = {ERROR_HEADER: repr(trajectory.error), "Vary": "Accept", **headers}
    if media_type in _TEXTS:
        pieces = _TEXTS[media_type](trajectory)
        if trajectory.rows > ROWS:
            return PiecedAnswer(pieces, held=trajectory.size, media_type=media_type, headers=own)
        content = b"".join(pieces)
    elif media_type == PARQUET:
        from service.api.formats.arrow import parquet_file  # noqa: PLC0415

        described = {**about, "errors": dict(trajectory.errors), "units": units_of(trajectory.columns)}
        content = parquet_file(trajectory.columns, metadata(described))
    else:
        content = _FILES[media_type](trajectory)
    return Response(content, media_type=media_type, headers=own)


def media_types() -> Document:
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


def _json(trajectory: Trajectory) -> Iterator[bytes]:
    """Yield what orjson would write of all as one: a column in several pieces."""
    before = b'{"columns":{'
    for name, values in trajectory.columns.items():
        yield before + orjson.dumps(name) + b":["
        for start in range(0, len(values), ROWS):
            numbers = np.ascontiguousarray(values[start : start + ROWS])
            written = orjson.dumps(numbers, option=orjson.OPT_SERIALIZE_NUMPY)[1:-1]
            yield b"," + written if start else written
        before = b"],"
    yield b']},"error":' + orjson.dumps(trajectory.error) + b"}"


def _ndjson(trajectory: Trajectory) -> Iterator[bytes]:
    names = list(trajectory.columns)
    for some in _row_blocks(trajectory):
        rows = zip(*(values.tolist() for values in some), strict=True)
        lines = (orjson.dumps(dict(zip(names, row, strict=True)), option=_LINE) for row in rows)
        yield b"".join(lines)


def _csv(trajectory: Trajectory) -> Iterator[bytes]:
    return csv_blocks(trajectory.columns, _row_blocks(trajectory), CRLF)


def _row_blocks(trajectory: Trajectory) -> Iterator[list[FloatArray]]:
    for start in range(0, trajectory.rows, ROWS):
        yield [values[start : start + ROWS] for values in trajectory.columns.values()]


def _npz(trajectory: Trajectory) -> bytes:
    buffer = io.BytesIO()
    columns: dict[str, FloatArray] = dict(trajectory.columns)
    np.savez(buffer, allow_pickle=False, **columns)
    return buffer.getvalue()


def _arrow(trajectory: Trajectory) -> bytes:
    from service.api.formats.arrow import arrow_stream  # noqa: PLC0415

    return arrow_stream(trajectory.columns, {ERROR_HEADER: repr(trajectory.error)})


_LINE = orjson.OPT_APPEND_NEWLINE
_TEXTS: Mapping[str, Callable[[Trajectory], Iterator[bytes]]] = {JSON: _json, NDJSON: _ndjson, CSV: _csv}
_FILES: Mapping[str, Callable[[Trajectory], bytes]] = {NPZ: _npz, ARROW: _arrow}


def write_function(dense: DenseOutput, headers: Mapping[str, str]) -> Response:
    """Return the answer; orjson writes doubles by their shortest decimals: the same bits."""
    if not np.isfinite(dense.coefficients).all():
        detail = "the stored solution has values that are not finite; it cannot be sent"
        raise ApiError(HTTPStatus.INTERNAL_SERVER_ERROR, "not_finite", detail)
    document = {
        "columns": list(dense.columns),
        "breaks": np.ascontiguousarray(dense.breaks),
        "coefficients": np.ascontiguousarray(dense.coefficients),
        "period": None
        if dense.period is None
        else {"hi": dense.period.hi, "lo": dense.period.lo, "error": dense.period.error},
        "error": dense.error,
        "errors": dict(dense.errors),
        "advances": {name: asdict(gained) for name, gained in dense.advances.items()},
    }
    content = orjson.dumps(document, option=orjson.OPT_SERIALIZE_NUMPY)
    return Response(content, media_type=JSON, headers=headers)
