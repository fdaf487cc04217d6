"""HTTP/1.1 with deadlines: closes connections of clients that send or read too slowly."""

import asyncio
import sys
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any  # Any: what an application keeps

import h11
from uvicorn.config import Config
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from service.api.replies.pieces import PART_BYTES
from service.connections.gate import Gate, Phase
from service.connections.refusals import as_bytes, malformed, too_slow


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
