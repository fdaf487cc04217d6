"""Passes on to all streams of this process what one thread reads in the database.

It polls while anybody listens: at fixed intervals, since another machine may have
changed something, and when a message says that something was changed on this one.
A stream waits on the event loop and takes no thread. It keeps the latest state of its
job or sweep only, or its position among the recent events of the installation: who
reads slowly gets the latest state, not a backlog.
"""

import asyncio
import logging
from collections import deque
from collections.abc import AsyncGenerator, Callable, Iterator
from contextlib import aclosing, contextmanager, suppress
from typing import TypeVar, TypeVarTuple

from anyio import CapacityLimiter, to_thread

from service.api.events.poller import ChangePoller, Event, Position, Snapshot, Subject, end_of
from service.logs import Complaints, place_of
from service.storage.jobs.rows import SETTLED_SECONDS

MOST_EVENTS = 1000
MOST_BYTES = 4_000_000


class RecentEvents:
    """Keeps some events by their index in the order in which this process sent them.

    A reader that is further behind asks the database again.
    """

    def __init__(self, most_events: int = MOST_EVENTS, most_bytes: int = MOST_BYTES) -> None:
        self._most_events, self._most_bytes = most_events, most_bytes
        self._events: deque[Event] = deque()
        self._bytes = 0
        self.end = 0
        """The index of the next event."""

    def add(self, event: Event) -> None:
        """Keep one more event; forget the oldest ones."""
        self._events.append(event)
        self._bytes += len(event.data)
        self.end += 1
        while len(self._events) > self._most_events or self._bytes > self._most_bytes:
            self._bytes -= len(self._events.popleft().data)

    def skip(self) -> None:
        """Forget all: events were not made, and every reader asks the database again."""
        self._events.clear()
        self._bytes = 0
        self.end += 1

    def at(self, index: int) -> Event | None:
        """Return the event at an index before the end; None if it is no longer kept."""
        kept = index - (self.end - len(self._events))
        return self._events[kept] if kept >= 0 else None


class ReadAhead:
    """The states that one stream has read from the database itself, perhaps newer than those of a poll.

    A poll reads a state, the job changes, the stream reads the new state, and only then does the poll
    pass on the old one: the stream must not go back to it.
    """

    def __init__(self) -> None:
        self._changed_at: dict[tuple[str, str], float] = {}
        self._polls = 0

    def add(self, event: Event) -> None:
        """Keep the instant of a state that the stream has read."""
        self._changed_at[event.name, event.subject_id] = event.at

    def end(self, polls_begun: int) -> None:
        """Only the first so many polls can be older than what was read."""
        self._polls = polls_begun

    def is_ahead_of(self, event: Event) -> bool:
        """Tell whether the stream has sent a newer state already."""
        return self._changed_at.get((event.name, event.subject_id), event.at) > event.at

    def forget_if_passed(self, polls_ended: int) -> None:
        """Forget all, if the stream has read whatever those polls passed on."""
        if polls_ended >= self._polls:
            self._changed_at.clear()


logger = logging.getLogger(__name__)

POLL_SECONDS = 0.5
"""Time between two polls without a message."""
GAP_SECONDS = 0.1
"""Time between two polls at least, however many messages come."""
POLL_SHARE = 4.0
"""A poll that took a second is followed by a pause of so many seconds at least."""
TOGETHER = 20
"""Streams that are woken in one turn of the event loop."""
WAIT_SECONDS = 5.0
"""A stream that has nothing to tell returns to its caller so often."""
PAGE = 200
"""Changes that a stream reads at once if it is behind."""

T = TypeVar("T")
Arguments = TypeVarTuple("Arguments")
_Polled = tuple[dict[Subject, Event | None], Snapshot | None]


class _Listener:
    """One stream, as the watcher sees it."""

    def __init__(self, subject: Subject | None) -> None:
        self.subject = subject
        self.latest: Event | None = None
        self.is_gone = False
        self.has_been_served = False
        """A poll that began after it came has ended."""
        self.woken = asyncio.Event()


