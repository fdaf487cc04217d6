"""Keeps the bytes of answers that were written before, by their entity tags."""

import threading
from collections import OrderedDict
from collections.abc import Callable

MOST_BYTES = 8_000_000


class KeptAnswers:
    """The answers asked for last. A tag names exactly one content, so that none gets old. Thread-safe."""

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most, self._size = most_bytes, 0
        self._lock = threading.Lock()
        self._contents: OrderedDict[str, bytes] = OrderedDict()

    def find(self, tag: str) -> bytes | None:
        """Return the content with this tag, None if it is not here."""
        with self._lock:
            content = self._contents.get(tag)
            if content is not None:
                self._contents.move_to_end(tag)
            return content

    def get(self, tag: str, write: Callable[[], bytes]) -> bytes:
        """Return the content with this tag; ``write`` makes it if it is not here."""
        content = self.find(tag)
        if content is not None:
            return content
        content = write()
        with self._lock:
            if tag not in self._contents:
                self._contents[tag] = content
                self._size += len(content)
            while self._size > self._most:
                self._size -= len(self._contents.popitem(last=False)[1])
        return content
