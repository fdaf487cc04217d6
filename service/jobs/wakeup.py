"""The bell between the API and the workers on the same machine.

A pair of connected sockets: one byte from the API says "look at the jobs
table", a line with a job's id from the worker says "this one is finished". It
only saves waiting; whatever is lost on it is found by looking, since the jobs
table is the truth.
"""

import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator

_LOOK_SECONDS = 0.25
"""How often a waiting client's job is looked up even if nobody rings: another machine may finish it."""


class Doorbell:
    """The API's side: rings workers, and waits for their jobs. Safe between threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._lines: list[socket.socket] = []
        self._waiting: dict[str, set[threading.Event]] = {}
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

    def wait_for(self, job_id: str, *, is_finished: Callable[[], bool], timeout: float) -> bool:
        """Return whether the job is finished within ``timeout`` seconds.

        ``is_finished`` asks the store; it is asked at once, whenever a worker
        says so, and now and then. A closed bell makes nobody wait.
        """
        deadline = time.monotonic() + timeout
        with self._registered(job_id) as finished:
            while not is_finished():
                rest = deadline - time.monotonic()
                if rest <= 0 or self._closed:
                    return False
                finished.wait(min(rest, _LOOK_SECONDS))
                finished.clear()
        return True

    def announce(self, job_id: str) -> None:
        """Wake whoever waits for that job."""
        with self._lock:
            for event in self._waiting.get(job_id, ()):
                event.set()

    def close(self) -> None:
        """Hang up: workers at the other ends finish what they have and stop, and nobody waits any more."""
        self._closed = True
        with self._lock:
            for events in self._waiting.values():
                for event in events:
                    event.set()
            for line in self._lines:
                with contextlib.suppress(OSError):
                    line.shutdown(socket.SHUT_RDWR)

    @contextlib.contextmanager
    def _registered(self, job_id: str) -> Iterator[threading.Event]:
        """Register before the first look: an announcement in between would be missed else."""
        event = threading.Event()
        with self._lock:
            self._waiting.setdefault(job_id, set()).add(event)
        try:
            yield event
        finally:
            with self._lock:
                events = self._waiting[job_id]
                events.discard(event)
                if not events:
                    del self._waiting[job_id]

    def _listen(self, line: socket.socket) -> None:
        with line, line.makefile("r", encoding="ascii") as reader:
            with contextlib.suppress(OSError):
                for word in reader:
                    self.announce(word.strip())
            with self._lock:
                self._lines.remove(line)


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
