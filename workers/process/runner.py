"""Claims jobs, computes them in killable children, renews leases, and stores results under the claim.

The runner never waits: the worker loop calls its steps, from one thread, when something
may have happened. No transaction is open while a child computes.
"""

import json
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import CancelledError, Future
from dataclasses import dataclass
from typing import TypedDict

from service.jobs.job import Claim, Taken
from service.jobs.lanes import Lane, LaneShares
from service.jobs.outcome import Outcome
from service.jobs.states import JobKind
from service.jobs.store import JobStore
from service.logs import about, call_about
from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError, result_of
from service.storage.database.availability import is_away

logger = logging.getLogger(__name__)

Computation = Callable[..., Outcome]
"""A module-level function from :attr:`Claim.payload`, as JSON text, to the outcome of the job.

If the windows of its curve are kept, their text comes second; an audit has the stored solution third.
"""
Computations = Mapping[JobKind, Computation]

START_SECONDS = 20.0
"""Limit for a child to take its job; starting a new child takes far less."""
WATCH_SECONDS = 0.2
"""How often to look for cancellations while a job runs."""
RECONCILE_SECONDS = 1.0
"""How often to look for expired leases."""


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


@dataclass(slots=True)
class _Run:
    """A claimed job that runs in a child."""

    claim: Claim
    was_owed: bool
    """It was taken out of order, since its lane was owed a job."""
    future: Future[Outcome]
    heartbeat_at: float
    began_at: float
    started_by: float
    """Latest time for a child to take it."""


