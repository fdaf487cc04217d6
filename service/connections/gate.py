"""How many connections there may be, and which are closed when one more comes."""

import logging
import time
from collections import OrderedDict
from collections.abc import Callable
from enum import IntEnum
from typing import Protocol

SECONDS_BETWEEN_LINES = 10.0
"""How often the log says again that connections are refused, however many."""


class Phase(IntEnum):
    """What a connection is at, in the order in which connections are given up."""

    IDLE = 0
    """Nothing has been sent since the last answer, or since it was opened."""
    HEAD = 1
    """A part of a request's head has been sent."""
    BODY = 2
    """A part of a request's body has been sent."""
    ANSWER = 3
    """A request is complete: never given up for others."""


class Closable(Protocol):
    """A connection, as the gate knows it."""

    def give_up(self) -> None:
        """Close it at once."""


class Complaints:
    """Writes at most one line in so many seconds, and says how many others there would have been."""

    def __init__(self, logger: logging.Logger, clock: Callable[[], float] = time.monotonic) -> None:
        self._logger, self._clock = logger, clock
        self._silent_until: dict[str, float] = {}
        self._kept_back: dict[str, int] = {}

    def tell(self, message: str) -> None:
        """Write the message as a warning, unless it was written a moment ago."""
        now = self._clock()
        if now < self._silent_until.get(message, now):
            self._kept_back[message] = self._kept_back.get(message, 0) + 1
            return
        others = self._kept_back.pop(message, 0)
        self._silent_until[message] = now + SECONDS_BETWEEN_LINES
        self._logger.warning("%s%s", message, f" ({others} times more since the last line)" if others else "")


class Gate:
    """Counts connections. Used by the event loop's thread alone.

    Parameters
    ----------
    capacity
        Connections that may be open.
    complaints
        Where it is told that there are too many.
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
        """Note a connection that has been accepted."""
        self._open.add(connection)
        self.move(connection, Phase.IDLE)

    def move(self, connection: Closable, phase: Phase) -> None:
        """Note what a connection is at now."""
        for line in self._waiting.values():
            line.pop(connection, None)
        if phase in self._waiting and connection in self._open:
            self._waiting[phase][connection] = None

    def leave(self, connection: Closable) -> None:
        """Note that a connection is closed, or as good as closed."""
        self._open.discard(connection)
        self.move(connection, Phase.ANSWER)

    def make_room(self) -> bool:
        """Say whether one more may come; close an old one if that is needed.

        Those that have waited longest go first: idle ones, then those whose
        request is not complete. Whoever waits for an answer stays.
        """
        return len(self._open) < self.capacity or self.give_one_up()

    def give_one_up(self) -> bool:
        """Close one connection that can be spared; False if there is none."""
        for line in self._waiting.values():
            if line:
                connection = next(iter(line))
                self.leave(connection)
                connection.give_up()
                return True
        return False
