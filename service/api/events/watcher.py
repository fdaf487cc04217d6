"""Tells all streams of this process what one thread sees in the database.

It looks while anybody listens: at fixed intervals, since another machine may have
changed something, and when a message says that something was changed on this one.
A stream waits on the event loop and takes no thread. It keeps the latest state of its
job or sweep only, or its place among the recent events of the installation: who
reads slowly gets the latest state, not a backlog.
"""

import asyncio
import logging
from collections import deque
from collections.abc import AsyncGenerator, Callable, Iterator
from contextlib import aclosing, contextmanager, suppress
from typing import TypeVar, TypeVarTuple

from anyio import CapacityLimiter, to_thread

from service.api.events.poller import Lookout, Place, Subject, Surroundings, Told, end_of
from service.logs import Complaints, place_of
from service.storage.jobs.changes import SETTLED_SECONDS

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


logger = logging.getLogger(__name__)

LOOK_SECONDS = 0.5
"""Time between two looks without a message."""
GAP_SECONDS = 0.1
"""Time between two looks at least, however many messages come."""
LOOK_SHARE = 4.0
"""A look that took a second is followed by a pause of so many seconds at least."""
TOGETHER = 20
"""Streams that are woken in one turn of the event loop."""
WAIT_SECONDS = 5.0
"""A stream that has nothing to tell returns to its caller so often."""
PAGE = 200
"""Changes that a stream reads at once if it is behind."""

T = TypeVar("T")
Arguments = TypeVarTuple("Arguments")
_Sight = tuple[dict[Subject, Told | None], Surroundings | None]


class _Listener:
    """One stream, as the watcher sees it."""

    def __init__(self, subject: Subject | None) -> None:
        self.subject = subject
        self.latest: Told | None = None
        self.is_gone = False
        self.has_been_served = False
        """A look that began after it came has ended."""
        self.woken = asyncio.Event()


