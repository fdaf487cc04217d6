"""Keeps what is made of an object that many problems share, such as the body of a list of jobs.

Objects are known by themselves and not by what they are equal to: hashing exact numbers takes longer than
most of what is kept here takes to be made.
"""

from collections.abc import Callable
from typing import Generic, TypeVar

Given = TypeVar("Given")
Made = TypeVar("Made")

MAX_OBJECTS = 64
"""Objects of which something is kept."""


class Remembering(Generic[Given, Made]):
    """A function of one immutable object that remembers its last answers."""

    def __init__(self, make: Callable[[Given], Made]) -> None:
        self._make = make
        self._known: dict[int, tuple[Given, Made]] = {}

    def __call__(self, given: Given) -> Made:
        """Return what is made of ``given``; what is returned belongs to all who ask."""
        # The object is kept as well: while it lives, no other one has its number.
        known = self._known.get(id(given))
        if known is None:
            known = self._known[id(given)] = given, self._make(given)
            while len(self._known) > MAX_OBJECTS:
                # Another thread may have taken the oldest one away.
                self._known.pop(next(iter(tuple(self._known))), None)
        return known[1]
