"""Claims jobs, has a pool compute them, renews leases, and stores results under the claim.

The runner never waits: the worker loop calls its steps, from one thread, when something
may have happened. No transaction is open while a job is computed.
"""

import json
import logging
import random
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import CancelledError

from service.jobs.kernels import Outlook
from service.jobs.queue import BATCH_SECONDS, BatchSize, Lane, LaneShares
from service.jobs.records import Claim, ClaimedJobs, JobKind, Refused, Solved
from service.logs import about
from service.sandbox import SandboxCrashError, SandboxTimeoutError
from service.storage.jobs.job_store import JobStore
from workers.process.pool import Pool, ReturnedError
from workers.process.results import (
    BatchSizes,
    JobLimits,
    Leases,
    PoolRun,
    Results,
    Waiting,
    extra_of,
    fields_of,
    may_share,
    shared_out,
)

logger = logging.getLogger(__name__)


WATCH_SECONDS = 0.2
"""How often to look for cancellations while a job runs."""
PROGRESS_SECONDS = 1.0
"""How often to store how far jobs are."""
RECONCILE_SECONDS = 1.0
"""How often to look for expired leases."""
_STOPPED, _SLOW, _STUCK = "the worker stopped", "a job before it took long", "no child took it"
"""Why jobs are queued again."""
_SOLVES = Solved, Refused


