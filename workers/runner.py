"""Claim jobs, compute them in children that can be killed, keep the leases, finish behind the fence.

The runner never waits: an engine calls its steps when something may have
happened, from one thread. No transaction is open while a child computes.
"""

import json
import logging
import os
import secrets
import socket
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from dataclasses import dataclass

from sqlalchemy.exc import OperationalError

from service.jobs.job import Claim
from service.jobs.outcome import SolveOutcome
from service.jobs.store import JobStore
from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError, result_of

logger = logging.getLogger(__name__)

Computation = Callable[[str], SolveOutcome]
"""A module's function from a canonical problem document, as JSON text, to its outcome."""

START_SECONDS = 20.0
"""In which a child takes a job it was given; a new child has then been started many times over."""
RECONCILE_SECONDS = 1.0
"""How often expired leases are looked for."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What one job may take, and how long a worker may be silent."""

    lease_seconds: float
    job_seconds: float
    memory_mb: int
    max_attempts: int


@dataclass(slots=True)
class _Run:
    """A claimed job at work in a child."""

    claim: Claim
    future: Future[SolveOutcome]
    heartbeat_at: float
    started_by: float
    """When a child should have taken it at the latest."""


class Runner:
    """Up to ``slots`` jobs at a time, each in a child process.

    Parameters
    ----------
    store, sandbox
        Where jobs come from, and where they run. The sandbox has ``slots`` children.
    computation
        What a job computes.
    wake
        Called, from another thread, when a child is done: time for :meth:`collect`.
    """

    def __init__(
        self,
        store: JobStore,
        sandbox: Sandbox,
        computation: Computation,
        *,
        slots: int,
        limits: Limits,
        wake: Callable[[], None],
    ) -> None:
        self.name = f"{socket.gethostname()[:64]}:{os.getpid()}:{secrets.token_hex(4)}"
        self._store = store
        self._sandbox = sandbox
        self._computation = computation
        self._slots = slots
        self._limits = limits
        self._wake = wake
        self._runs: dict[str, _Run] = {}
        self._reconcile_at = 0.0

    @property
    def is_busy(self) -> bool:
        """Some job is claimed."""
        return bool(self._runs)

    def fill(self) -> list[str]:
        """Claim jobs for the free slots; return the ids of those that need no computing any more."""
        finished = []
        while len(self._runs) < self._slots:
            claim = self._store.claim(self.name, lease_seconds=self._limits.lease_seconds)
            if claim is None:
                break
            if self._store.reuse(claim):
                finished.append(claim.job_id)
                continue
            document = json.dumps(claim.problem)
            future = self._sandbox.submit(self._computation, document, seconds=self._limits.job_seconds)
            deadline = time.monotonic() + START_SECONDS
            self._runs[claim.job_id] = _Run(claim, future, self._next_heartbeat(), deadline)
            future.add_done_callback(lambda _: self._wake())
        return finished

    def collect(self) -> list[str]:
        """Store what the children have finished; return the ids of those jobs."""
        done = [job_id for job_id, run in self._runs.items() if run.future.done()]
        for job_id in done:
            # Removed only afterwards: if the database is away, the result waits here.
            self._finish(self._runs[job_id])
            del self._runs[job_id]
        return done

    def keep_leases(self) -> None:
        """Send the heartbeats that are due; kill the children of claims that are lost or cancelled."""
        held = self._store.held([run.claim for run in self._runs.values()])
        for job_id, run in list(self._runs.items()):
            holds = job_id in held
            if holds and time.monotonic() >= run.heartbeat_at:
                holds = self._store.heartbeat(run.claim, lease_seconds=self._limits.lease_seconds)
                run.heartbeat_at = self._next_heartbeat()
            if not holds:
                logger.info("job %s attempt %d: the claim is gone, stopping", job_id, run.claim.attempt)
                run.future.cancel()
                del self._runs[job_id]
            elif not run.future.running() and not run.future.done() and time.monotonic() > run.started_by:
                logger.warning("job %s attempt %d: no child has taken it", job_id, run.claim.attempt)
                self._sandbox.renew(run.future)
                self._store.lose(run.claim, "no child took it", max_attempts=self._limits.max_attempts)
                del self._runs[job_id]

    def reconcile(self) -> None:
        """Now and then, queue again the jobs of workers that are gone, whoever they were."""
        if time.monotonic() < self._reconcile_at:
            return
        for job_id in self._store.reconcile(max_attempts=self._limits.max_attempts):
            logger.warning("job %s: its worker is gone", job_id)
        self._reconcile_at = time.monotonic() + RECONCILE_SECONDS

    def give_back(self) -> None:
        """Kill the children and queue their jobs again."""
        for run in self._runs.values():
            run.future.cancel()
            self._store.give_back(run.claim)
        self._runs.clear()

    def _next_heartbeat(self) -> float:
        return time.monotonic() + self._limits.lease_seconds / 3

    def _finish(self, run: _Run) -> None:
        try:
            outcome = result_of(run.future)
            self._store_outcome(run.claim, outcome)
        except SandboxCrashError as fault:
            logger.warning("job %s attempt %d: %s", run.claim.job_id, run.claim.attempt, fault)
            self._store.lose(run.claim, str(fault), max_attempts=self._limits.max_attempts)
        except SandboxTimeoutError:
            detail = f"not finished after {self._limits.job_seconds:g} s, the limit for one job"
            self._fail(run.claim, "time_limit", detail)
        except SandboxMemoryError:
            detail = f"needed more than {self._limits.memory_mb} MiB of memory, the limit for one job"
            self._fail(run.claim, "memory_limit", detail)
        except CancelledError:
            logger.info("job %s attempt %d: stopped", run.claim.job_id, run.claim.attempt)
        except OperationalError:
            raise  # the database is away: try again later
        except Exception as fault:
            # A fault of ours. It would only repeat itself, hence no other attempt.
            logger.exception("job %s attempt %d", run.claim.job_id, run.claim.attempt)
            self._fail(run.claim, "internal_error", f"{type(fault).__name__}: {fault}")

    def _store_outcome(self, claim: Claim, outcome: SolveOutcome) -> None:
        if outcome.error is not None:
            kept = self._store.finish_failure(claim, outcome.error)
        elif outcome.summary is not None:
            kept = self._store.finish_success(
                claim, outcome.summary, dense=outcome.dense, samples=outcome.samples
            )
        else:
            raise ValueError("the computation returned neither a summary nor an error")
        if not kept:
            logger.info("job %s attempt %d: finished too late, thrown away", claim.job_id, claim.attempt)

    def _fail(self, claim: Claim, code: str, detail: str) -> None:
        self._store.finish_failure(claim, {"code": code, "detail": detail})
