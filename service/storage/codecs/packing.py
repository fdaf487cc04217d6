"""Arrays, documents and points of sweeps as bytes.

Arrays are column-major, byte-shuffled float64, compressed by zstd. A packet is the magic
word, the length of a JSON header (little endian, 4 bytes), the header, and one zstd frame.
Shuffling puts the first bytes of all numbers together, then the second ones, and so on:
sign and exponent of neighbours are alike, and only in this order can zstd use it (measured:
unshuffled doubles of a trajectory do not shrink at all). Level -2: samples become as small
as at level 1, and functions of time a tenth larger, in half of the time or less.

A JSON document that may be large is compressed with a checksum of its content.

The points of a chunk have one column for each kept number, none for the axes: the values of
a point's axes follow from the sweep and the point's index. An outcome is an index into a
list of words in the header. A series is one block of all points with all samples; the
series come after the numbers, in a packet of their own, so that reading the numbers does
not unpack them. NaN stands for a number that a point does not have.
"""

import json
import math
import struct
import threading
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import zstandard
from numpy.typing import NDArray

from service.dynamics.solution.dense_output import Advance, DenseOutput, Period
from service.jobs.records import ChunkOutcome
from service.schemas.reading.documents import Document

FloatArray = NDArray[np.float64]

_MAGIC = b"PLH1"
_WIDTH = 8
_DOUBLES = np.dtype("<f8")
_LEVEL = -2
_HEADERS = 64
"""Number of headers that are cached: solutions of one list, and blocks of one sweep, have the same."""
_OF_THREAD = threading.local()


class CodecError(ValueError):
    """Bytes that were not written by this codec, or are damaged."""


def encode_arrays(arrays: Mapping[str, FloatArray]) -> bytes:
    """Return the arrays, of any shapes, as one packet; their order is kept."""
    return pack_arrays(arrays, {})


def decode_arrays(packet: bytes) -> dict[str, FloatArray]:
    """Return what :func:`encode_arrays` was given, bit by bit.

    Raises
    ------
    CodecError
        The packet is not one, or is damaged.
    """
    return unpack_arrays(packet)[0]


def encode_dense(dense: DenseOutput) -> bytes:
    """Return a dense output as one packet; fields with default values take no bytes."""
    arrays = {"breaks": dense.breaks, "coefficients": dense.coefficients, "error": np.array(dense.error)}
    if dense.period is not None:
        arrays["period"] = np.array([dense.period.hi, dense.period.lo, dense.period.error])
    if dense.errors:
        arrays["errors"] = np.array(list(dense.errors.values()))
    if dense.advances:
        arrays["advances"] = np.array([[a.hi, a.lo, a.error] for a in dense.advances.values()])
    names = {"errors": list(dense.errors), "advances": list(dense.advances)}
    given = {key: tuple(value) for key, value in names.items() if value}
    return pack_arrays(arrays, {"columns": dense.columns, **given})


def decode_dense(packet: bytes) -> DenseOutput:
    """Return what :func:`encode_dense` was given, bit by bit.

    Raises
    ------
    CodecError
        The packet is not a dense output, or is damaged.
    """
    arrays, header = unpack_arrays(packet)
    columns = _names(header, "columns")
    if "columns" not in header or not {"breaks", "coefficients", "error"} <= arrays.keys():
        raise CodecError("the packet holds arrays, but not those of a dense output")
    errors = arrays.get("errors", np.zeros(0)).tolist()
    advances = arrays.get("advances", np.zeros((0, 3))).tolist()
    with_error, with_advance = _names(header, "errors"), _names(header, "advances")
    if len(errors) != len(with_error) or len(advances) != len(with_advance):
        raise CodecError("the packet is damaged: its names and numbers do not match")
    period = None if "period" not in arrays else Period(*arrays["period"].tolist())
    return DenseOutput(
        columns=columns,
        breaks=arrays["breaks"],
        coefficients=arrays["coefficients"],
        period=period,
        error=float(arrays["error"]),
        errors=dict(zip(with_error, errors, strict=True)),
        advances={name: Advance(*row) for name, row in zip(with_advance, advances, strict=True)},
    )


