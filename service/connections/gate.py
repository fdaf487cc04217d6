"""Limits the number of connections, and chooses which to close when one more arrives."""

import logging
import time
from collections import OrderedDict
from collections.abc import Callable
from enum import IntEnum
from typing import Protocol

SECONDS_BETWEEN_LINES = 10.0
"""Least time between two log lines about refused connections."""


class Phase(IntEnum):
    """The phase of a connection; earlier phases are closed first to make room."""

    IDLE = 0
    """Nothing has been sent since the last answer, or since it was opened."""
    HEAD = 1
    """A part of a request's head has been sent."""
    BODY = 2
    """A part of a request's body has been sent."""
    ANSWER = 3
    """A request is complete: never closed to make room."""


class Closable(Protocol):
    """The protocol of a connection that the gate can close."""

    def give_up(self) -> None:
        """Close it at once."""


class Complaints:
    """Logs at most one line in so many seconds, and counts the suppressed ones."""

    def __init__(self, logger: logging.Logger, clock: Callable[[], float] = time.monotonic) -> None:
        self._logger, self._clock = logger, clock
        self._silent_until: dict[str, float] = {}
        self._kept_back: dict[str, int] = {}

    def tell(self, message: str) -> None:
        """Log the message as a warning, unless one was logged too recently."""
        now = self._clock()
        if now < self._silent_until.get(message, now):
            self._kept_back[message] = self._kept_back.get(message, 0) + 1
            return
        others = self._kept_back.pop(message, 0)
        self._silent_until[message] = now + SECONDS_BETWEEN_LINES
        self._logger.warning("%s%s", message, f" ({others} times more since the last line)" if others else "")


class Gate:
    """Counts connections. Used on the event loop's thread only.

    Parameters
    ----------
    capacity
        Connections that may be open.
    complaints
        Logs that there are too many.
    """

    def __init__(self, capacity: int, complaints: Complaints) -> None:
        self.capacity, self.complaints = capacity, complaints
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
        self.move(connection, Phase.ANSWER)

    def make_room(self) -> bool:
        """Tell whether one more may be accepted; close an old one if needed.

        Those that have waited longest go first: idle ones, then those whose
        request is not complete. Clients that wait for an answer are kept.
        """
        return len(self._open) < self.capacity or self.give_one_up()

    def give_one_up(self) -> bool:
        """Close one idle or incomplete connection; False if there is none."""
        for line in self._waiting.values():
            if line:
                connection = next(iter(line))
                self.leave(connection)
                connection.give_up()
                return True
        return False
