"""The last events of the installation, for streams that read a little later than others."""

from collections import deque

from service.api.events.texts import Told

MOST_EVENTS = 1000
MOST_BYTES = 4_000_000


class RecentEvents:
    """Keeps some events by their place in the order in which this process told them.

    A reader that is further behind asks the database again.
    """

    def __init__(self, most_events: int = MOST_EVENTS, most_bytes: int = MOST_BYTES) -> None:
        self._most_events, self._most_bytes = most_events, most_bytes
        self._events: deque[Told] = deque()
        self._bytes = 0
        self.end = 0
        """The place of the next event."""

    def add(self, told: Told) -> None:
        """Keep one more event; forget the oldest ones."""
        self._events.append(told)
        self._bytes += len(told.data)
        self.end += 1
        while len(self._events) > self._most_events or self._bytes > self._most_bytes:
            self._bytes -= len(self._events.popleft().data)

    def skip(self) -> None:
        """Forget all: events were not made, and every reader asks the database again."""
        self._events.clear()
        self._bytes = 0
        self.end += 1

    def at(self, place: int) -> Told | None:
        """Return the event at a place before the end; None if it is no longer kept."""
        index = place - (self.end - len(self._events))
        return self._events[index] if index >= 0 else None