def _names(header: Mapping[str, object], key: str) -> tuple[str, ...]:
    names = header.get(key, [])
    return tuple(map(str, names)) if isinstance(names, list) else ()


def pack_arrays(arrays: Mapping[str, FloatArray], extra: Mapping[str, tuple[str, ...]]) -> bytes:
    """Return the arrays and further fields of the header as one packet."""
    header = _header(tuple((name, array.shape) for name, array in arrays.items()), tuple(extra.items()))
    body = _shuffled(list(arrays.values()))
    frame = _compressor().compress(body)
    return _MAGIC + struct.pack("<I", len(header)) + header + frame


@lru_cache(maxsize=_HEADERS)
def _header(
    shapes: tuple[tuple[str, tuple[int, ...]], ...], extra: tuple[tuple[str, tuple[str, ...]], ...]
) -> bytes:
    entries = [{"name": name, "shape": shape} for name, shape in shapes]
    return json.dumps({"arrays": entries, **dict(extra)}, separators=(",", ":")).encode()


def _compressor() -> zstandard.ZstdCompressor:
    """Return the thread's own: making one takes as long as compressing a trajectory; threads share none."""
    found: zstandard.ZstdCompressor | None = getattr(_OF_THREAD, "compressor", None)
    if found is None:
        found = zstandard.ZstdCompressor(level=_LEVEL, write_checksum=True)
        _OF_THREAD.compressor = found
    return found


def unpack_arrays(packet: bytes) -> tuple[dict[str, FloatArray], dict[str, object]]:
    """Return the arrays and the header of a packet; raises :class:`CodecError`."""
    if packet[:4] != _MAGIC:
        raise CodecError(f"a packet begins with {_MAGIC!r}, not with {packet[:4]!r}")
    try:
        (length,) = struct.unpack_from("<I", packet, 4)
        header = json.loads(packet[8 : 8 + length])
        shapes = {entry["name"]: tuple(entry["shape"]) for entry in header["arrays"]}
        sizes = {name: math.prod(shape) for name, shape in shapes.items()}
        total = _WIDTH * sum(sizes.values())
        frame = packet[8 + length :]
        # Checked before memory is allocated: a damaged frame may ask for an exabyte.
        if total and zstandard.frame_content_size(frame) != total:
            raise ValueError("its frame does not hold what its header says")
        # An empty body has no content size in its frame: zstd then asks for a limit.
        body = zstandard.ZstdDecompressor().decompress(frame, max_output_size=max(total, 1))
    except (struct.error, ValueError, KeyError, TypeError, zstandard.ZstdError) as fault:
        raise CodecError(f"the packet is damaged: {fault}") from fault
    if len(body) != total:
        raise CodecError(f"the packet holds {len(body)} bytes of numbers where its header says {total}")
    arrays, start = {}, 0
    for name, shape in shapes.items():
        stop = start + _WIDTH * sizes[name]
        arrays[name] = _unshuffle(body[start:stop], shape)
        start = stop
    return arrays, header


def _shuffled(arrays: Sequence[FloatArray]) -> bytes:
    """Return the arrays one after the other, each shuffled; columns of one length take one step."""
    first = arrays[0] if arrays else None
    if first is None or first.ndim != 1 or any(array.shape != first.shape for array in arrays):
        return b"".join(map(_shuffle, arrays))
    columns = np.array(arrays, dtype=_DOUBLES)
    return columns.view(np.uint8).reshape(len(arrays), len(first), _WIDTH).transpose(0, 2, 1).tobytes()


def _shuffle(array: FloatArray) -> bytes:
    flat = np.asarray(array, dtype=_DOUBLES).ravel(order="F")
    return flat.view(np.uint8).reshape(-1, _WIDTH).T.tobytes()


def _unshuffle(body: bytes, shape: tuple[int, ...]) -> FloatArray:
    by_number = np.frombuffer(body, dtype=np.uint8).reshape(_WIDTH, -1).T
    flat = np.ascontiguousarray(by_number).reshape(-1).view("<f8").astype(np.float64, copy=False)
    return np.asarray(flat.reshape(shape, order="F"), order="C")


