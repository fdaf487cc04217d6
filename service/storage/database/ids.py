"""Makes time-ordered UUIDs, version 7 of RFC 9562."""

import secrets
import threading
import time
import uuid

_TICKS_PER_MILLISECOND = 4096


class IdSource:
    """Ids that grow strictly within this process, and with the clock between processes.

    The 48 bits of milliseconds are followed by 12 bits of their fraction; two
    ids within one such tick of 0.24 µs, or after a clock was set back, take the
    next tick.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._last = 0

    def __call__(self) -> str:
        """Return a new id in the canonical text form."""
        with self._lock:
            tick = max(time.time_ns() * _TICKS_PER_MILLISECOND // 1_000_000, self._last + 1)
            self._last = tick
        milliseconds, fraction = divmod(tick, _TICKS_PER_MILLISECOND)
        value = milliseconds << 80 | 0x7 << 76 | fraction << 64 | 0b10 << 62 | secrets.randbits(62)
        return str(uuid.UUID(int=value))


new_id = IdSource()


def first_id(at: float) -> str:
    """Return the least id that could be made at an instant, in seconds since 1970, or later."""
    return str(uuid.UUID(int=int(at * 1000.0) << 80))


def is_id(text: str) -> bool:
    """Tell whether ``text`` is a UUID: a database with a UUID type fails on a query for any other text."""
    try:
        return str(uuid.UUID(text)) == text.lower()
    except ValueError:
        return False