class Runner:
    """Up to ``slots`` jobs at a time, each in a child process.

    Parameters
    ----------
    store, sandbox
        Where jobs come from, and where they run. The sandbox has ``slots`` children.
    computations
        The function for each kind of job.
    name
        Unique name of the worker.
    wake
        Called from another thread when a child is done, so that the loop calls :meth:`collect`.
    """

    def __init__(
        self,
        store: JobStore,
        sandbox: Sandbox,
        computations: Computations,
        *,
        name: str,
        slots: int,
        limits: JobLimits,
        wake: Callable[[], None],
    ) -> None:
        self._name = name
        self._store = store
        self._sandbox = sandbox
        self._computations = computations
        self._slots = slots
        self._limits = limits
        self._wake = wake
        self._runs: dict[str, _Run] = {}
        self._shares = LaneShares()
        self._reconcile_at = self._watch_at = 0.0

    @property
    def is_busy(self) -> bool:
        """Some job is claimed."""
        return bool(self._runs)

    def fill(self) -> list[str]:
        """Take jobs for the free slots; return the ids of those that are solved already."""
        finished: list[str] = []
        while free := self._slots - len(self._runs):
            owed = self._shares.owed()[:free]
            taken = self._store.take(self._name, free, lease_seconds=self._limits.lease_seconds, owed=owed)
            finished += self._begin(taken, owed)
            if taken == Taken():
                break
        return finished

    def collect(self, *, refill: bool) -> list[str]:
        """Store the results of finished jobs; return their ids.

        With ``refill`` the same transaction claims another job for each child.
        """
        done = [job_id for job_id, run in self._runs.items() if run.future.done()]
        finished = list(done)
        for job_id in done:
            # Removed only after the commit: during an outage of the database the result is kept here.
            owed = self._shares.owed()[: int(refill)]
            with about(**_fields(self._runs[job_id].claim)):
                taken = self._finish(self._runs[job_id], int(refill), owed)
            self._remove(job_id)
            # No job came, perhaps because none was asked for.
            finished += self._begin(taken, owed if taken != Taken() else ())
        return finished

    def keep_leases(self) -> None:
        """Send due heartbeats; kill the children whose claims are lost or cancelled."""
        if time.monotonic() < self._watch_at:
            return
        self._watch_at = time.monotonic() + WATCH_SECONDS
        held = self._store.held([run.claim for run in self._runs.values()])
        for job_id, run in list(self._runs.items()):
            holds = job_id in held
            if holds and time.monotonic() >= run.heartbeat_at:
                holds = self._store.heartbeat(run.claim, lease_seconds=self._limits.lease_seconds)
                run.heartbeat_at = self._next_heartbeat()
            if not holds:
                extra = {"fields": _fields(run.claim)}
                logger.info(
                    "job %s attempt %d: the claim was lost, stopping", job_id, run.claim.attempt, extra=extra
                )
                run.future.cancel()
                self._remove(job_id)
            elif not run.future.running() and not run.future.done() and time.monotonic() > run.started_by:
                extra = {"fields": _fields(run.claim)}
                logger.warning(
                    "job %s attempt %d: no child has taken it", job_id, run.claim.attempt, extra=extra
                )
                self._sandbox.renew(run.future)
                self._store.lose(run.claim, "no child took it", **self._limits.retries())
                self._remove(job_id)

    def reconcile(self) -> None:
        """At intervals, requeue the jobs of workers that are gone."""
        if time.monotonic() < self._reconcile_at:
            return
        for job_id in self._store.reconcile(**self._limits.retries()):
            logger.warning("job %s: its worker is gone", job_id, extra={"fields": {"job": job_id}})
        repaired = self._store.repair()
        if repaired:
            logger.warning("%d deliveries were lost; delivered again", repaired)
        self._reconcile_at = time.monotonic() + RECONCILE_SECONDS

    def give_back(self) -> None:
        """Kill the children and queue their jobs again."""
        for run in self._runs.values():
            run.future.cancel()
            self._store.give_back(run.claim)
        self._runs.clear()

    def _start(self, claim: Claim, *, was_owed: bool) -> None:
        compute = self._computations[claim.kind]
        audited = () if claim.audited is None else (claim.audited,)
        given = [json.dumps(claim.payload), *([claim.windows] if claim.windows or audited else ()), *audited]
        fields = {**_fields(claim), "worker": self._name}
        future = self._sandbox.submit(call_about, fields, compute, *given, seconds=self._limits.job_seconds)
        now = time.monotonic()
        self._runs[claim.job_id] = _Run(
            claim, was_owed, future, self._next_heartbeat(), now, now + START_SECONDS
        )
        self._shares.begin(claim.lane)
        future.add_done_callback(lambda _: self._wake())

    def _next_heartbeat(self) -> float:
        return time.monotonic() + self._limits.lease_seconds / 3

    def _remove(self, job_id: str) -> None:
        """Remove a run that has ended."""
        run = self._runs.pop(job_id)
        self._shares.end(run.claim.lane, time.monotonic() - run.began_at, was_owed=run.was_owed)

    def _begin(self, taken: Taken, owed: Sequence[Lane]) -> tuple[str, ...]:
        """Start the jobs to compute; return the ids of those solved already. ``owed`` lanes came first."""
        for claim in taken.claims:
            self._start(claim, was_owed=claim.lane in owed)
        for lane in owed:
            if all(claim.lane is not lane for claim in taken.claims):
                self._shares.forget(lane)
        return taken.reused

    def _finish(self, run: _Run, then_take: int, owed: Sequence[Lane]) -> Taken:
        try:
            outcome = result_of(run.future)
            kept, taken = self._store.finish(
                run.claim,
                outcome,
                then_take=then_take,
                lease_seconds=self._limits.lease_seconds,
                owed=owed,
            )
            if not kept:
                detail = "finished too late, discarded"
                logger.info("job %s attempt %d: %s", run.claim.job_id, run.claim.attempt, detail)
            return taken
        except SandboxCrashError as fault:
            logger.warning("job %s attempt %d: %s", run.claim.job_id, run.claim.attempt, fault)
            self._store.lose(run.claim, str(fault), **self._limits.retries())
        except SandboxTimeoutError:
            detail = f"not finished after {self._limits.job_seconds:g} s, the limit for one job"
            self._fail(run.claim, "time_limit", detail)
        except SandboxMemoryError:
            detail = f"needed more than {self._limits.memory_mb} MiB of memory, the limit for one job"
            self._fail(run.claim, "memory_limit", detail)
        except CancelledError:
            logger.info("job %s attempt %d: stopped", run.claim.job_id, run.claim.attempt)
        except Exception as fault:
            if is_away(fault):
                raise  # the result waits here until the database is back
            # A bug: it would only repeat itself, so there is no other attempt.
            logger.exception("job %s attempt %d", run.claim.job_id, run.claim.attempt)
            self._fail(run.claim, "internal_error", f"{type(fault).__name__}: {fault}")
        return Taken()

    def _fail(self, claim: Claim, code: str, detail: str) -> None:
        self._store.finish_failure(claim, {"code": code, "detail": detail})


def _fields(claim: Claim) -> dict[str, object]:
    """Return the log fields of a claim."""
    return {"job": claim.job_id, "attempt": claim.attempt}
