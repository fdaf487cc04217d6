"""Wakes the loop of a worker: one byte through a pair of sockets."""

import contextlib
import socket


class Waker:
    """Wakes the worker loop, from other threads and from signal handlers."""

    def __init__(self) -> None:
        self._hear, self._ring = socket.socketpair()
        self._hear.setblocking(False)
        self._ring.setblocking(False)

    def __call__(self) -> None:
        """Wake the loop. If the buffer is full, it has been woken already; if it is closed, it has ended."""
        with contextlib.suppress(OSError):
            self._ring.send(b".")

    def fileno(self) -> int:
        """Return the descriptor to select on."""
        return self._hear.fileno()

    def clear(self) -> None:
        """Discard pending wake-ups."""
        with contextlib.suppress(BlockingIOError):
            self._hear.recv(4096)

    def close(self) -> None:
        """Close both ends."""
        self._hear.close()
        self._ring.close()
