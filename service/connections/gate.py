"""Limits the number of connections, and chooses which to close when one more arrives."""

import time
from collections import OrderedDict
from collections.abc import Callable
from enum import IntEnum
from typing import Protocol

from service.logs import Complaints

UNREAD_SECONDS = 5.0
"""A client that has read nothing of its answer for so long may be cut off to make room."""


class Phase(IntEnum):
    """The phase of a connection; earlier phases are closed first to make room."""

    IDLE = 0
    """Nothing has been sent since the last answer, or since it was opened."""
    HEAD = 1
    """A part of a request's head has been sent."""
    BODY = 2
    """A part of a request's body has been sent."""
    ANSWER = 3
    """A request is complete: closed to make room only if its client does not read the answer."""


class Closable(Protocol):
    """The protocol of a connection that the gate can close."""

    @property
    def is_sending(self) -> bool:
        """Something that was written to it has not left yet."""

    def give_up(self) -> None:
        """Close it at once."""


class Gate:
    """Counts connections. Used on the event loop's thread only.

    Parameters
    ----------
    capacity
        Connections that may be open.
    complaints
        Logs that there are too many.
    """

    def __init__(
        self, capacity: int, complaints: Complaints, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.capacity, self.complaints, self._clock = capacity, complaints, clock
        self._unread: OrderedDict[Closable, float] = OrderedDict()
        """Connections whose clients do not read, with the instants since when."""
        self._open: set[Closable] = set()
        self._waiting: dict[Phase, OrderedDict[Closable, None]] = {
            phase: OrderedDict() for phase in (Phase.IDLE, Phase.HEAD, Phase.BODY)
        }

    def __len__(self) -> int:
        return len(self._open)

    def enter(self, connection: Closable) -> None:
        """Record a connection that has been accepted."""
        self._open.add(connection)
        self.move(connection, Phase.IDLE)

    def move(self, connection: Closable, phase: Phase) -> None:
        """Record the current phase of a connection."""
        for line in self._waiting.values():
            line.pop(connection, None)
        if phase in self._waiting and connection in self._open:
            self._waiting[phase][connection] = None

    def leave(self, connection: Closable) -> None:
        """Record that a connection is closed or closing."""
        self._open.discard(connection)
        self._unread.pop(connection, None)
        self.move(connection, Phase.ANSWER)

    def stop_flowing(self, connection: Closable) -> None:
        """Record that a client reads nothing for now of what is sent to it."""
        if connection in self._open:
            self._unread.setdefault(connection, self._clock())

    def flow(self, connection: Closable) -> None:
        """Record that it reads again."""
        self._unread.pop(connection, None)

    def make_room(self) -> bool:
        """Tell whether one more may be accepted; close an old one if needed.

        Those that have waited longest go first: idle ones, then those whose
        request is not complete, then those that do not read their answer. Clients
        that wait for an answer, or read it, are kept.
        """
        return len(self._open) < self.capacity or self.give_one_up()

    def give_one_up(self) -> bool:
        """Close one idle, incomplete or unread connection; False if there is none."""
        for line in self._waiting.values():
            # The end of an answer may still flow when its connection waits for the next request.
            connection = next((each for each in line if not each.is_sending), None)
            if connection is not None:
                self._close(connection)
                return True
        return self.close_one_unread()

    def close_one_unread(self) -> bool:
        """Close the connection whose client has not read for longest; False if all have lately."""
        connection, since = next(iter(self._unread.items()), (None, 0.0))
        if connection is None or self._clock() - since < UNREAD_SECONDS:
            return False
        self._close(connection)
        return True

    def _close(self, connection: Closable) -> None:
        self.leave(connection)
        connection.give_up()
