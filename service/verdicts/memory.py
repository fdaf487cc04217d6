"""Keeps examinations in memory, in front of the store of the installation."""

import threading
from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

from service.cache import Cache
from service.verdicts.cache_rows import Entry

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
        self._store = store
        self._lock = threading.Lock()
        self._cache: Cache[str, str] = Cache(most_bytes, len)
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
        known = {key: self._cache.get(key) for key in keys}
        return {key: content for key, content in known.items() if content is not None}

    def remember(self, entries: Iterable[Entry]) -> None:
        """Hold entries in memory, and drop those that were not used for longest."""
        for entry in entries:
            self._cache.put(entry.key, entry.content)
