"""Wakes workers on the same machine when a job arrives, and waiting clients when one finishes.

A pair of connected sockets: one byte from the API means "look at the jobs table", a
line with a job's id from the worker means "this job is finished". It only shortens
waiting: a lost message is made up for by polling the jobs table, the source of truth.
"""

import asyncio
import contextlib
import socket
import threading
import time
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass

WARM = "warm"
"""The word that a worker sends in place of a job's id when it is warm."""
_LOOK_SECONDS = 0.25
"""How often a waiting client's job is looked up without a message: another machine may finish it."""
_REMEMBERED = 1000
"""Jobs that were reported last: one may have finished before its client began to wait."""


class WakeUpSocket:
    """The API's side: wakes workers, and waits for their jobs. Thread-safe.

    Parameters
    ----------
    is_database_ready
        False if the database is still to be migrated. The first message that a worker gets says that
        it is ready: see :meth:`tell_database_is_ready`.
    """

    def __init__(self, *, is_database_ready: bool = True) -> None:
        # Reentrant: a signal handler may call close() while its thread holds the lock.
        self._lock = threading.RLock()
        self._sockets: list[socket.socket] = []
        self._waiting: dict[str, set[_Waiter]] = {}
        self._reported: OrderedDict[str, None] = OrderedDict()
        self._closed = False
        self._is_database_ready = is_database_ready
        self._tell_warm: Callable[[], None] | None = None
        self._tell_news: Callable[[], None] | None = None
        self._tell_end: Callable[[], None] | None = None

    def when_anything(self, news: Callable[[], None], end: Callable[[], None]) -> None:
        """Call ``news`` at every message, and ``end`` at :meth:`close`; from any thread."""
        self._tell_news, self._tell_end = news, end

    def when_warm(self, tell: Callable[[], None]) -> None:
        """Call ``tell``, from another thread, whenever a worker is warm."""
        self._tell_warm = tell

    def tell_database_is_ready(self) -> None:
        """Tell all workers, and each that is started later, that they may use the database."""
        self._is_database_ready = True
        self.notify()

    def new_socket(self, heard: Callable[[], None] = lambda: None) -> socket.socket:
        """Return the worker's end of a new pair of sockets.

        Pass its file descriptor to the worker process, then close it here, so that
        each side notices when the other has died. ``heard`` is called, from another thread,
        at each word of that worker.
        """
        ours, theirs = socket.socketpair()
        with self._lock:
            self._sockets.append(ours)
            if self._is_database_ready:
                ours.send(b".")
        threading.Thread(target=self._listen, args=(ours, heard), name="wake-up", daemon=True).start()
        return theirs

    def notify(self) -> None:
        """Wake every worker: there is a new job, or one was cancelled."""
        with self._lock:
            for line in self._sockets:
                # A full buffer is wake-up enough; the thread that reads from a dead worker ends by itself.
                with contextlib.suppress(OSError):
                    line.send(b".", socket.MSG_DONTWAIT)
        self._report_news()

    async def wait_for(
        self,
        job_id: str,
        *,
        is_finished: Callable[[], Awaitable[bool]],
        timeout: float,
        is_new: bool = False,
    ) -> bool:
        """Return whether the job is finished within ``timeout`` seconds; blocks no thread.

        ``is_finished`` asks the store: at once, whenever a worker reports the job, and at regular
        intervals. A job that is ``is_new`` was queued by this process a moment ago: there is nothing to
        see of it yet, unless a worker has reported it already. After :meth:`close` nothing waits.
        """
        deadline = time.monotonic() + timeout
        with self._registered(job_id) as woken:
            looks = not is_new
            while True:
                if looks and await is_finished():
                    return True
                looks = True
                rest = deadline - time.monotonic()
                if rest <= 0 or self._closed:
                    return False
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(woken.wait(), min(rest, _LOOK_SECONDS))
                woken.clear()

    def announce(self, job_id: str) -> None:
        """Wake the clients that wait for that job."""
        with self._lock:
            self._reported[job_id] = None
            if len(self._reported) > _REMEMBERED:
                self._reported.popitem(last=False)
            for waiter in self._waiting.get(job_id, ()):
                waiter.tell()
        self._report_news()

    def _report_news(self) -> None:
        if self._tell_news is not None:
            self._tell_news()

    def close(self) -> None:
        """Close all sockets: the workers finish their jobs and stop, and waiting clients are released."""
        self._closed = True
        if self._tell_end is not None:
            self._tell_end()
        with self._lock:
            for waiters in self._waiting.values():
                for waiter in waiters:
                    waiter.tell()
            for each in self._sockets:
                with contextlib.suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)

    @contextlib.contextmanager
    def _registered(self, job_id: str) -> Iterator[asyncio.Event]:
        """Register for messages; one that has come already counts, so that none in between is missed."""
        waiter = _Waiter(asyncio.get_running_loop(), asyncio.Event())
        with self._lock:
            self._waiting.setdefault(job_id, set()).add(waiter)
            if job_id in self._reported:
                waiter.woken.set()
        try:
            yield waiter.woken
        finally:
            with self._lock:
                waiters = self._waiting[job_id]
                waiters.discard(waiter)
                if not waiters:
                    del self._waiting[job_id]

    def _listen(self, ours: socket.socket, heard: Callable[[], None]) -> None:
        with ours, ours.makefile("r", encoding="ascii") as reader:
            with contextlib.suppress(OSError):
                for word in map(str.strip, reader):
                    heard()
                    if word != WARM:
                        self.announce(word)
                    elif self._tell_warm is not None:
                        self._tell_warm()
            with self._lock:
                self._sockets.remove(ours)


@dataclass(frozen=True, eq=False)
class _Waiter:
    """A coroutine that waits on an event loop."""

    loop: asyncio.AbstractEventLoop
    woken: asyncio.Event

    def tell(self) -> None:
        """Wake it, from any thread."""
        # The loop may have been closed meanwhile.
        with contextlib.suppress(RuntimeError):
            self.loop.call_soon_threadsafe(self.woken.set)


class WorkerSocket:
    """The worker's side of a pair of sockets, from the file descriptor it was started with."""

    def __init__(self, descriptor: int) -> None:
        self._socket = socket.socket(fileno=descriptor)
        self._socket.setblocking(False)

    def fileno(self) -> int:
        """Return the descriptor to select on."""
        return self._socket.fileno()

    def is_open(self) -> bool:
        """Read and discard pending wake-ups; False if the API has closed its end."""
        try:
            while received := self._socket.recv(4096):
                if len(received) < 4096:
                    return True
        except BlockingIOError:
            return True
        except OSError:
            return False
        return False

    def tell(self, job_id: str) -> None:
        """Report that a job is finished."""
        with contextlib.suppress(OSError):
            self._socket.sendall(job_id.encode("ascii") + b"\n")

    def close(self) -> None:
        """Hang up."""
        self._socket.close()
