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


class ReadAhead:
    """The states that one stream has read from the database itself, perhaps newer than those of a look.

    A look reads a state, the job changes, the stream reads the new state, and only then does the look
    pass on the old one: the stream must not go back to it.
    """

    def __init__(self) -> None:
        self._changed_at: dict[tuple[str, str], float] = {}
        self._looks = 0

    def add(self, told: Told) -> None:
        """Keep the instant of a state that the stream has read."""
        self._changed_at[told.name, told.subject_id] = told.at

    def end(self, looks_begun: int) -> None:
        """Only the first so many looks can be older than what was read."""
        self._looks = looks_begun

    def is_ahead_of(self, told: Told) -> bool:
        """Tell whether the stream has told a newer state already."""
        return self._changed_at.get((told.name, told.subject_id), told.at) > told.at

    def forget_if_passed(self, looks_ended: int) -> None:
        """Forget all, if the stream has read whatever those looks passed on."""
        if looks_ended >= self._looks:
            self._changed_at.clear()
