"""The bell between the API and the workers on the same machine.

A pair of connected sockets: one byte from the API says "look at the jobs
table", a line with a job's id from the worker says "this one is finished". It
only saves waiting; whatever is lost on it is found by looking, since the jobs
table is the truth.
"""

import asyncio
import contextlib
import socket
import threading
import time
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass

_LOOK_SECONDS = 0.25
"""How often a waiting client's job is looked up even if nobody rings: another machine may finish it."""


class Doorbell:
    """The API's side: rings workers, and waits for their jobs. Safe between threads."""

    def __init__(self) -> None:
        # Reentrant: a signal handler may close the bell while its thread holds the lock.
        self._lock = threading.RLock()
        self._lines: list[socket.socket] = []
        self._waiting: dict[str, set[_Ear]] = {}
        self._closed = False

    def new_line(self) -> socket.socket:
        """Return the worker's end of a new line.

        Hand its file descriptor to the worker process, then close it here: only
        so does either side notice that the other has died.
        """
        ours, theirs = socket.socketpair()
        with self._lock:
            self._lines.append(ours)
        threading.Thread(target=self._listen, args=(ours,), name="doorbell", daemon=True).start()
        return theirs

    def ring(self) -> None:
        """Wake every worker: there is a new job, or one was cancelled."""
        with self._lock:
            for line in self._lines:
                # A full buffer has rung often enough; a dead worker's line ends in its listener.
                with contextlib.suppress(OSError):
                    line.send(b".", socket.MSG_DONTWAIT)

    async def wait_for(
        self, job_id: str, *, is_finished: Callable[[], Awaitable[bool]], timeout: float
    ) -> bool:
        """Return whether the job is finished within ``timeout`` seconds; holds no thread meanwhile.

        ``is_finished`` asks the store; it is asked at once, whenever a worker
        says so, and now and then. A closed bell makes nobody wait.
        """
        deadline = time.monotonic() + timeout
        with self._registered(job_id) as heard:
            while not await is_finished():
                rest = deadline - time.monotonic()
                if rest <= 0 or self._closed:
                    return False
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(heard.wait(), min(rest, _LOOK_SECONDS))
                heard.clear()
        return True

    def announce(self, job_id: str) -> None:
        """Wake whoever waits for that job."""
        with self._lock:
            for ear in self._waiting.get(job_id, ()):
                ear.tell()

    def close(self) -> None:
        """Hang up: workers at the other ends finish what they have and stop, and nobody waits any more."""
        self._closed = True
        with self._lock:
            for ears in self._waiting.values():
                for ear in ears:
                    ear.tell()
            for line in self._lines:
                with contextlib.suppress(OSError):
                    line.shutdown(socket.SHUT_RDWR)

    @contextlib.contextmanager
    def _registered(self, job_id: str) -> Iterator[asyncio.Event]:
        """Register before the first look: an announcement in between would be missed else."""
        ear = _Ear(asyncio.get_running_loop(), asyncio.Event())
        with self._lock:
            self._waiting.setdefault(job_id, set()).add(ear)
        try:
            yield ear.heard
        finally:
            with self._lock:
                ears = self._waiting[job_id]
                ears.discard(ear)
                if not ears:
                    del self._waiting[job_id]

    def _listen(self, line: socket.socket) -> None:
        with line, line.makefile("r", encoding="ascii") as reader:
            with contextlib.suppress(OSError):
                for word in reader:
                    self.announce(word.strip())
            with self._lock:
                self._lines.remove(line)


@dataclass(frozen=True, eq=False)
class _Ear:
    """Somebody who waits on an event loop."""

    loop: asyncio.AbstractEventLoop
    heard: asyncio.Event

    def tell(self) -> None:
        """Wake it, from any thread."""
        # The loop may have been closed with the one who waited on it.
        with contextlib.suppress(RuntimeError):
            self.loop.call_soon_threadsafe(self.heard.set)


class WorkerLine:
    """The worker's side of one line, from the file descriptor it was started with."""

    def __init__(self, descriptor: int) -> None:
        self._socket = socket.socket(fileno=descriptor)
        self._socket.setblocking(False)

    def fileno(self) -> int:
        """Return the descriptor to select on."""
        return self._socket.fileno()

    def is_open(self) -> bool:
        """Swallow what has been rung; False if the API has gone."""
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
        """Say that a job is finished."""
        with contextlib.suppress(OSError):
            self._socket.sendall(job_id.encode("ascii") + b"\n")

    def close(self) -> None:
        """Hang up."""
        self._socket.close()
