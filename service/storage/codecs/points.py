"""Encodes the points of a chunk: one column for each kept number, none for the axes.

The values of a point's axes follow from the sweep and the point's index. An outcome
is an index into a list of words in the header. A series is one block of all
points with all samples; the series come after the numbers, in a packet of their
own, so that reading the numbers does not unpack them. NaN stands for a
number that a point does not have.
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from service.jobs.records import ChunkOutcome
from service.storage.codecs.arrays import CodecError, pack_arrays, unpack_arrays

FloatArray = NDArray[np.float64]

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


def chunk_outcome(points: ChunkPoints, seconds: float) -> ChunkOutcome:
    """Return the outcome of a chunk's computation."""
    count = len(points.outcomes)
    solved = sum(outcome == SOLVED for outcome in points.outcomes)
    return ChunkOutcome(count, count - solved, encode_points(points), bounds_of(points.numbers), seconds)


def bounds_of(numbers: Mapping[str, FloatArray]) -> dict[str, tuple[float, float]]:
    """Return the smallest and the largest of each number that any point has."""
    known = {name: values[np.isfinite(values)] for name, values in numbers.items()}
    return {name: (float(values.min()), float(values.max())) for name, values in known.items() if len(values)}


def encode_points(points: ChunkPoints) -> bytes:
    """Return the points as the length of the first packet (little endian, 4 bytes) and two packets."""
    words = list(dict.fromkeys(points.outcomes))
    places = {word: place for place, word in enumerate(words)}
    outcome = np.array([places[word] for word in points.outcomes], dtype=np.float64)
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
    places = outcome.astype(np.intp)
    if len(places) and not 0 <= places.min() <= places.max() < len(words):
        raise CodecError("the packet is damaged: an outcome is not in the list of its header")
    return ChunkPoints(
        outcomes=[str(words[place]) for place in places],
        numbers={name.removeprefix(_NUMBER): values for name, values in arrays.items()},
        series=unpack_arrays(series)[0] if with_series and series else {},
    )
