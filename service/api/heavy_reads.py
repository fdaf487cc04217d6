"""Slots for reads that compute or build much, so that reading stops nobody.

Text is written under the interpreter's lock: more threads would not be faster, they would only take it from
all others. So few reads compute at the same time, and what they have made and is not sent yet is bounded.

- A slot is held while something is computed, not while it is sent: a client that does not read holds none.
- Keys take turns; without keys, connections do. Of each the parts of its answers come in their order.
- What waits to be sent has a budget of bytes, of which one key may use half. Where it is used up, the
  connection that has not read for longest is closed; if all read, the next answer is refused.
- If its client has gone, a read leaves the queue, or stops at its next statement, or in the midst of one.

All methods are called on the event loop.
"""

import asyncio
import contextvars
import ctypes
import gc
import sys
import threading
from collections import OrderedDict, deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from http import HTTPStatus
from typing import Any, TypeVar  # Any: a function of the C library

from service.api.replies import ApiError
from service.settings import Settings
from service.storage.database.database import WantedRead

T = TypeVar("T")

WAITING = 64
"""Answers that may wait for their first part; one key may use half of these positions."""
WAIT_SECONDS = 10.0
"""How long one waits at most."""
RETRY_SECONDS = 2
"""Retry-After of those that are refused."""
_SHARE = 2
_TIDY_SECONDS = 1.0
"""So long after a read free memory is given back."""
_ROOM_SECONDS = 0.05
"""Seconds in which the connection that was closed to make room lets go of what it held."""


@dataclass(frozen=True, slots=True)
class Reader:
    """The client that a read is counted for."""

    key_id: str | None
    connection: object = None
    """Without a key: its address."""


