"""The first steps of every process and its end by SIGTERM or Ctrl-C (SIGINT); what makes starts short.

By the processor time that it saves:

* Garbage is collected seldom, here and in :mod:`service.gc_tuning` for fork servers: 0.7 s of 2.5 s of
  ``polhode serve``, 0.2 s of 0.8 s of a worker, 0.5 s of 1.8 s of its fork server, 0.1 s of 0.7 s of that for
  verdicts. Modules stay until a process ends, and the collector would read all objects again and again while
  they are loaded, and once more at the end.
* A fork server loads the libraries once, and compiled code too (:mod:`workers.process.preloaded`): 1.4 s for
  every child but the first.
* It loads late what first jobs seldom need (:mod:`workers.process.tasks`): first children come 0.4 s earlier.
* Children start before their parent loads the database, or the web framework (:mod:`workers.process.start`,
  :mod:`service.cli.server`): 0.4 s and 1.4 s of a second processor.

No handler of a signal raises an exception. Python runs handlers between any two steps of
the main thread: inside an import, a destructor, or a callback of the garbage
collector, where an exception is only printed and the program goes on. There
are two ways instead:

* :func:`end_at_once`, from the first line of a program on. The handler itself
  ends the process. That is as safe at any instant as SIGKILL must be: children
  notice that their parent is gone, and transactions are rolled back.
* :class:`StopAsked`, for loops that have to clean up first: the
  handler sets a flag, and the loop reads it.
"""

import atexit
import gc
import os
import signal
from collections.abc import Callable
from types import FrameType
from typing import NoReturn, Self

_YOUNG, _MIDDLE, _OLD = 50_000, 20, 20
"""Objects that are made before the youngest are looked through, and how often that is until older ones are.

With Python's 700 a process of 500 000 objects has looked through them many times before it is loaded. Objects
without references are freed at once all the same: this is about circles of references only.
"""


def collect_seldom() -> None:
    """Collect less often, and not at the end, when the system takes the memory back. Called first of all."""
    gc.set_threshold(_YOUNG, _MIDDLE, _OLD)
    atexit.register(gc.freeze)


def keep_what_is_loaded() -> None:
    """Never look through the objects again that are there now.

    In the child of a fork this also saves memory: to look through an object writes to the page that it is on,
    which would then be copied.
    """
    gc.freeze()


def use_one_thread() -> None:
    """Have numerical libraries use one thread, unless the environment says otherwise.

    Slots share the cores already, the stacks of idle threads would count as a job's memory, and the last
    digits of a product of matrices may depend on how it is divided.
    """
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")


STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)

_CLEAR_LINE_AND_SHOW_CURSOR = b"\r\x1b[2K\x1b[?25h"
"""A progress bar may have hidden the cursor of a terminal."""
_LINES = {signal.SIGINT: b"interrupted\n", signal.SIGTERM: b"stopped by SIGTERM\n"}


def end_at_once(*, is_service: bool) -> None:
    """End the process at the next signal, with one line on stderr; unblock signals that were held back.

    The exit code is 130 for Ctrl-C and 143 for SIGTERM, as shells use them, but 0
    for a service: SIGTERM is its regular end.
    """
    codes = {signal.SIGINT: 130, signal.SIGTERM: 0 if is_service else 143}

    def end(number: int, frame: FrameType | None) -> NoReturn:
        stop_signal = signal.Signals(number)
        try:
            os.write(2, (_CLEAR_LINE_AND_SHOW_CURSOR if os.isatty(2) else b"") + _LINES[stop_signal])
        finally:
            os._exit(codes[stop_signal])

    for number in STOP_SIGNALS:
        signal.signal(number, end)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOP_SIGNALS)


def hold_signals() -> None:
    """Hold signals back until the program that replaces this one calls :func:`end_at_once`."""
    signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)


class StopAsked:
    """A context in which a signal sets a flag instead of ending the process, and a second one says: at once.

    On exit the previous handlers are restored.
    """

    def __init__(self) -> None:
        self._signals = 0
        self._tell: Callable[[], None] | None = None
        self._urge: Callable[[], None] | None = None

    @property
    def is_asked(self) -> bool:
        """A signal has come."""
        return self._signals > 0

    def tell(self, listener: Callable[[], None]) -> None:
        """Call ``listener`` at the signal, or now if it has already come.

        It is called by the signal handler: it may take no lock and raise nothing.
        """
        self._tell = listener
        if self.is_asked:
            listener()

    def urge(self, listener: Callable[[], None]) -> None:
        """Call ``listener`` in the same way at the second signal, and at every further one."""
        self._urge = listener
        if self._signals > 1:
            listener()

    def __enter__(self) -> Self:
        self._before = {number: signal.signal(number, self._note) for number in STOP_SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._signals += 1
        listener = self._tell if self._signals == 1 else self._urge
        if listener is not None:
            listener()
