"""The cache of this project: bounded, of what was used last, safe between threads.

Each use names what is kept, by which key, and how much of it; docs/caches.md lists them all.
"""

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar

Key = TypeVar("Key")
Value = TypeVar("Value")


class Cache(Generic[Key, Value]):
    """Values by their keys; those that were used longest ago are dropped when there are too many.

    ``size`` tells how much of the ``most`` a value takes, 1 if left out. A value that takes more than all of
    it is not kept.
    """

    def __init__(self, most: int, size: Callable[[Value], int] = lambda _: 1) -> None:
        self._most, self._size = most, size
        self._lock = threading.Lock()
        self._values: OrderedDict[Key, Value] = OrderedDict()
        self._taken = 0

    def get(self, key: Key) -> Value | None:
        """Return the value of a key, None if there is none."""
        with self._lock:
            value = self._values.get(key)
            if value is not None:
                self._values.move_to_end(key)
            return value

    def put(self, key: Key, value: Value) -> None:
        """Keep a value in the place of an earlier one."""
        with self._lock:
            self._drop(self._values.pop(key, None))
            self._values[key] = value
            self._taken += self._size(value)
            while self._taken > self._most:
                self._drop(self._values.popitem(last=False)[1])

    def get_or_make(self, key: Key, make: Callable[[], Value]) -> Value:
        """Return the value of a key; if there is none, ``make`` makes it, perhaps in two threads at once."""
        value = self.get(key)
        if value is None:
            value = make()
            self.put(key, value)
        return value

    def _drop(self, value: Value | None) -> None:
        if value is not None:
            self._taken -= self._size(value)
