"""Caches the API keys in the serving process, refreshed every two seconds, so that requests need no query."""

import logging
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import datetime, timedelta

from anyio import CapacityLimiter, to_thread
from sqlalchemy.exc import SQLAlchemyError

from service.jobs.keys import ApiKey
from service.logs import Complaints
from service.storage.keys.key_store import USED_SECONDS, KeyStore

_log = logging.getLogger(__name__)

FRESH_SECONDS = 2.0
"""Largest age of the cache: a created or revoked key is noticed after at most this time."""
SECOND_LOOK_SECONDS = 0.2
"""An unknown key makes the keys be read again if they are older than this."""


@dataclass(frozen=True, slots=True)
class Known:
    """All keys by their prefixes, as read at one instant."""

    keys: Mapping[str, ApiKey]
    now: datetime
    """The instant by the database's clock."""
    read_at: float
    """The same instant by the process's own clock."""


class KeyRing:
    """Looks keys up, and records their use. Thread-safe."""

    def __init__(self, store: KeyStore, clock: Callable[[], float] = time.monotonic) -> None:
        self._store, self._clock = store, clock
        self._lock = threading.Lock()
        self._complaints = Complaints(_log)
        self._known: Known | None = None
        self._noted: dict[str, float] = {}
        self._looking = CapacityLimiter(1)
        """A thread of its own, so that requests are authenticated although all other threads are busy."""
        self._notes = ThreadPoolExecutor(max_workers=1, thread_name_prefix="keys")

    async def known(self, max_age: float = FRESH_SECONDS) -> Known:
        """Return the keys as they were at most ``max_age`` seconds ago."""
        known = self._fresh(max_age)
        if known is not None:
            return known
        return await to_thread.run_sync(self._look, max_age, limiter=self._looking)

    def now(self, known: Known) -> datetime:
        """Estimate the database's clock from the last read, without a query."""
        return known.now + timedelta(seconds=self._clock() - known.read_at)

    def note_use(self, key: ApiKey) -> None:
        """Record the use of a key, once a minute, in a background thread."""
        now = self._clock()
        if now - self._noted.get(key.id, -USED_SECONDS) >= USED_SECONDS:
            self._noted[key.id] = now
            self._notes.submit(self._touch, key)

    def close(self) -> None:
        """Finish the writes in progress, and accept no more."""
        self._notes.shutdown(wait=True, cancel_futures=True)

    def _fresh(self, max_age: float) -> Known | None:
        known = self._known
        return known if known is not None and self._clock() - known.read_at <= max_age else None

    def _look(self, max_age: float) -> Known:
        with self._lock:
            known = self._fresh(max_age)
            if known is None:
                began = self._clock()
                found = self._store.all()
                known = Known({key.prefix: key for key in found.keys}, found.now, began)
                self._known = known
            return known

    def _touch(self, key: ApiKey) -> None:
        try:
            self._store.touch(key.id)
        except SQLAlchemyError:
            self._complaints.tell(f"the last use of key {key.prefix} could not be recorded", kind="use")
