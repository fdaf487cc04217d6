"""Renews the leases of claimed jobs: each is prolonged when a third of it is over."""

import logging
import time
from collections.abc import Iterable

from service.jobs.records import Claim
from service.jobs.store import JobStore
from workers.process.results import extra_of

logger = logging.getLogger(__name__)


class Leases:
    """When the leases of a worker's claims are due."""

    def __init__(self, store: JobStore, lease_seconds: float) -> None:
        self._store, self._seconds = store, lease_seconds
        self.due: dict[str, float] = {}
        """Instants by the ids of jobs, on the clock of :func:`time.monotonic`."""

    def begin(self, claims: Iterable[Claim]) -> None:
        """Renew the leases of these claims from now on."""
        for claim in claims:
            self.due.setdefault(claim.job_id, self._next())

    def forget(self, claim: Claim) -> None:
        """Renew its lease no more."""
        self.due.pop(claim.job_id, None)

    def still_holds(self, claim: Claim, held: frozenset[str]) -> bool:
        """Renew a lease that is due; say whether the claim holds: whether its job is among the ``held``."""
        holds = claim.job_id in held
        if holds and time.monotonic() >= self.due[claim.job_id]:
            holds = self._store.heartbeat(claim, lease_seconds=self._seconds)
            self.due[claim.job_id] = self._next()
        if not holds:
            logger.info(
                "job %s attempt %d: the claim was lost, stopping",
                claim.job_id,
                claim.attempt,
                extra=extra_of(claim),
            )
        return holds

    def _next(self) -> float:
        return time.monotonic() + self._seconds / 3
