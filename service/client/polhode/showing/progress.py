"""A bar of progress for people: on terminals and in notebooks, nothing elsewhere."""

import sys
import time

from polhode.transport.terms import Progress

_WIDTH = 30
_LEAST_SECONDS = 0.2
"""Between two drawings, and before the first: what is over at once needs no bar."""


class Bar:
    """Draws how far something is on one line of stderr."""

    def __init__(self) -> None:
        self._began: float | None = None
        self._first, self._drawn, self._is_shown = 0, 0.0, False

    def __call__(self, progress: Progress) -> None:
        """Draw it, at most five times a second."""
        now = time.monotonic()
        if self._began is None:
            self._began, self._first, self._drawn = now, progress.done, now
        if progress.is_over:
            if self._is_shown:
                sys.stderr.write(f"\r{self._line(progress, now)}\n")
            # Ready for the next one.
            self._began, self._is_shown = None, False
        elif now - self._drawn > _LEAST_SECONDS:
            self._drawn, self._is_shown = now, True
            sys.stderr.write(f"\r{self._line(progress, now)}")
            sys.stderr.flush()

    def _line(self, progress: Progress, now: float) -> str:
        share = progress.done / max(progress.total, 1)
        bar = "█" * int(share * _WIDTH)
        seconds = now - (self._began or now)
        rate = (progress.done - self._first) / seconds if seconds > 0 else 0.0
        rest = progress.remaining_seconds
        if rest is None and rate > 0:
            rest = (progress.total - progress.done) / rate
        told = "" if rest is None or progress.is_over else f", {_span(rest)} left"
        done = f"{progress.done:,} of {progress.total:,} {progress.what}"
        return f"{bar:<{_WIDTH}} {share:4.0%} {done}, {rate:,.0f}/s{told}   "


def is_watched() -> bool:
    """Tell whether somebody sees what is written to stderr: on a terminal, or in a notebook."""
    return "ipykernel" in sys.modules or (sys.stderr is not None and sys.stderr.isatty())


def _span(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