class EventWatcher:
    """Owns the poller and the listeners. All but :meth:`wake` and :meth:`stop` are of one event loop."""

    def __init__(self, poller: ChangePoller, *, capacity: int) -> None:
        self._poller, self.capacity = poller, capacity
        self._listeners: set[_Listener] = set()
        self._versions: dict[Subject, float] = {}
        self._recent = RecentEvents()
        self._polls_begun = self._polls_ended = 0
        self._status: Event | None = None
        self._polling, self._reading = CapacityLimiter(1), CapacityLimiter(1)
        self._at_work = asyncio.Lock()
        self._news = asyncio.Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._task: asyncio.Task[None] | None = None
        self._is_stopped = False
        self._is_failing = False
        self.complaints = Complaints(logger)

    def start(self) -> None:
        """Begin to poll whenever somebody listens, on the running event loop."""
        self._loop = asyncio.get_running_loop()
        self._task = self._loop.create_task(self._run())

    async def close(self) -> None:
        """End all streams, and poll no more."""
        self._end_streams()
        if self._task is not None:
            # Not in the middle of a poll: its thread would go on with a connection of a closed database.
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
        return self._poller.now()

    @property
    def is_full(self) -> bool:
        """No more streams are accepted."""
        return len(self._listeners) >= self.capacity

    async def follow(self, subject: Subject, last_id: str | None) -> AsyncGenerator[Event | None, None]:
        """Yield the states of a job or a sweep from the present one on, and its end.

        ``last_id`` is that of the last event that the client has. None is yielded whenever
        there is nothing to tell and the caller may do something else. If the service stops, the
        iteration ends without an end of the job or sweep.
        """
        sent = last_id
        with self._listening(subject) as listener:
            while not self._is_stopped:
                event = listener.latest
                if listener.is_gone:
                    yield end_of("deleted", 0.0)
                    return
                if event is None or event.id == sent:
                    yield None
                    if event is None or not event.is_final:
                        await _woken(listener)
                        continue
                else:
                    yield event
                    sent = event.id
                if event.is_final:
                    yield end_of("finished", event.at)
                    return

    async def follow_all(self, since: float, last_id: float | None) -> AsyncGenerator[Event | None, None]:
        """Yield the status, and all jobs and sweeps that changed after ``last_id``, or after ``since``.

        Both less some seconds. ``None`` means the same as in :meth:`follow`.
        """
        with self._listening(None) as listener:
            while not listener.has_been_served and not self._is_stopped:
                yield None
                await _woken(listener)
            index = self._recent.end
            at = since if last_id is None else min(since, last_id)
            if self._status is not None:
                yield self._status
            is_behind, ahead = True, ReadAhead()
            while not self._is_stopped:
                if is_behind:
                    index, is_behind = self._recent.end, False
                    async with aclosing(self._pages(at)) as pages:
                        async for event in pages:
                            ahead.add(event)
                            yield event
                            at = max(at, event.at)
                    ahead.end(self._polls_begun)
                while index < self._recent.end and not self._is_stopped:
                    found = self._recent.at(index)
                    if found is None:
                        is_behind = True
                        break
                    index += 1
                    if not ahead.is_ahead_of(found):
                        yield found
                        at = max(at, found.at)
                if not is_behind:
                    ahead.forget_if_passed(self._polls_ended)
                    yield None
                    if index == self._recent.end and not self._is_stopped:
                        await _woken(listener)
            yield end_of("stopping", at)

    async def _pages(self, at: float) -> AsyncGenerator[Event, None]:
        """Yield what changed after an instant, less what is not settled, page by page from the database."""
        position: Position | None = (at - SETTLED_SECONDS, None)
        while position is not None and not self._is_stopped:
            events, position = await to_thread.run_sync(
                self._poller.page, position, PAGE, limiter=self._reading
            )
            for each in events:
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
                self._poller.forget()
                self._versions.clear()
                self._status = None
                self._news.clear()
                await self._news.wait()
            began = clock()
            async with self._at_work:
                await self._poll()
            took = clock() - began
            least = max(GAP_SECONDS, POLL_SHARE * took)
            await asyncio.sleep(least)
            if least < POLL_SECONDS:
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._news.wait(), POLL_SECONDS - least)

    async def _poll(self) -> None:
        """Poll once, and pass on what was read; a poll that fails is logged and made up for by the next."""
        self._polls_begun += 1
        try:
            await self._poll_and_pass_on()
        finally:
            self._polls_ended += 1

    async def _poll_and_pass_on(self) -> None:
        listeners = list(self._listeners)
        self._news.clear()
        subjects = {each.subject for each in listeners if each.subject is not None}
        # Who has just come is sent the present state, whatever was sent before.
        new = {each.subject for each in listeners if not each.has_been_served}
        known = {each: None if each in new else self._versions.get(each) for each in subjects}
        polls_all = any(each.subject is None for each in listeners)
        try:
            changed, snapshot = await to_thread.run_sync(
                self._poll_in_thread, known, polls_all, limiter=self._polling
            )
        except Exception as fault:  # whatever it is, the streams go on
            if not self._is_failing:
                said = "events: the database cannot be read"
                self.complaints.tell(said, fault, kind=place_of(fault), level=logging.ERROR)
            self._is_failing = True
            return
        self._is_failing = False
        await self._pass_on(listeners, changed, snapshot)

    def _poll_in_thread(self, known: dict[Subject, float | None], polls_all: bool) -> _Polled:
        if not polls_all:
            self._poller.forget()
        return self._poller.poll_subjects(known), self._poller.poll() if polls_all else None

    async def _pass_on(
        self,
        listeners: list[_Listener],
        changed: dict[Subject, Event | None],
        snapshot: Snapshot | None,
    ) -> None:
        before = self._recent.end
        for each in snapshot.events if snapshot is not None else ():
            self._recent.add(each)
        if snapshot is not None:
            self._status = snapshot.status
            if not snapshot.is_complete:
                self._recent.skip()
        followed = {each.subject for each in listeners}
        self._versions |= {subject: each.at for subject, each in changed.items() if each is not None}
        self._versions = {subject: at for subject, at in self._versions.items() if subject in followed}
        for k, listener in enumerate(listeners):
            if k % TOGETHER == TOGETHER - 1:
                await asyncio.sleep(0)  # other requests are not kept waiting for all streams
            is_new = not listener.has_been_served
            listener.has_been_served = True
            if listener.subject in changed:
                listener.latest = changed[listener.subject] or listener.latest
                listener.is_gone = changed[listener.subject] is None
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
