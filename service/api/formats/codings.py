"""Content codings (RFC 9110, 8.4): gzip and zstd, of answers and of bodies."""

import gzip
import io
import zlib
from collections.abc import Callable
from dataclasses import dataclass

import zstandard

from service.api.formats.negotiation import weight_of

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
