"""Cuts a sweep into chunks: small ones first, then about a second each, smaller again at the end."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

WAITING_CHUNKS = 16
"""Chunks of one sweep that wait in the queue, as long as there are points for them."""
PILOT_POINTS = 16
"""Points of the first chunk, which measures how long a point takes."""
CHUNK_SECONDS = 1.0
"""Seconds that a chunk should take."""
UNKNOWN_POINT_SECONDS = CHUNK_SECONDS / PILOT_POINTS
"""Assumed seconds for a point until a chunk has measured it."""
LARGEST_CHUNK = 65_536
"""Points of a chunk at most."""
LARGEST_BLOCK = 2_000_000
"""Numbers of a chunk's series at most: 16 MB."""
PARTS = 8
"""Number of parts into which a chunk is split that failed, or was returned with much left to do."""
_LAST_SHARE = 8
"""Near the end a chunk is at most this part of what is left, so that no worker computes it alone ..."""
_SMALLEST_SHARE = 4
"""... but not smaller than this part of a chunk of CHUNK_SECONDS."""


@dataclass(frozen=True, slots=True)
class Range:
    """The points first, first + 1, ..., first + count - 1."""

    first: int
    count: int


def largest_chunk(samples: int, columns: int) -> int:
    """Return how many points a chunk may have whose series are ``columns`` times ``samples`` numbers."""
    return max(1, min(LARGEST_CHUNK, LARGEST_BLOCK // max(samples * columns, 1)))


def pilot(points: int, most: int) -> Range:
    """Return the first chunk of a sweep of so many points, where a chunk has ``most`` points at most."""
    return Range(0, min(PILOT_POINTS, most, points))


def next_size(point_seconds: float, left: int, most: int) -> int:
    """Return the size of the next chunk: a point takes ``point_seconds``, ``left`` points have no chunk."""
    usual = CHUNK_SECONDS / point_seconds if point_seconds > CHUNK_SECONDS / most else float(most)
    size = min(usual, max(left / _LAST_SHARE, usual / _SMALLEST_SHARE))
    return max(1, min(int(size), most, left))


def cut(whole: Range, parts: int) -> Sequence[Range]:
    """Return ``whole`` in at most ``parts`` ranges of nearly equal size, none of them empty."""
    parts = min(parts, whole.count)
    edges = [whole.first + whole.count * k // parts for k in range(parts + 1)]
    return [Range(start, stop - start) for start, stop in itertools.pairwise(edges)]


def cut_rest(rest: Range, point_seconds: float) -> Sequence[Range]:
    """Return the rest of a partly computed chunk: in parts, if it would take much too long as one."""
    chunks = rest.count * point_seconds / CHUNK_SECONDS
    return cut(rest, min(PARTS, max(1, round(chunks))))


def further(next_index: int, points: int, waiting: int, point_seconds: float, most: int) -> Iterator[Range]:
    """Yield the ranges that fill up the queue, where ``waiting`` chunks are in it already."""
    while waiting < WAITING_CHUNKS and next_index < points:
        size = next_size(point_seconds, points - next_index, most)
        yield Range(next_index, size)
        next_index, waiting = next_index + size, waiting + 1
