"""Handles SIGTERM and Ctrl-C (SIGINT) in all processes.

No handler raises an exception. Python runs handlers between any two steps of
the main thread: inside an import, a destructor, or a callback of the garbage
collector, where an exception is only printed and the program goes on. There
are two ways instead:

* :func:`end_at_once`, from the first line of a program on. The handler itself
  ends the process. That is as safe at any instant as SIGKILL must be: children
  notice that their parent is gone, and transactions are rolled back.
* :class:`StopAsked`, for loops that have to clean up first: the
  handler sets a flag, and the loop reads it.
"""

import os
import signal
from collections.abc import Callable
from types import FrameType
from typing import NoReturn, Self

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