def encode_document(document: Document) -> bytes:
    """Return the document as bytes (RFC 1950, whose last four are the checksum)."""
    return zlib.compress(json.dumps(document, allow_nan=False, separators=(",", ":")).encode())


def decode_document(data: bytes) -> Document:
    """Return an encoded document, or raise :class:`~service.storage.codecs.packing.CodecError`."""
    try:
        document = json.loads(zlib.decompress(data))
    except (zlib.error, ValueError) as fault:
        raise CodecError(f"no document: {fault}") from fault
    if not isinstance(document, dict):
        raise CodecError("no document: its JSON is no object")
    return document


SOLVED = "solved"
"""The outcome of a point that was solved; that of any other is the code of its error."""

_OUTCOME = "outcome"
_NUMBER = "number "
"""Prefix of the names of the other arrays."""
_LENGTH = struct.Struct("<I")


@dataclass(frozen=True, slots=True)
class ChunkPoints:
    """Some neighbouring points of a sweep that are done."""

    outcomes: Sequence[str]
    """``SOLVED`` or the code of an error, one for each point."""
    numbers: Mapping[str, FloatArray]
    """The kept numbers by name, each of shape [points]; NaN where a point has none."""
    series: Mapping[str, FloatArray] = field(default_factory=dict)
    """``t`` and functions of time by name, each of shape [points, samples]; NaN where a point has none."""


def chunk_outcome(
    points: ChunkPoints, seconds: float, source: Mapping[str, object] | None = None
) -> ChunkOutcome:
    """Return the outcome of a chunk's computation."""
    count = len(points.outcomes)
    refused = sum(outcome != SOLVED for outcome in points.outcomes)
    bounds = bounds_of(points.numbers)
    return ChunkOutcome(count, refused, encode_points(points), bounds, seconds, source)


def bounds_of(numbers: Mapping[str, FloatArray]) -> dict[str, tuple[float, float]]:
    """Return the smallest and the largest of each number that any point has."""
    known = {name: values[np.isfinite(values)] for name, values in numbers.items()}
    return {name: (float(values.min()), float(values.max())) for name, values in known.items() if len(values)}


def encode_points(points: ChunkPoints) -> bytes:
    """Return the points as the length of the first packet (little endian, 4 bytes) and two packets."""
    words = list(dict.fromkeys(points.outcomes))
    indices = {word: index for index, word in enumerate(words)}
    outcome = np.array([indices[word] for word in points.outcomes], dtype=np.float64)
    arrays = {_OUTCOME: outcome, **{_NUMBER + name: values for name, values in points.numbers.items()}}
    numbers = pack_arrays(arrays, {"outcomes": tuple(words)})
    series = pack_arrays(points.series, {}) if points.series else b""
    return _LENGTH.pack(len(numbers)) + numbers + series


def decode_points(data: bytes, *, with_series: bool = True) -> ChunkPoints:
    """Return what :func:`encode_points` was given, bit by bit; if asked, without the series.

    Raises
    ------
    CodecError
        The bytes do not hold points, or are damaged.
    """
    if len(data) < _LENGTH.size:
        raise CodecError("the bytes are too few to be the points of a sweep")
    (length,) = _LENGTH.unpack_from(data)
    numbers, series = data[_LENGTH.size : _LENGTH.size + length], data[_LENGTH.size + length :]
    arrays, header = unpack_arrays(numbers)
    words, outcome = header.get("outcomes"), arrays.pop(_OUTCOME, None)
    if not isinstance(words, list) or outcome is None:
        raise CodecError("the packet holds arrays, but not the points of a sweep")
    indices = outcome.astype(np.intp)
    if len(indices) and not 0 <= indices.min() <= indices.max() < len(words):
        raise CodecError("the packet is damaged: an outcome is not in the list of its header")
    return ChunkPoints(
        outcomes=[str(words[index]) for index in indices],
        numbers={name.removeprefix(_NUMBER): values for name, values in arrays.items()},
        series=unpack_arrays(series)[0] if with_series and series else {},
    )
