"""Warnings about valid potentials with a surprising property."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Notice:
    """A warning: a stable ``code``, a sentence, and the place of the field (a JSON pointer)."""

    code: str
    message: str
    pointer: str