class Runner:
    """As many jobs at a time as a pool has places for.

    Parameters
    ----------
    store, pool
        Where jobs come from, and where they are computed.
    name
        Unique name of the worker.
    outlook
        Whether there are kernels for jobs that wait for them.
    """

    def __init__(
        self,
        store: JobStore,
        pool: Pool,
        *,
        name: str,
        limits: JobLimits,
        outlook: Callable[[], Outlook] = lambda: "there",
    ) -> None:
        self._name = name
        self._store = store
        self._pool = pool
        self._limits = limits
        self._runs: list[PoolRun] = []
        self._waiting = Waiting()
        self._waits_since = 0.0
        """When a child last began something, or a job last began to wait."""
        self._leases = Leases(store, limits.lease_seconds)
        self._results = Results(store, limits, outlook)
        self._batch_sizes = BatchSizes(BatchSize(), pool.places, limits.lease_seconds)
        self._shares = LaneShares(random.random())
        self._is_dry = False
        """Nothing was left in the queue when results were stored, a moment ago."""
        self._reconcile_at = self._watch_at = self._progress_at = 0.0

    @property
    def is_busy(self) -> bool:
        """Some job is claimed."""
        return bool(self._runs or self._waiting)

    def fill(self) -> list[str]:
        """Take jobs for the free slots; return the ids of those that are solved already."""
        finished: list[str] = []
        if self._is_dry and not self._waiting:
            # What is queued since then wakes the loop, or is found by the next poll.
            self._is_dry = False
            return finished
        while (free := self._free()) > 0:
            if self._waiting:
                self._start(self._next_waiting())
                continue
            starved = self._shares.starved()[:free]
            claimed = self._store.take(self._name, free, **self._batch_sizes.terms(starved, free))
            finished += self._begin(claimed, starved, free)
            if claimed == ClaimedJobs():
                break
        return finished

    def collect(self, *, refill: bool) -> list[str]:
        """Store the results of finished jobs; return their ids.

        With ``refill`` the same transaction claims other jobs for each child. A child that is to compute
        what waits already does so while the results are stored.
        """
        if not refill:
            self._return_waiting()
        finished: list[str] = []
        for run in [run for run in self._runs if run.batch.has_ended]:
            # Its place may be gone.
            follows = refill and not run.is_followed and self._free() >= 0
            if follows and self._waiting:
                run.is_followed = True
                self._start(self._next_waiting())
            # Removed only after the commit: during an outage of the database the results are kept here.
            then_take = int(follows and not run.is_followed and not self._waiting)
            starved = self._shares.starved()[:then_take]
            if run.is_alone:
                claimed = self._finish_alone(run, then_take, starved)
            else:
                claimed = self._finish_batch(run, then_take, starved)
            self._is_dry = claimed == ClaimedJobs()
            self._remove(run)
            waiting = {claim.job_id for claim in self._waiting}
            finished += (claim.job_id for claim in run.claims if claim.job_id not in waiting)
            if claimed is not None and claimed != ClaimedJobs():
                finished += self._begin(claimed, starved, 1)
        return finished

    def keep_leases(self) -> None:
        """Send due heartbeats; kill the children whose claims are lost or cancelled."""
        if time.monotonic() < self._watch_at:
            return
        self._watch_at = time.monotonic() + WATCH_SECONDS
        claims = [*self._waiting, *(claim for run in self._runs for claim in run.held)]
        held = self._leases.keep(claims)
        self._waiting.keep(lambda claim: claim.job_id in held)
        for run in list(self._runs):
            run.lost |= {claim.job_id for claim in run.held} - held
            if run.is_in_vain:
                self._drop(run)
            elif run.batch.is_stuck:
                run.batch.kill()
                for claim in run.held:
                    said = "job %s attempt %d: no child has taken it"
                    logger.warning(said, claim.job_id, claim.attempt, extra=extra_of(claim))
                self._store.give_back_all(run.held, _STUCK)
                self._remove(run)
            elif run.is_to_be_noted:
                self._store.note_begun(run.claims[0])
                run.is_noted = True
            elif run.is_slow(time.monotonic() - WATCH_SECONDS - BATCH_SECONDS):
                self._take_back(run)
        self._note_progress()
        if self._waiting and time.monotonic() > self._waits_since + WATCH_SECONDS + BATCH_SECONDS:
            self._return(self._waiting.unsuspected(), _SLOW)

    def _note_progress(self) -> None:
        """At intervals, store how far jobs are that tell it and are farther than is stored."""
        if time.monotonic() < self._progress_at:
            return
        self._progress_at = time.monotonic() + PROGRESS_SECONDS
        told = [(run, run.batch.share) for run in self._runs if run.held]
        news = [(run, share) for run, share in told if share > run.noted_share]
        if news:
            self._store.note_progress([(run.claims[0], share) for run, share in news])
        for run, share in news:
            run.noted_share = share

    def reconcile(self) -> None:
        """At intervals, requeue the jobs of workers that are gone."""
        if time.monotonic() < self._reconcile_at:
            return
        for job_id in self._store.reconcile(**self._limits.retries()):
            self._is_dry = False
            logger.warning("job %s: its worker is gone", job_id, extra={"fields": {"job": job_id}})
        self._reconcile_at = time.monotonic() + RECONCILE_SECONDS

    def give_back(self) -> None:
        """Kill the children and queue their jobs again."""
        for run in self._runs:
            run.batch.kill()
            self._store.give_back_all(run.held, _STOPPED)
        self._runs.clear()
        self._return_waiting()

    def _return_waiting(self) -> None:
        if self._waiting:
            self._return(list(self._waiting), _STOPPED)

    def _return(self, claims: Sequence[Claim], why: str) -> None:
        """Queue jobs again that wait here; others may compute them."""
        self._store.give_back_all(claims, why)
        returned = {claim.job_id for claim in claims}
        self._waiting.keep(lambda claim: claim.job_id not in returned)
        for claim in claims:
            self._waiting.forget(claim.job_id)
        self._is_dry = False

    def _wait(self, claims: Sequence[Claim]) -> None:
        self._waiting.add(claims)
        self._waits_since = time.monotonic()

    def _free(self) -> int:
        """Return how many places are free; one may have been given another call already."""
        return self._pool.places() - sum(not run.is_followed for run in self._runs)

    def _start(self, claims: tuple[Claim, ...], starved: Sequence[Lane] = ()) -> None:
        calls = [(self._told(claim), _arguments(claim)) for claim in claims]
        batch = self._pool.start(
            claims[0].kind, calls, seconds=self._limits.job_seconds, turn_seconds=BATCH_SECONDS
        )
        self._waits_since = time.monotonic()
        self._runs.append(PoolRun(claims, tuple(starved), batch, is_alone=len(claims) == 1))
        for claim in claims:
            self._shares.begin(claim.lane)

    def _told(self, claim: Claim) -> Mapping[str, object]:
        return {**fields_of(claim), "worker": self._name}

    def _remove(self, run: PoolRun) -> None:
        """Remove a run that has ended; those of its jobs that wait again keep their claims."""
        self._runs.remove(run)
        seconds = (time.monotonic() - run.batch.began_at) / len(run.claims)
        for claim in run.claims:
            self._shares.end(claim.lane, seconds, was_starved=claim.lane in run.starved)
        waiting = {claim.job_id for claim in self._waiting}
        for claim in run.claims:
            if claim.job_id not in waiting:
                self._waiting.forget(claim.job_id)

    def _begin(self, claimed: ClaimedJobs, starved: Sequence[Lane], children: int) -> tuple[str, ...]:
        """Start the jobs to compute; return the ids of those solved already. ``starved`` lanes came first.

        Problems beyond a batch for each child wait.
        """
        problems, others = may_share(claimed.claims)
        self._batch_sizes.note(len(problems), self._batch_sizes.terms(starved, children, len(self._waiting)))
        if self._waiting and not others:
            self._wait(problems)
            self._start(self._next_waiting(), starved)
        else:
            now = children * self._batch_sizes.share(len(problems))
            for claims in shared_out([*others, *problems[:now]], children):
                self._start(claims, starved)
            self._wait(problems[now:])
        for lane in starved:
            if all(claim.lane is not lane for claim in claimed.claims):
                self._shares.forget(lane)
        return claimed.reused

    def _next_waiting(self) -> tuple[Claim, ...]:
        return self._waiting.next(self._batch_sizes.share(len(self._waiting)))

    def _drop(self, run: PoolRun) -> None:
        """Kill a child that computes what nobody waits for; its other jobs are computed again."""
        run.batch.kill()
        self._wait(run.held)
        self._remove(run)

    def _take_back(self, run: PoolRun) -> None:
        """Queue the jobs again that wait behind a long one of their batch: others may compute them."""
        begun = run.batch.stop()
        self._batch_sizes.size.reset()
        self._is_dry = False
        behind = run.claims[begun:]
        self._store.give_back_all([claim for claim in behind if claim.job_id not in run.lost], _SLOW)
        run.claims = run.claims[:begun]
        for claim in behind:
            self._waiting.forget(claim.job_id)
            self._shares.end(claim.lane, 0.0, was_starved=claim.lane in run.starved)

    def _finish_alone(self, run: PoolRun, then_take: int, starved: Sequence[Lane]) -> ClaimedJobs | None:
        (claim,) = run.claims
        with about(**fields_of(claim)):
            if claim.kind is JobKind.SOLVE:
                self._batch_sizes.size.learn(1, run.batch.ended_at - run.batch.began_at)
            try:
                (outcome,) = run.batch.outcomes()
            except (Exception, CancelledError) as fault:
                self._results.record(claim, fault, has_begun=run.batch.begun > 0)
                return None
            assert outcome is not None
            return self._results.store(claim, outcome, then_take, self._batch_sizes.terms(starved))

    def _finish_batch(self, run: PoolRun, then_take: int, starved: Sequence[Lane]) -> ClaimedJobs | None:
        try:
            outcomes = run.batch.outcomes()
        except (Exception, CancelledError) as fault:
            self._break_up(run, fault)
            return None
        computed = [(c, o) for c, o in zip(run.claims, outcomes, strict=False) if isinstance(o, _SOLVES)]
        ended = [(claim, outcome) for claim, outcome in computed if claim.job_id not in run.lost]
        done = {claim.job_id for claim, _ in ended}
        again = [claim for claim in run.held if claim.job_id not in done]
        suspects = [c for c, o in zip(run.claims, outcomes, strict=False) if o is None]
        claimed = None
        if ended:
            terms = self._batch_sizes.terms(starved, waiting=len(again))
            claimed = self._results.store_all(ended, 0 if suspects else then_take, terms)
        self._waiting.suspect(suspects)
        self._wait(again)
        if suspects:
            self._batch_sizes.size.reset()
        elif outcomes:
            self._batch_sizes.size.learn(len(outcomes), run.batch.ended_at - run.batch.began_at)
        return claimed

    def _break_up(self, run: PoolRun, fault: BaseException) -> None:
        """Blame the job that its child was computing, and compute the others of the batch again."""
        if isinstance(fault, ReturnedError):
            self._store.give_back_all(run.held, str(fault))
            return
        current = run.current
        is_known = isinstance(fault, SandboxCrashError | SandboxTimeoutError)
        has_begun = run.batch.begun > 0
        blamed = [claim for claim in run.held if is_known and (claim is current or not has_begun)]
        for claim in blamed:
            self._results.record(claim, fault, has_begun=has_begun)
        again = [claim for claim in run.held if claim not in blamed]
        if not is_known:
            self._waiting.suspect(again)
        self._batch_sizes.size.reset()
        self._wait(again)


def _arguments(claim: Claim) -> tuple[object, ...]:
    """Return what the computation of a job gets."""
    audited = () if claim.audited is None else (claim.audited,)
    return json.dumps(claim.payload), *([claim.windows] if claim.windows or audited else ()), *audited
