"""Stores what children have computed, and why they have not, under claims that it renews."""

import logging
import time
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass
from typing import TypedDict

from service.jobs.kernels import NEVER, WAITS, NeedsKernelsError, Outlook
from service.jobs.records import Claim, ClaimedJobs, JobKind, Outcome, SolveOutcome
from service.logs import Complaints, place_of
from service.sandbox import SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.storage.database.availability import is_away
from service.storage.jobs.job_store import JobStore
from workers.process.batches import TakingTerms
from workers.process.messages import RemoteFaultError, faults_text
from workers.process.pool import ReturnedError

logger = logging.getLogger(__name__)


class _Retries(TypedDict):
    max_attempts: int
    retry_seconds: float


@dataclass(frozen=True, slots=True)
class JobLimits:
    """Limits of one job, and the length of a lease."""

    lease_seconds: float
    job_seconds: float
    memory_mb: int
    max_attempts: int
    retry_seconds: float

    def retries(self) -> _Retries:
        """Return the limits for lost jobs, for the store."""
        return {"max_attempts": self.max_attempts, "retry_seconds": self.retry_seconds}


class Leases:
    """The leases of a worker's claims: all are prolonged together when a third of one is over."""

    def __init__(self, store: JobStore, lease_seconds: float) -> None:
        self._store, self._seconds = store, lease_seconds
        self.due_at = 0.0
        """On the clock of :func:`time.monotonic`."""

    def keep(self, claims: Sequence[Claim]) -> frozenset[str]:
        """Prolong the leases if that is due; return the ids of the jobs whose claims hold."""
        if time.monotonic() < self.due_at:
            held = self._store.held(claims)
        else:
            held = self._store.heartbeat(claims, lease_seconds=self._seconds)
            self.due_at = time.monotonic() + self._seconds / 3
        for claim in claims:
            if claim.job_id not in held:
                said = "job %s attempt %d: the claim was lost, stopping"
                logger.info(said, claim.job_id, claim.attempt, extra=extra_of(claim))
        return held


WAIT_SECONDS = 5.0
"""After so long a job that waits for kernels is tried again ..."""
LONG_WAIT_SECONDS = 60.0
"""... and one that went beyond a limit without them."""


class Results:
    """Writes the ends of jobs into the store.

    A fault of the database that passes is raised: the result waits with the caller until it is back.
    """

    def __init__(self, store: JobStore, limits: JobLimits, outlook: Callable[[], Outlook]) -> None:
        self._store, self._limits, self._outlook = store, limits, outlook
        self._complaints = Complaints(logger)

    def store(self, claim: Claim, outcome: Outcome, then_take: int, terms: TakingTerms) -> ClaimedJobs | None:
        """Store the result of one job, and take others by the same commit.

        None if none were asked for: those of a result that cannot be stored are claimed by nobody.
        """
        try:
            kept, claimed = self._store.finish(claim, outcome, then_take=then_take, **terms)
        except Exception as fault:
            self.record(claim, fault)
            return None
        if not kept:
            _tell_too_late(claim)
        return claimed if then_take else None

    def store_all(
        self, ended: Sequence[tuple[Claim, SolveOutcome]], then_take: int, terms: TakingTerms
    ) -> ClaimedJobs | None:
        """Store the results of a batch, and take others by the same commit; None as in :meth:`store`."""
        try:
            held, claimed = self._store.finish_problems(ended, then_take=then_take, **terms)
        except Exception as fault:
            if is_away(fault):
                raise
            # One of them cannot be stored. Alone each tells whether it is the one.
            for claim, outcome in ended:
                self.store(claim, outcome, 0, terms)
            return None
        for claim, _ in ended:
            if claim.job_id not in held:
                _tell_too_late(claim)
        return claimed if then_take else None

    def record(self, claim: Claim, fault: BaseException, *, has_begun: bool = True) -> None:
        """Write why an attempt has no result."""
        if isinstance(fault, ReturnedError):
            logger.info("job %s attempt %d: %s", claim.job_id, claim.attempt, fault)
            self._store.give_back(claim, str(fault))
        elif isinstance(fault, NeedsKernelsError):
            self._wait_for_kernels(claim, fault)
        elif isinstance(fault, SandboxCrashError) or not has_begun:
            logger.warning("job %s attempt %d: %s", claim.job_id, claim.attempt, fault)
            self._store.lose(claim, str(fault), has_begun=has_begun, **self._limits.retries())
        elif (
            isinstance(fault, SandboxTimeoutError | SandboxMemoryError)
            and claim.attempt < self._limits.max_attempts
            and self._outlook() == "coming"
        ):
            # Perhaps it went the plain way, which takes more of both than kernels do. Not for ever: a machine
            # that is short of memory may never have them, and kernels may not do it either.
            self._give_back(claim, f"{fault}; {WAITS}", LONG_WAIT_SECONDS)
        elif isinstance(fault, SandboxTimeoutError):
            detail = f"not finished after {self._limits.job_seconds:g} s, the limit for one job"
            self._fail(claim, "time_limit", detail)
        elif isinstance(fault, SandboxMemoryError):
            detail = f"needed more than {self._limits.memory_mb} MiB of memory, the limit for one job"
            self._fail(claim, "memory_limit", detail)
        elif isinstance(fault, CancelledError):
            logger.info("job %s attempt %d: stopped", claim.job_id, claim.attempt)
        elif is_away(fault):
            raise fault
        else:
            # A bug: it would only repeat itself, so there is no other attempt.
            # A long list may consist of jobs that all meet it.
            said = f"job {claim.job_id} attempt {claim.attempt}"
            kind = str(fault) if isinstance(fault, RemoteFaultError) else place_of(fault)
            self._complaints.tell(said, fault, kind=kind, level=logging.ERROR)
            self._fail(claim, "internal_error", faults_text(fault))

    def _wait_for_kernels(self, claim: Claim, fault: NeedsKernelsError) -> None:
        """Queue a job again, or end it where nobody will have kernels: then the plain way is all there is."""
        if self._outlook() != "never":
            self._give_back(claim, str(fault), WAIT_SECONDS)
        elif claim.kind is JobKind.CHUNK:
            self._store.change_way(claim, "plain", NEVER)
        else:
            refusal = fault.refusal or {"code": "not_ready", "detail": WAITS}
            self._store.finish_failure(claim, {**refusal, "detail": f"{refusal['detail']}; {NEVER}"})

    def _give_back(self, claim: Claim, why: str, pause_seconds: float) -> None:
        """Queue a job again that waits for kernels; a sweep whose plain way does not do waits with it."""
        logger.info("job %s attempt %d: %s", claim.job_id, claim.attempt, why)
        if claim.way == "plain":
            self._store.change_way(claim, "compiled", why, pause_seconds=pause_seconds)
        else:
            self._store.give_back(claim, why, pause_seconds=pause_seconds)

    def _fail(self, claim: Claim, code: str, detail: str) -> None:
        self._store.finish_failure(claim, {"code": code, "detail": detail})


def fields_of(claim: Claim) -> dict[str, object]:
    """Return the log fields of a claim."""
    return {"job": claim.job_id, "attempt": claim.attempt}


def extra_of(claim: Claim) -> dict[str, object]:
    """Return what a line of the log about a claim has besides its text."""
    return {"fields": fields_of(claim)}


def _tell_too_late(claim: Claim) -> None:
    logger.info("job %s attempt %d: finished too late, discarded", claim.job_id, claim.attempt)