class EventWatcher:
    """Owns the look-out and the listeners. All but :meth:`wake` and :meth:`stop` are of one event loop."""

    def __init__(self, lookout: Lookout, *, capacity: int) -> None:
        self._lookout, self.capacity = lookout, capacity
        self._listeners: set[_Listener] = set()
        self._versions: dict[Subject, float] = {}
        self._recent = RecentEvents()
        self._looks_begun = self._looks_ended = 0
        self._status: Told | None = None
        self._looking, self._reading = CapacityLimiter(1), CapacityLimiter(1)
        self._at_work = asyncio.Lock()
        self._news = asyncio.Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._task: asyncio.Task[None] | None = None
        self._is_stopped = False
        self._is_failing = False
        self.complaints = Complaints(logger)

    def start(self) -> None:
        """Begin to look whenever somebody listens, on the running event loop."""
        self._loop = asyncio.get_running_loop()
        self._task = self._loop.create_task(self._run())

    async def close(self) -> None:
        """End all streams, and look no more."""
        self._end_streams()
        if self._task is not None:
            # Not in the middle of a look: its thread would go on with a connection of a closed database.
            async with self._at_work:
                self._task.cancel()
            with suppress(asyncio.CancelledError):
                await self._task

    def wake(self) -> None:
        """Look soon, since something was changed. From any thread."""
        # A new listener wakes it too. Without any, each submission would wake the event loop twice in vain.
        if self._listeners:
            self._from_any_thread(self._news.set)

    def stop(self) -> None:
        """End all streams: the service stops. From any thread, and from signal handlers."""
        self._from_any_thread(self._end_streams)

    def now(self) -> float:
        """Return the time of the database's clock: what changes from then on, a new stream tells."""
        return self._lookout.now()

    @property
    def is_full(self) -> bool:
        """No more streams are accepted."""
        return len(self._listeners) >= self.capacity

    async def follow(self, subject: Subject, last_id: str | None) -> AsyncGenerator[Told | None, None]:
        """Yield the states of a job or a sweep from the present one on, and its end.

        ``last_id`` is that of the last event that the client has. None is yielded whenever
        there is nothing to tell and the caller may do something else. If the service stops, the
        iteration ends without an end of the job or sweep.
        """
        sent = last_id
        with self._listening(subject) as listener:
            while not self._is_stopped:
                told = listener.latest
                if listener.is_gone:
                    yield end_of("deleted", 0.0)
                    return
                if told is None or told.id == sent:
                    yield None
                    if told is None or not told.is_final:
                        await _woken(listener)
                        continue
                else:
                    yield told
                    sent = told.id
                if told.is_final:
                    yield end_of("finished", told.at)
                    return

    async def follow_all(self, since: float, last_id: float | None) -> AsyncGenerator[Told | None, None]:
        """Yield the status, and all jobs and sweeps that changed after ``last_id``, or after ``since``.

        Both less some seconds. ``None`` means the same as in :meth:`follow`.
        """
        with self._listening(None) as listener:
            while not listener.has_been_served and not self._is_stopped:
                yield None
                await _woken(listener)
            place = self._recent.end
            at = since if last_id is None else min(since, last_id)
            if self._status is not None:
                yield self._status
            is_behind, ahead = True, ReadAhead()
            while not self._is_stopped:
                if is_behind:
                    place, is_behind = self._recent.end, False
                    async with aclosing(self._pages(at)) as pages:
                        async for told in pages:
                            ahead.add(told)
                            yield told
                            at = max(at, told.at)
                    ahead.end(self._looks_begun)
                while place < self._recent.end and not self._is_stopped:
                    found = self._recent.at(place)
                    if found is None:
                        is_behind = True
                        break
                    place += 1
                    if not ahead.is_ahead_of(found):
                        yield found
                        at = max(at, found.at)
                if not is_behind:
                    ahead.forget_if_passed(self._looks_ended)
                    yield None
                    if place == self._recent.end and not self._is_stopped:
                        await _woken(listener)
            yield end_of("stopping", at)

    async def _pages(self, at: float) -> AsyncGenerator[Told, None]:
        """Yield what changed after an instant, less what is not settled, page by page from the database."""
        place: Place | None = (at - SETTLED_SECONDS, None)
        while place is not None and not self._is_stopped:
            told, place = await to_thread.run_sync(self._lookout.page, place, PAGE, limiter=self._reading)
            for each in told:
                yield each

    @contextmanager
    def _listening(self, subject: Subject | None) -> Iterator[_Listener]:
        listener = _Listener(subject)
        self._listeners.add(listener)
        self._news.set()
        try:
            yield listener
        finally:
            self._listeners.discard(listener)

    async def _run(self) -> None:
        clock = asyncio.get_running_loop().time
        while True:
            while not self._listeners:
                self._lookout.forget()
                self._versions.clear()
                self._status = None
                self._news.clear()
                await self._news.wait()
            began = clock()
            async with self._at_work:
                await self._look()
            took = clock() - began
            least = max(GAP_SECONDS, LOOK_SHARE * took)
            await asyncio.sleep(least)
            if least < LOOK_SECONDS:
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._news.wait(), LOOK_SECONDS - least)

    async def _look(self) -> None:
        """Look once, and pass on what was seen; a look that fails is logged and made up for by the next."""
        self._looks_begun += 1
        try:
            await self._look_and_pass_on()
        finally:
            self._looks_ended += 1

    async def _look_and_pass_on(self) -> None:
        listeners = list(self._listeners)
        self._news.clear()
        subjects = {each.subject for each in listeners if each.subject is not None}
        # Who has just come is told the present state, whatever was told before.
        new = {each.subject for each in listeners if not each.has_been_served}
        known = {each: None if each in new else self._versions.get(each) for each in subjects}
        is_around = any(each.subject is None for each in listeners)
        try:
            told, around = await to_thread.run_sync(self._see, known, is_around, limiter=self._looking)
        except Exception as fault:  # whatever it is, the streams go on
            if not self._is_failing:
                said = "events: the database cannot be looked at"
                self.complaints.tell(said, fault, kind=place_of(fault), level=logging.ERROR)
            self._is_failing = True
            return
        self._is_failing = False
        await self._pass_on(listeners, told, around)

    def _see(self, known: dict[Subject, float | None], is_around: bool) -> _Sight:
        if not is_around:
            self._lookout.forget()
        return self._lookout.look_at(known), self._lookout.look_around() if is_around else None

    async def _pass_on(
        self,
        listeners: list[_Listener],
        told: dict[Subject, Told | None],
        around: Surroundings | None,
    ) -> None:
        before = self._recent.end
        for each in around.told if around is not None else ():
            self._recent.add(each)
        if around is not None:
            self._status = around.status
            if not around.is_complete:
                self._recent.skip()
        followed = {each.subject for each in listeners}
        self._versions |= {subject: each.at for subject, each in told.items() if each is not None}
        self._versions = {subject: at for subject, at in self._versions.items() if subject in followed}
        for k, listener in enumerate(listeners):
            if k % TOGETHER == TOGETHER - 1:
                await asyncio.sleep(0)  # other requests are not kept waiting for all streams
            is_new = not listener.has_been_served
            listener.has_been_served = True
            if listener.subject in told:
                listener.latest = told[listener.subject] or listener.latest
                listener.is_gone = told[listener.subject] is None
                listener.woken.set()
            elif is_new or (listener.subject is None and self._recent.end > before):
                listener.woken.set()

    def _end_streams(self) -> None:
        self._is_stopped = True
        for listener in self._listeners:
            listener.woken.set()

    def _from_any_thread(self, function: Callable[[], None]) -> None:
        # The loop may not run yet, or any more.
        if self._loop is not None:
            with suppress(RuntimeError):
                self._loop.call_soon_threadsafe(function)


async def _woken(listener: _Listener) -> None:
    with suppress(TimeoutError):
        await asyncio.wait_for(listener.woken.wait(), WAIT_SECONDS)
    listener.woken.clear()
