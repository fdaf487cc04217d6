"""The result of a computation as a child process returns it: JSON and bytes, never objects."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Solved:
    """The solution of one problem document."""

    summary: dict[str, object]
    dense: bytes
    """The function of time, encoded by :mod:`service.storage.codecs.arrays`; so are the samples."""
    samples: bytes


@dataclass(frozen=True, slots=True)
class Refused:
    """Why one problem document has no solution."""

    error: dict[str, object]
    """Holds at least ``code`` and ``detail``."""


SolveOutcome = Solved | Refused


@dataclass(frozen=True, slots=True)
class ChunkOutcome:
    """The results for some neighbouring points of a sweep.

    Made by :func:`service.storage.codecs.points.chunk_outcome`.
    """

    count: int
    """Number of computed points, counted from the first, at least 1; the others are queued again."""
    refused: int
    """Points among them that were not solved; ``data`` has the reasons."""
    data: bytes
    """The columns of the points, encoded by :mod:`service.storage.codecs.points`."""
    bounds: Mapping[str, tuple[float, float]]
    """Smallest and largest of each kept number that any point has."""
    seconds: float
    """Seconds that computing them took."""


Outcome = SolveOutcome | ChunkOutcome
