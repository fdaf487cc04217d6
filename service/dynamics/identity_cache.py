"""Caches what is made of an object that many problems share, such as the body of a list of jobs.

The key is the object itself, not what it is equal to: hashing exact numbers takes longer than most of what is
cached here takes to be made.
"""

from collections.abc import Callable
from typing import Generic, TypeVar

Key = TypeVar("Key")
Value = TypeVar("Value")

MAX_OBJECTS_CACHED = 64
"""Objects of which something is cached."""


class IdentityCache(Generic[Key, Value]):
    """A function of one immutable object that caches its last results."""

    def __init__(self, make: Callable[[Key], Value]) -> None:
        self._make = make
        self._cached: dict[int, tuple[Key, Value]] = {}

    def __call__(self, key: Key) -> Value:
        """Return what is made of ``key``; the result belongs to all callers."""
        # The object is cached as well: while it lives, no other one has its number.
        cached = self._cached.get(id(key))
        if cached is None:
            cached = self._cached[id(key)] = key, self._make(key)
            while len(self._cached) > MAX_OBJECTS_CACHED:
                # Another thread may have taken the oldest one away.
                self._cached.pop(next(iter(tuple(self._cached))), None)
        return cached[1]
