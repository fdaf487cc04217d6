"""A job without a plain way waits for kernels as long as anybody may have them, then ends."""

from functools import partial

import pytest

from service.jobs.kernels import KERNELS, NEVER, WAITS, Kernels, NeedsKernelsError
from service.jobs.records import AttemptOutcome, JobState
from service.local.workers import WorkerProcess
from service.sandbox import SandboxMemoryError, SandboxTimeoutError
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.upkeep.presence import WorkerRegistry
from tests.support.databases import PROBLEM
from tests.support.sweeps import SWEEP
from tests.workers.process.together import LIMITS
from workers.process.results import LONG_WAIT_SECONDS, WAIT_SECONDS, Results
from workers.process.worker import Presence

pytestmark = pytest.mark.any_database

REFUSED = {"code": "accuracy_not_met", "detail": "it has 1e-9", "pointer": "/accuracy"}
FAULT = Kernels(0, KERNELS, None, "no disk")
LIMITED = {"time_limit": SandboxTimeoutError("the time limit passed")}
LIMITED["memory_limit"] = SandboxMemoryError("the memory limit was reached")


def pauses_of(jobs, monkeypatch):
    """Record how long jobs are made to wait, and let them be claimed at once."""
    pauses = []
    for name in ("give_back", "change_way"):

        def noted(real, *given, pause_seconds=0.0):
            pauses.append(pause_seconds)
            return real(*given)

        monkeypatch.setattr(jobs, name, partial(noted, getattr(jobs, name)))
    return pauses


def claimed(jobs):
    return jobs.claim("worker", lease_seconds=3600.0)


@pytest.mark.parametrize("outlook", ["there", "coming"])
def test_a_job_that_the_plain_way_refuses_is_queued_again_and_says_why(jobs, monkeypatch, outlook):
    pauses = pauses_of(jobs, monkeypatch)
    job = jobs.submit(PROBLEM, "digest")
    Results(jobs, LIMITS, lambda: outlook).record(claimed(jobs), NeedsKernelsError(REFUSED))
    (attempt,) = jobs.attempts(job.id)
    assert (attempt.outcome, attempt.detail) == (AttemptOutcome.RETURNED, WAITS)
    assert jobs.get(job.id).state is JobState.QUEUED
    assert pauses == [WAIT_SECONDS]


def test_where_nobody_will_have_kernels_it_ends_with_what_the_plain_way_says(jobs):
    job = jobs.submit(PROBLEM, "digest")
    Results(jobs, LIMITS, lambda: "never").record(claimed(jobs), NeedsKernelsError(REFUSED))
    done = jobs.get(job.id)
    assert (done.state, done.error) == (JobState.FAILED, {**REFUSED, "detail": f"it has 1e-9; {NEVER}"})
    # Kept nowhere: whoever asks again, perhaps where kernels are, is answered anew.
    assert jobs.submit(PROBLEM, "digest").state is JobState.QUEUED


@pytest.mark.parametrize("code", LIMITED)
@pytest.mark.parametrize(
    ("afterwards", "attempts"), [("there", 2), ("never", 2), ("coming", LIMITS.max_attempts)]
)
def test_what_goes_beyond_a_limit_without_kernels_is_tried_again_with_them(
    jobs, monkeypatch, code, afterwards, attempts
):
    pauses = pauses_of(jobs, monkeypatch)
    job = jobs.submit(PROBLEM, "digest")
    Results(jobs, LIMITS, lambda: "coming").record(claimed(jobs), LIMITED[code])
    assert (jobs.get(job.id).state, pauses) == (JobState.QUEUED, [LONG_WAIT_SECONDS])
    while (claim := claimed(jobs)) is not None:
        Results(jobs, LIMITS, lambda: afterwards).record(claim, LIMITED[code])
    done = jobs.get(job.id)
    assert (done.state, done.error["code"], done.attempt) == (JobState.FAILED, code, attempts)


@pytest.fixture
def sweep(jobs, database):
    """A sweep whose first chunk a worker without kernels has claimed."""
    registry = WorkerRegistry(database, lease_seconds=60.0)
    registry.see(WorkerProcess("worker", "here", "local", 1), is_warm=False, kernels=Kernels(1, 9, 30.0))
    return SweepStore(database).submit(SWEEP, points=9, most=9)


@pytest.mark.parametrize("fault", [NeedsKernelsError(REFUSED), *LIMITED.values()])
def test_a_plain_sweep_that_does_not_do_without_kernels_waits_for_them(
    jobs, database, sweep, monkeypatch, fault
):
    pauses_of(jobs, monkeypatch)
    claim = claimed(jobs)
    assert claim.way == "plain"
    Results(jobs, LIMITS, lambda: "coming").record(claim, fault)
    assert SweepStore(database).get(sweep.id).way == "compiled"
    assert (claimed(jobs).way, claimed(jobs)) == ("compiled", None)


def test_a_sweep_that_waits_in_vain_goes_the_plain_way_and_its_refusals_are_final(jobs, database, sweep):
    claim = claimed(jobs)
    jobs.change_way(claim, "compiled", WAITS)
    results = Results(jobs, LIMITS, lambda: "never")
    results.record(claimed(jobs), NeedsKernelsError())
    plain = claimed(jobs)
    assert (plain.way, plain.payload["waits"]) == ("plain", True)
    results.record(plain, NeedsKernelsError(REFUSED))
    final = claimed(jobs)
    assert (final.job_id, final.way, final.payload["waits"]) == (claim.job_id, "plain", False)


def test_kernels_will_be_there_as_long_as_some_worker_has_or_compiles_them(database):
    registry = WorkerRegistry(database, lease_seconds=3600.0)
    here, other = (
        Presence(registry, WorkerProcess(name, name, "postgres", 1), seconds=3600.0, alone=False)
        for name in "ab"
    )
    here.keep(is_warm=False, kernels=None)
    assert here.outlook() == "there"
    here.keep(is_warm=False, kernels=Kernels(1, 9, None))
    assert here.outlook() == "coming"
    here.keep(is_warm=True, kernels=FAULT)
    assert here.outlook() == "never"
    other.keep(is_warm=False, kernels=None)
    assert here.outlook() == "coming"
    other.keep(is_warm=True, kernels=FAULT)
    assert here.outlook() == "never"
    other.keep(is_warm=True, kernels=Kernels(5, 9, 3.0))
    assert here.outlook() == "coming"
    other.end()
    assert here.outlook() == "never"
