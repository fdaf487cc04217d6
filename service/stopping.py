"""How a process is asked to stop, by SIGTERM or by Ctrl-C (SIGINT).

No handler raises an exception. Python runs handlers between any two steps of
the main thread: inside an import, a destructor, or a callback of the garbage
collector, where an exception is only printed and the program goes on. There
are two ways instead:

* :func:`end_at_once`, from the first line of a program on. The handler itself
  ends the process. That is safe at any instant, as SIGKILL has to be: children
  notice that their parent is gone, and transactions are rolled back.
* :class:`StopAsked`, for loops that have something to put in order first: the
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
    """End the process at the next signal, with one line on stderr; receive signals that were held back.

    The exit code is 130 for Ctrl-C and 143 for SIGTERM, as shells have it. A
    service that is told to terminate has nothing left undone: 0.
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
    """Whether somebody has asked this process to stop, while it is entered as a context.

    At its end the handlers are those from before.
    """

    def __init__(self) -> None:
        self.is_asked = False
        self._tell: Callable[[], None] | None = None

    def tell(self, listener: Callable[[], None]) -> None:
        """Call ``listener`` when asked, or now if it has happened already.

        It is called by the signal handler: it may take no lock and raise nothing.
        """
        self._tell = listener
        if self.is_asked:
            listener()

    def __enter__(self) -> Self:
        self._before = {number: signal.signal(number, self._note) for number in STOP_SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.is_asked = True
        if self._tell is not None:
            self._tell()
