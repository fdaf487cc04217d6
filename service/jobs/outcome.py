"""The result of a computation as a child process returns it, and what it is compared with: JSON and bytes."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Solved:
    """The solution of one problem document."""

    summary: dict[str, object]
    dense: bytes
    """The function of time, encoded by :mod:`service.storage.codecs.packing`; so are the samples."""
    samples: bytes
    comparison: Mapping[str, object] | None = None
    """For an audit, the comparison with the stored solution."""


@dataclass(frozen=True, slots=True)
class StoredSolution:
    """A solution as it is stored, for a comparison with another one."""

    problem: Mapping[str, object]
    summary: Mapping[str, object]
    dense: bytes
    """Empty if it is missing, which no regular way leads to."""
    samples: bytes | None
    """None if they were removed to save space."""


@dataclass(frozen=True, slots=True)
class Refused:
    """Why one problem document has no solution."""

    error: dict[str, object]
    """Holds at least ``code`` and ``detail``."""


SolveOutcome = Solved | Refused


@dataclass(frozen=True, slots=True)
class ChunkOutcome:
    """The results for some neighbouring points of a sweep.

    Made by :func:`service.storage.codecs.packing.chunk_outcome`.
    """

    count: int
    """Number of computed points, counted from the first, at least 1; the others are queued again."""
    refused: int
    """Points among them that were not solved; ``data`` has the reasons."""
    data: bytes
    """The columns of the points, encoded by :mod:`service.storage.codecs.packing`."""
    bounds: Mapping[str, tuple[float, float]]
    """Smallest and largest of each kept number that any point has."""
    seconds: float
    """Seconds that computing them took."""


@dataclass(frozen=True, slots=True)
class Drawn:
    """The atlas that a document asked for."""

    data: bytes
    """Encoded by :mod:`service.storage.codecs.packing`."""


Outcome = SolveOutcome | ChunkOutcome | Drawn