class HeavyReads:
    """The slots, and the budget.

    Parameters
    ----------
    make_room
        Closes a connection whose client does not read, if there is one; says whether it did.
    """

    def __init__(self, settings: Settings, *, make_room: Callable[[], bool] = lambda: False) -> None:
        self._free, self._budget = settings.reading_places, settings.reading_mb * 10**6
        self._make_room = make_room
        self._threads = ThreadPoolExecutor(settings.reading_places, thread_name_prefix="reading")
        self._queues: OrderedDict[Reader, deque[asyncio.Future[None]]] = OrderedDict()
        """The waiting reads, by the order of turns; the reader that was served last is at the end."""
        self._firsts: dict[Reader, int] = {}
        """How many answers wait for their first part."""
        self._held: dict[str | None, int] = {}
        """Bytes that wait to be sent, by key."""
        self._tidying: asyncio.TimerHandle | None = None

    def close(self) -> None:
        """Wait for what is being computed."""
        if self._tidying is not None:
            self._tidying.cancel()
        self._threads.shutdown(cancel_futures=True)

    @property
    def waiting(self) -> int:
        """Answers that wait for their first part."""
        return sum(self._firsts.values())

    @property
    def held(self) -> int:
        """Bytes that wait to be sent."""
        return sum(self._held.values())

    async def begin(self, reader: Reader, work: Callable[[], T]) -> T:
        """Return ``work()``, the first part of an answer.

        Raises
        ------
        ApiError
            503: too many wait, or its turn has not come in time.
        """
        if not self._free:
            own = sum(n for each, n in self._firsts.items() if each.key_id == reader.key_id)
            if self.waiting >= WAITING or (reader.key_id is not None and own >= WAITING // _SHARE):
                raise _busy("too many answers that take long wait to be made")
        self._firsts[reader] = self._firsts.get(reader, 0) + 1
        try:
            async with asyncio.timeout(WAIT_SECONDS):
                await self._turn(reader)
        except TimeoutError as fault:
            raise _busy("answers that take long are being made, and this one had no turn in time") from fault
        finally:
            self._firsts[reader] -= 1
            if not self._firsts[reader]:
                del self._firsts[reader]
        return await self._compute(work)

    async def go_on(self, reader: Reader, work: Callable[[], T]) -> T:
        """Return ``work()``, a further part of an answer: it is never refused."""
        await self._turn(reader)
        return await self._compute(work)

    async def hold(self, reader: Reader, size: int) -> Callable[[], None]:
        """Take ``size`` bytes of the budget; return what gives them back, which may be called twice.

        Raises
        ------
        ApiError
            503: too much waits to be sent. A single answer is accepted however large it is.
        """
        while not self._fits(reader, size):
            if not self._make_room():
                raise _busy("too much waits to be sent to clients that read slowly")
            await asyncio.sleep(_ROOM_SECONDS)
        key_id = reader.key_id
        self._held[key_id] = self._held.get(key_id, 0) + size
        is_held = True

        def release() -> None:
            nonlocal is_held
            if is_held:
                is_held = False
                self._release(key_id, size)

        return release

    def _fits(self, reader: Reader, size: int) -> bool:
        own = self._held.get(reader.key_id, 0)
        share = self._budget if reader.key_id is None else self._budget // _SHARE
        return (not own or own + size <= share) and (not self.held or self.held + size <= self._budget)

    def _release(self, key_id: str | None, size: int) -> None:
        self._held[key_id] -= size
        if not self._held[key_id]:
            del self._held[key_id]
        self._tidy_soon()

    async def _turn(self, reader: Reader) -> None:
        if self._free:
            self._free -= 1
            return
        turn: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._queues.setdefault(reader, deque()).append(turn)
        try:
            await turn
        except asyncio.CancelledError:
            if turn.done() and not turn.cancelled():
                self._leave()  # it was given a slot in the same moment
            raise

    def _leave(self) -> None:
        """Give a slot to the next one in turn."""
        while self._queues:
            reader, queue = self._queues.popitem(last=False)
            turn = queue.popleft()
            if queue:
                self._queues[reader] = queue
            if not turn.done():
                turn.set_result(None)
                return
        self._free += 1
        self._tidy_soon()

    async def _compute(self, work: Callable[[], T]) -> T:
        loop, reading = asyncio.get_running_loop(), WantedRead()
        context = contextvars.copy_context()
        try:
            computing: Future[T] = self._threads.submit(context.run, reading.run, work)
        except RuntimeError:
            self._leave()
            raise _busy("the service stops") from None

        def ended(_: Future[T]) -> None:
            with suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(self._leave)

        # The slot is free when the thread is, not when the client has gone.
        computing.add_done_callback(ended)
        try:
            return await asyncio.wrap_future(computing)
        except asyncio.CancelledError:
            threading.Thread(target=reading.end, name="ending", daemon=True).start()
            raise

    def _tidy_soon(self) -> None:
        if self._tidying is None:
            self._tidying = asyncio.get_running_loop().call_later(_TIDY_SECONDS, self._tidy)

    def _tidy(self) -> None:
        self._tidying = None
        threading.Thread(target=give_back_free_memory, name="tidying", daemon=True).start()


def give_back_free_memory() -> None:
    """Give memory that is free back to the system, which the allocators of C keep otherwise.

    Elsewhere than on glibc only what is referred to in a circle is freed.
    """
    gc.collect()  # by itself it is seldom done: see service.startup
    # It may be in the midst of being loaded.
    pool = getattr(sys.modules.get("pyarrow"), "default_memory_pool", None)
    if pool is not None:
        pool().release_unused()
    trim = _malloc_trim()
    if trim is not None:
        trim(0)


@cache
def _malloc_trim() -> Any:  # noqa: ANN401
    return getattr(ctypes.CDLL(None), "malloc_trim", None)


def _busy(detail: str) -> ApiError:
    headers = {"Retry-After": str(RETRY_SECONDS)}
    return ApiError(HTTPStatus.SERVICE_UNAVAILABLE, "busy", f"{detail}; try again later", headers=headers)
