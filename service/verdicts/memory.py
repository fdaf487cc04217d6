"""Keeps examinations in memory, in front of the store of the installation."""

import threading
from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

from service.verdicts.entries import Entry

MOST_BYTES = 32_000_000
"""Largest size of the contents that one process holds in memory."""


class EntryStore(Protocol):
    """A store that other processes share."""

    def get(self, keys: Sequence[str]) -> Mapping[str, str]:
        """Return the contents of those keys that are kept."""
        ...


class KeptExaminations:
    """The entries used last in this process, then those of the store. Safe between threads."""

    def __init__(self, store: EntryStore, *, most_bytes: int = MOST_BYTES) -> None:
        self._store, self._most = store, most_bytes
        self._lock = threading.Lock()
        self._known: OrderedDict[str, str] = OrderedDict()
        self._bytes = 0
        self._hits = self._misses = 0

    @property
    def counts(self) -> tuple[int, int]:
        """Numbers of the keys that were found, in memory or in the store, and of those that were not."""
        with self._lock:
            return self._hits, self._misses

    def get(self, keys: Sequence[str]) -> dict[str, str]:
        """Return the contents of those keys that are kept; the store is asked for what is not in memory."""
        found = self.in_memory(keys)
        missing = [key for key in dict.fromkeys(keys) if key not in found]
        if missing:
            stored = self._store.get(missing)
            self.remember(Entry(key, content) for key, content in stored.items())
            found.update(stored)
        with self._lock:
            self._hits += len(found)
            self._misses += sum(key not in found for key in missing)
        return found

    def in_memory(self, keys: Sequence[str]) -> dict[str, str]:
        """Return the contents of those keys that this process has."""
        found: dict[str, str] = {}
        with self._lock:
            for key in keys:
                content = self._known.get(key)
                if content is not None:
                    self._known.move_to_end(key)
                    found[key] = content
        return found

    def remember(self, entries: Iterable[Entry]) -> None:
        """Hold entries in memory, and drop those that were not used for longest."""
        with self._lock:
            for entry in entries:
                self._bytes -= len(self._known.pop(entry.key, ""))
                self._known[entry.key] = entry.content
                self._bytes += len(entry.content)
            while self._bytes > self._most and self._known:
                _, dropped = self._known.popitem(last=False)
                self._bytes -= len(dropped)
