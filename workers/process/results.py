"""Stores what children have computed, and why they have not, under claims that it renews.

A batch is of claims that a pool computes by one call, one after the other; some wait for such a call.
"""

import logging
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass, field
from typing import TypedDict

from service.jobs.kernels import NEVER, WAITS, NeedsKernelsError, Outlook
from service.jobs.queue import BatchSize, Lane
from service.jobs.records import Claim, ClaimedJobs, JobKind, Outcome, SolveOutcome
from service.logs import Complaints, place_of
from service.sandbox import SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.storage.database.availability import is_away
from service.storage.jobs.job_store import JobStore
from workers.process.messages import RemoteFaultError, faults_text
from workers.process.pool import PoolBatch, ReturnedError

LEAST_SIZE_AHEAD = 8
"""Least batch size with which next batches are claimed before there are free children for them."""


class TakingTerms(TypedDict):
    """The terms on which further jobs are claimed."""

    lease_seconds: float
    starved: Sequence[Lane]
    together: int


class BatchSizes:
    """Numbers of jobs: those that a worker claims at a time, and those of them that one child gets.

    ``places`` tells how many jobs are computed at a time now.
    """

    def __init__(self, size: BatchSize, places: Callable[[], int], lease_seconds: float) -> None:
        self.size = size
        self._places, self._lease_seconds = places, lease_seconds
        self._is_last = False
        """The queue had fewer jobs than were asked for, the last time."""

    def terms(self, starved: Sequence[Lane], children: int = 1, waiting: int = 0) -> TakingTerms:
        """Return the terms of taking jobs for some free children, beside those that wait already.

        Of short ones also a batch for each child is taken, which waits until one has done its own.
        """
        batches = children + (self._places() if self.size.most >= LEAST_SIZE_AHEAD else 0)
        return {
            "lease_seconds": self._lease_seconds,
            "starved": starved,
            "together": max(1, self.size.most * batches // children - waiting),
        }

    def note(self, claimed: int, terms: TakingTerms) -> None:
        """Note how many problems were taken on some terms."""
        self._is_last = claimed < terms["together"]

    def share(self, number: int) -> int:
        """Return how many of so many problems a child gets: the last ones of a queue are shared out."""
        most = self.size.most
        if self._is_last:
            most = min(most, max(LEAST_SIZE_AHEAD, -(-number // max(1, self._places()))))
        return most


class Waiting:
    """Claimed jobs that no child computes at the moment, in the order in which children get them.

    Those that made trouble in a batch are computed alone.
    """

    def __init__(self) -> None:
        self._claims: deque[Claim] = deque()
        self._suspects: set[str] = set()
        """Ids of jobs that made trouble."""

    def __len__(self) -> int:
        return len(self._claims)

    def __iter__(self) -> Iterator[Claim]:
        return iter(self._claims)

    def add(self, claims: Sequence[Claim]) -> None:
        """Add jobs, behind the others."""
        self._claims.extend(claims)

    def suspect(self, claims: Sequence[Claim]) -> None:
        """Note that each of these is to be computed alone."""
        self._suspects |= {claim.job_id for claim in claims}

    def forget(self, job_id: str) -> None:
        """Forget that a job made trouble."""
        self._suspects.discard(job_id)

    def next(self, most: int) -> tuple[Claim, ...]:
        """Remove and return what the next child computes: one that made trouble alone, or others together."""
        first = self._claims.popleft()
        claims = [first]
        if first.job_id not in self._suspects:
            while self._claims and len(claims) < most and self._claims[0].job_id not in self._suspects:
                claims.append(self._claims.popleft())
        return tuple(claims)

    def keep(self, holds: Callable[[Claim], bool]) -> None:
        """Keep those for which this is true."""
        self._claims = deque([claim for claim in self._claims if holds(claim)])

    def unsuspected(self) -> list[Claim]:
        """Return those that made no trouble."""
        return [claim for claim in self._claims if claim.job_id not in self._suspects]


@dataclass(slots=True, eq=False)
class PoolRun:
    """Claimed jobs that a pool computes by one call."""

    claims: tuple[Claim, ...]
    """In the order in which they are computed."""
    starved: tuple[Lane, ...]
    """Lanes whose jobs were taken out of order, since they were starved one."""
    batch: PoolBatch
    is_alone: bool
    """It has one claim, and had no other."""
    lost: set[str] = field(default_factory=set)
    """Ids of jobs whose claims do not hold any more."""
    is_noted: bool = False
    """The store knows that its child has begun."""
    noted_share: float = 0.0
    """Share of its only job that is done, as the store knows."""
    is_followed: bool = False
    """Its place has been given another call, before these results are stored."""

    @property
    def held(self) -> list[Claim]:
        """The claims that hold, as far as is known."""
        return [claim for claim in self.claims if claim.job_id not in self.lost]

    @property
    def current(self) -> Claim | None:
        """The job that is computed now, or was when the child died."""
        begun = self.batch.begun
        return self.claims[begun - 1] if 0 < begun <= len(self.claims) else None

    @property
    def is_to_be_noted(self) -> bool:
        """A child has begun with a job that is to be alone, since an earlier worker was lost with it."""
        return self.claims[0].alone and self.batch.is_taken and not self.is_noted

    @property
    def is_in_vain(self) -> bool:
        """Nobody waits for what is computed now."""
        return not self.held or ((current := self.current) is not None and current.job_id in self.lost)

    def is_slow(self, begun_by: float) -> bool:
        """Whether jobs wait behind one of a batch that has taken long."""
        return self.batch.began_at < begun_by and 0 < self.batch.begun < len(self.claims)


def shared_out(claims: Sequence[Claim], children: int) -> Iterator[tuple[Claim, ...]]:
    """Return what each child gets: a chunk or an atlas has one to itself, problems share the rest.

    A problem that is to be computed alone has one to itself too.
    """
    problems, others = may_share(claims)
    yield from ((claim,) for claim in others)
    left = max(1, children - len(others))
    yield from (tuple(problems[start::left]) for start in range(min(left, len(problems))))


def may_share(claims: Sequence[Claim]) -> tuple[list[Claim], list[Claim]]:
    """Return the problems that one call may compute with others, and all else."""
    shares = [claim.kind is JobKind.SOLVE and not claim.alone for claim in claims]
    problems = [claim for claim, together in zip(claims, shares, strict=True) if together]
    return problems, [claim for claim, together in zip(claims, shares, strict=True) if not together]


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
