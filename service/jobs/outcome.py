"""What a computation hands back: JSON and bytes, never objects."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SolveOutcome:
    """The answer to one problem document.

    Either ``summary`` or ``error`` is given. ``error`` holds at least ``code``
    and ``detail``; ``dense`` and ``samples`` are encoded by
    :mod:`service.storage.solutions.codec` and empty if there is an error.
    """

    summary: dict[str, object] | None
    dense: bytes
    samples: bytes
    error: dict[str, object] | None


@dataclass(frozen=True, slots=True)
class ChunkOutcome:
    """The answers to some neighbouring points of a sweep.

    Made by :func:`service.storage.sweeps.chunk_codec.chunk_outcome`.
    """

    count: int
    """Of the asked points the first so many, at least 1: the others are queued again."""
    refused: int
    """Points among them that were not solved; why is in ``data``."""
    data: bytes
    """The points in columns, encoded by :mod:`service.storage.sweeps.chunk_codec`."""
    bounds: Mapping[str, tuple[float, float]]
    """Smallest and largest of each kept number that any point has."""
    seconds: float
    """What computing them took."""


Outcome = SolveOutcome | ChunkOutcome
