"""Serves connections by uvicorn, with limits, deadlines, and refusals while all are taken."""

import asyncio
import errno
import json
import logging
import os
import resource
import socket
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import Any  # Any: what an address is depends on the family

import h11
import uvicorn
from fastapi import FastAPI
from uvicorn.config import Config
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from service.api.replies import MEDIA_TYPE, PART_BYTES, REQUEST_ID, ApiError, server_name
from service.connections.gate import Gate, Phase
from service.logs import Complaints
from service.settings import Settings
from service.storage.database.rows import new_id

BUSY_SECONDS = 1
"""Retry-After for clients that found no free connection."""


def as_bytes(error: ApiError) -> bytes:
    """Return a complete HTTP/1.1 answer that closes the connection."""
    request_id = new_id()
    content = json.dumps({**error.document(), "request_id": request_id}).encode("ascii")
    headers = {
        "Server": server_name(),
        REQUEST_ID: request_id,
        "Content-Type": MEDIA_TYPE,
        "Content-Length": str(len(content)),
        "Connection": "close",
        **error.headers,
    }
    head = f"HTTP/1.1 {error.status} {HTTPStatus(error.status).phrase}\r\n"
    return (head + "".join(f"{k}: {v}\r\n" for k, v in headers.items()) + "\r\n").encode("ascii") + content


def too_many_connections() -> ApiError:
    """Return the answer to a client when all connections are taken."""
    return ApiError(
        HTTPStatus.SERVICE_UNAVAILABLE,
        "too_many_connections",
        "all connections are taken by requests that are being answered; try again later",
        headers={"Retry-After": str(BUSY_SECONDS)},
    )


def too_slow(seconds: float) -> ApiError:
    """Return the answer to a request that was not complete in time."""
    return ApiError(
        HTTPStatus.REQUEST_TIMEOUT, "request_timeout", f"the request was not complete after {seconds:g} s"
    )


def malformed(status: int) -> ApiError:
    """Return the answer to bytes that are not an HTTP request."""
    detail = {
        HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE: "the head of the request is too long",
        HTTPStatus.NOT_IMPLEMENTED: "the only accepted transfer coding is chunked",
    }.get(HTTPStatus(status), "what was sent is not HTTP/1.1")
    return ApiError(status, "invalid_http", detail)


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


@dataclass(frozen=True, slots=True)
class Deadlines:
    """Seconds that a client may take."""

    head: float
    """For the head of a request, from its first byte on; and for that byte, from opening a connection on."""
    body: float
    """For the rest of a body that was answered without being read."""
    send: float
    """For reading any part of an answer."""


