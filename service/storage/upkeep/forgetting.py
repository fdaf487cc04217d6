"""A thread that forgets the answers to requests with an Idempotency-Key after their day."""

import logging
import threading

from sqlalchemy.exc import SQLAlchemyError

from service.storage.keys.idempotency_store import IdempotencyStore

logger = logging.getLogger(__name__)

ROUND_SECONDS = 3600.0
"""How often a service looks for old answers. An old one that is still there is not given any more."""


class Forgetting:
    """Runs while a service does; several services may run it at once."""

    def __init__(self, store: IdempotencyStore) -> None:
        self._store = store
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._keep, name="forgetting", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop after the round that runs."""
        self._stopping.set()
        self._thread.join()

    def _keep(self) -> None:
        # Not at once: a service that is killed and started again and again has better things to do.
        while not self._stopping.wait(ROUND_SECONDS):
            try:
                self._store.forget_old()
            except SQLAlchemyError as fault:
                logger.warning("old answers could not be deleted: %s", type(fault).__name__)
