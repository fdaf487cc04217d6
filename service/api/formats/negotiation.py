"""Chooses the format of an answer, and codings of answers and of bodies.

The format is chosen by the parameter ``format`` or the Accept header (RFC 9110, 12.5.1);
codings (8.4) are gzip and zstd.
"""

import gzip
import io
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from http import HTTPStatus
from typing import Annotated

import zstandard
from fastapi import Header

from service.api.queries.queries import FormatName
from service.api.replies import ApiError

JSON, CSV, NPZ = "application/json", "text/csv", "application/x-npz"
NDJSON, ARROW = "application/x-ndjson", "application/vnd.apache.arrow.stream"
PARQUET = "application/vnd.apache.parquet"
MEDIA_TYPES: Mapping[FormatName, str] = {
    "json": JSON,
    "csv": CSV,
    "ndjson": NDJSON,
    "npz": NPZ,
    "arrow": ARROW,
    "parquet": PARQUET,
}
_LONGEST_KEPT = 256
"""Longer Accept headers are read each time, so that no client fills the memory."""
_ENDINGS = {name: name for name in MEDIA_TYPES} | {"arrow": "arrows"}

# Not in the schema: OpenAPI ignores a parameter named Accept, since each answer lists its media types.
Accept = Annotated[str | None, Header(include_in_schema=False)]
"""The type of an endpoint's parameter that receives the Accept header; None if there is none."""


def chosen(name: FormatName | None, accept: str | None) -> str:
    """Return the media type of a format that is asked for by name, or else by the Accept header."""
    return preferred(list(MEDIA_TYPES.values()), accept) if name is None else MEDIA_TYPES[name]


def named_file(stem: str, media_type: str) -> dict[str, str]:
    """Return the header by which clients name the file; JSON is still shown by browsers."""
    ending = next(_ENDINGS[name] for name, kind in MEDIA_TYPES.items() if kind == media_type)
    shown = "inline" if media_type == JSON else "attachment"
    return {"Content-Disposition": f'{shown}; filename="{stem}.{ending}"'}


def preferred(offered: Sequence[str], accept: str | None) -> str:
    """Return the media type that the client prefers; the first one without a header.

    Raises
    ------
    ApiError
        406 if it accepts none of them.
    """
    header = accept or "*/*"
    find = _best if len(header) <= _LONGEST_KEPT else _best.__wrapped__
    best = find(tuple(offered), header)
    if best is None:
        detail = f"accepted formats are {', '.join(offered)}"
        raise ApiError(HTTPStatus.NOT_ACCEPTABLE, "not_acceptable", detail)
    return best


@lru_cache(maxsize=256)  # clients send the same few again and again
def _best(offered: tuple[str, ...], accept: str) -> str | None:
    best, best_quality = None, 0.0
    for media_type in offered:
        quality = _quality(media_type, accept)
        if quality > best_quality:
            best, best_quality = media_type, quality
    return best


def _quality(media_type: str, accept: str) -> float:
    """Return the quality value of a media type, by the most specific matching entry."""
    kind = media_type.partition("/")[0]
    ranks = {"*/*": 1, f"{kind}/*": 2, media_type: 3}
    found, quality = 0, 0.0
    for entry in accept.split(","):
        name, *parameters = (part.strip().lower() for part in entry.split(";"))
        rank = ranks.get(name, 0)
        if rank > found:
            found, quality = rank, weight_of(parameters)
    return quality


def weight_of(parameters: list[str]) -> float:
    """Return the quality value among the parameters of an entry; 1 without one, 0 if it cannot be read."""
    for parameter in parameters:
        name, _, value = parameter.partition("=")
        if name.strip() == "q":
            try:
                weight = float(value)
            except ValueError:
                return 0.0
            return weight if 0.0 <= weight <= 1.0 else 0.0
    return 1.0


GZIP, ZSTD, IDENTITY = "gzip", "zstd", "identity"
ACCEPTED = (ZSTD, GZIP)
"""The better one first."""

_GZIP_LEVEL, _ZSTD_LEVEL = 4, 3
_GZIP_WINDOW = 31
"""zlib's number for 32 KiB with the header of gzip, whose time is left 0: equal answers are equal bytes."""
_LARGEST_WINDOW = 2**23
"""Bytes that a zstd body may make us remember: what RFC 8878 tells everybody to support."""


class CodingError(ValueError):
    """A body is not in the coding that it is said to be in."""


@dataclass(frozen=True, slots=True)
class Encoder:
    """Encodes an answer piece by piece; whatever it has returned can be decoded at once."""

    piece: Callable[[bytes], bytes]
    end: Callable[[], bytes]


def encoder(coding: str) -> Encoder:
    """Return a new encoder."""
    if coding == ZSTD:
        frame = zstandard.ZstdCompressor(level=_ZSTD_LEVEL).compressobj()
        return Encoder(
            lambda data: frame.compress(data) + frame.flush(zstandard.COMPRESSOBJ_FLUSH_BLOCK), frame.flush
        )
    member = zlib.compressobj(_GZIP_LEVEL, zlib.DEFLATED, _GZIP_WINDOW)
    return Encoder(lambda data: member.compress(data) + member.flush(zlib.Z_SYNC_FLUSH), member.flush)


def encoded(content: bytes, coding: str) -> bytes:
    """Return a whole answer in a coding."""
    if coding == ZSTD:
        return zstandard.ZstdCompressor(level=_ZSTD_LEVEL).compress(content)
    return zlib.compress(content, _GZIP_LEVEL, _GZIP_WINDOW)


def preferred_coding(accept_encoding: str | None) -> str | None:
    """Return the coding that the client prefers, of equal ones the better; None for none."""
    weights = {name: weight_of(parameters) for name, parameters in _entries(accept_encoding or "")}
    others = weights.get("*", 0.0)
    best = max(ACCEPTED, key=lambda name: weights.get(name, others))
    weight = weights.get(best, others)
    return best if weight > 0.0 and weight >= weights.get(IDENTITY, 0.0) else None


def decoded(content: bytes, coding: str, limit: int) -> bytes | None:
    """Return a body without its coding; None if it is longer than ``limit``, found without making it.

    Raises
    ------
    CodingError
        It is not in that coding, or not complete.
    """
    try:
        return _of_zstd(content, limit) if coding == ZSTD else _of_gzip(content, limit)
    except (OSError, EOFError, zlib.error, zstandard.ZstdError) as fault:
        raise CodingError(f"the body is not {coding}: {fault}") from fault


def _of_gzip(content: bytes, limit: int) -> bytes | None:
    with gzip.GzipFile(fileobj=io.BytesIO(content)) as file:
        plain = file.read(limit + 1)
    return plain if len(plain) <= limit else None


def _of_zstd(content: bytes, limit: int) -> bytes | None:
    decompressor = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW)
    with decompressor.stream_reader(content) as reader:
        if len(reader.read(limit + 1)) > limit:
            return None
    # The reader ignores what is missing or follows. This does not, and is bounded by now.
    frame = decompressor.decompressobj()
    plain = frame.decompress(content)
    if not frame.eof or frame.unused_data:
        raise EOFError("one complete frame is accepted")
    return plain


def _entries(header: str) -> list[tuple[str, list[str]]]:
    parts = ([part.strip().lower() for part in entry.split(";")] for entry in header.split(","))
    return [(name, parameters) for name, *parameters in parts if name]
