"""What a computation hands back: JSON and bytes, never objects."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SolveOutcome:
    """The answer to one problem document.

    Either ``summary`` or ``error`` is given. ``error`` holds at least ``code``
    and ``detail``; ``dense`` and ``samples`` are encoded by
    :mod:`service.storage.codec` and empty if there is an error.
    """

    summary: dict[str, object] | None
    dense: bytes
    samples: bytes
    error: dict[str, object] | None
