"""Common parts of the writers of columns: kinds of columns, and a buffer for written bytes."""

import io
from typing import Literal

ColumnKind = Literal["integer", "number", "word", "series"]
"""The values of a column of points; NaN becomes null, and so does a series of NaN only."""


class Sink(io.RawIOBase):
    """Buffers written bytes until they are taken."""

    def __init__(self) -> None:
        super().__init__()
        self._held = bytearray()
        self._before = 0

    def writable(self) -> bool:
        """Tell that it can be written to."""
        return True

    def tell(self) -> int:
        """Return how many bytes have been written in all."""
        return self._before + len(self._held)

    def write(self, data: "memoryview | bytes") -> int:  # type: ignore[override]
        """Buffer some bytes."""
        self._held += data
        return len(data)

    def take(self) -> bytes:
        """Return what was written since the last time."""
        piece = bytes(self._held)
        self._before += len(piece)
        self._held.clear()
        return piece
