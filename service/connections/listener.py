"""The listening socket: accepts while there is room, and survives running out of file descriptors."""

import errno
import os
import resource
import socket
import time
from contextlib import suppress
from pathlib import Path
from typing import Any  # Any: what an address is depends on the family

from service.connections.gate import Gate
from service.connections.refusals import as_bytes, too_many_connections

_OUT_OF_RESOURCES = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_PAUSE_SECONDS = 1.0
"""Seconds that asyncio waits before it accepts again after such an error."""
_BACKLOG = 2048
"""Clients that may wait to be accepted."""
_SEND_BYTES = 256 * 1024
"""Bytes of an answer that the system buffers; a client 50 ms away still gets 5 MB a second."""
_KEPT_DESCRIPTORS = 24
"""Descriptors reserved for the database, the children and the log."""


class Listener(socket.socket):
    """A listening socket for asyncio's server, which calls :meth:`accept` until BlockingIOError.

    Accepted sockets have TCP_NODELAY: asyncio sets it only on sockets that name
    their protocol, and without it every answer on a kept-alive connection
    would wait 40 ms for an acknowledgement.
    """

    def __init__(self, gate: Gate, *, fileno: int) -> None:
        super().__init__(fileno=fileno)
        self._gate = gate
        self._spare: int | None = None
        self._paused_until = 0.0
        self._keep_spare()

    def accept(self) -> tuple[socket.socket, Any]:
        """Return the next connection for which there is room; BlockingIOError if none waits."""
        if time.monotonic() < self._paused_until:
            raise BlockingIOError
        has_room = self._gate.make_room()
        try:
            connection, address = super().accept()
        except OSError as fault:
            if fault.errno in _OUT_OF_RESOURCES:
                self._bear(fault)
            raise
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # Linux would buffer up to 4 MB of an answer for a client that does not read, copied for nothing.
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BYTES)
        if not has_room:
            self._gate.complaints.tell(f"all {self._gate.capacity} connections are in use: refusing others")
            _refuse(connection)
            raise BlockingIOError
        return connection, address

    def listen(self, backlog: int = _BACKLOG, /) -> None:
        """Keep the backlog: asyncio passes the number it accepts in one turn of its loop."""
        super().listen(max(backlog, _BACKLOG))

    def close(self) -> None:
        """Close the socket and the spare descriptor."""
        self._drop_spare()
        super().close()

    def _bear(self, fault: OSError) -> None:
        """Close an idle connection, or refuse the next with the spare descriptor; else pause."""
        self._gate.complaints.tell(f"no connection can be accepted: {fault.strerror}")
        if self._gate.give_one_up():
            raise BlockingIOError from fault  # its descriptor is free when the event loop comes back
        if self._spare is not None:
            self._drop_spare()
            with suppress(OSError):
                _refuse(super().accept()[0])
            self._keep_spare()
            raise BlockingIOError from fault
        self._keep_spare()
        self._paused_until = time.monotonic() + _PAUSE_SECONDS

    def _keep_spare(self) -> None:
        with suppress(OSError):
            self._spare = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)

    def _drop_spare(self) -> None:
        if self._spare is not None:
            os.close(self._spare)
            self._spare = None


def _refuse(connection: socket.socket) -> None:
    """Tell a client that there is no room, without waiting for it."""
    with connection, suppress(OSError):
        connection.setblocking(False)
        with suppress(BlockingIOError):
            # Closing a socket with unread data would reset the connection and lose the answer.
            connection.recv(65536)
        connection.send(as_bytes(too_many_connections()))
        connection.shutdown(socket.SHUT_WR)


def connections_for(wanted: int) -> int:
    """Raise the limit of descriptors; return how many connections it allows, at most ``wanted``."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft != hard:
        with suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
            soft = hard
    if soft == resource.RLIM_INFINITY:
        return wanted
    return max(1, min(wanted, soft - _open_descriptors() - _KEPT_DESCRIPTORS))


def _open_descriptors() -> int:
    try:
        return len(list(Path("/proc/self/fd").iterdir()))
    except OSError:
        return 0