class WatchedProtocol(H11Protocol):
    """Uvicorn's protocol, which reports its phase to the gate. Made by :func:`watched`."""

    gate: Gate
    deadlines: Deadlines

    def __init__(
        self,
        config: Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        super().__init__(config, server_state, app_state, _loop)
        self._phase = Phase.ANSWER
        self._deadline: asyncio.TimerHandle | None = None
        self._send_deadline: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Register the connection and wait for a request."""
        super().connection_made(transport)
        # Of what is written no more than this and one part waits in memory for a client that does not read.
        transport.set_write_buffer_limits(PART_BYTES)
        self.gate.enter(self)
        self._enter(Phase.IDLE)
        self._deadline = self.loop.call_later(self.deadlines.head, self._expire)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._stop_timers()
        self.gate.leave(self)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Read data, and report the phase of the request."""
        if self._phase is Phase.IDLE:
            self._enter(Phase.HEAD)
        super().data_received(data)
        self._look()

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        super().on_response_complete()
        self._look()

    def pause_writing(self) -> None:
        """Start the deadline for a client that does not read."""
        super().pause_writing()
        self.gate.stop_flowing(self)
        if self._send_deadline is None:
            self._send_deadline = self.loop.call_later(self.deadlines.send, self.give_up)

    def resume_writing(self) -> None:
        """Stop that deadline: the client reads again."""
        super().resume_writing()
        self.gate.flow(self)
        if self._send_deadline is not None:
            self._send_deadline.cancel()
            self._send_deadline = None

    def send_400_response(self, msg: str) -> None:
        """Answer bytes that are not a valid request with a problem document."""
        status = getattr(sys.exc_info()[1], "error_status_hint", HTTPStatus.BAD_REQUEST)
        self.gate.complaints.tell("a client sent what is not HTTP/1.1")
        self._stop_timers()
        if self.cycle is not None and self.cycle.response_started and not self.cycle.response_complete:
            self.give_up()  # an answer is being sent: a second one would be read as a part of it
        else:
            self._end(as_bytes(malformed(status)))

    @property
    def is_sending(self) -> bool:
        """Something that was written has not left this process."""
        return self.transport.get_write_buffer_size() > 0

    def give_up(self) -> None:
        """Close the connection at once, even during an answer."""
        self._stop_timers()
        self.transport.abort()

    def _look(self) -> None:
        """Find the phase of the connection and set its deadline."""
        if self.transport.is_closing():
            return
        theirs = self.conn.their_state
        if theirs is h11.SEND_BODY:
            self._enter(Phase.BODY)
        elif theirs is h11.IDLE:
            self._enter(Phase.HEAD if self.conn.trailing_data[0] else Phase.IDLE)
        else:
            self._enter(Phase.ANSWER)

    def _enter(self, phase: Phase) -> None:
        answered = self.cycle is not None and self.cycle.response_complete
        if phase is self._phase and not (phase is Phase.BODY and answered and self._deadline is None):
            return
        self._phase = phase
        self.gate.move(self, phase)
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
        if phase is Phase.HEAD:
            self._deadline = self.loop.call_later(self.deadlines.head, self._expire)
        elif phase is Phase.BODY and answered:
            # An endpoint that reads the body sets its own deadline; nothing reads this body.
            self._deadline = self.loop.call_later(self.deadlines.body, self.give_up)

    def _expire(self) -> None:
        self._deadline = None
        if self._phase is Phase.IDLE:
            self.transport.close()
        else:
            self._end(as_bytes(too_slow(self.deadlines.head)))

    def _end(self, answer: bytes) -> None:
        if not self.transport.is_closing():
            self.transport.write(answer)
            self.transport.close()

    def _stop_timers(self) -> None:
        for timer in (self._deadline, self._send_deadline):
            if timer is not None:
                timer.cancel()
        self._deadline = self._send_deadline = None


def watched(gate: Gate, deadlines: Deadlines) -> type[WatchedProtocol]:
    """Return the class of the connections of one server."""
    return type("Connection", (WatchedProtocol,), {"gate": gate, "deadlines": deadlines})


logger = logging.getLogger(__name__)

FINISH_REQUESTS_SECONDS = 3
"""How long open requests may go on after a signal to stop."""
_ACCEPTED_AT_ONCE = 8
"""Connections accepted in one turn of the event loop; they are counted only after it."""
_TOLD_ALREADY = (
    "socket.accept() out of system resource",
    "Invalid HTTP request received.",
    "Unsupported upgrade request.",
)


def guarded(app: FastAPI, settings: Settings, opened: socket.socket) -> tuple[uvicorn.Config, Listener]:
    """Return what a server of ``app`` needs: its configuration, and the socket that ``opened`` becomes."""
    gate = Gate(connections_for(settings.max_connections), Complaints(logger))
    app.state.close_one_unread = gate.close_one_unread
    deadlines = Deadlines(
        head=settings.header_seconds, body=settings.body_seconds, send=settings.send_seconds
    )
    # The gate logs faults of clients at a limited rate; otherwise clients could fill the log.
    for name in ("asyncio", "uvicorn.error"):
        logging.getLogger(name).addFilter(lambda record: not str(record.msg).startswith(_TOLD_ALREADY))
    config = uvicorn.Config(
        app,
        http=watched(gate, deadlines),
        ws="none",
        loop="asyncio",
        access_log=False,
        log_config=None,
        server_header=False,
        backlog=_ACCEPTED_AT_ONCE,
        timeout_keep_alive=settings.idle_seconds,
        timeout_graceful_shutdown=FINISH_REQUESTS_SECONDS,
    )
    return config, Listener(gate, fileno=opened.detach())
