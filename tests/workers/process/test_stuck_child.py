"""A child that never takes its job: killed while it held its pipe's lock, or frozen."""

import os
import signal

import pytest

from service.jobs.records import AttemptOutcome, JobState
from service.sandbox import Sandbox
from tests.support.waiting import PATIENCE, wait_until
from tests.workers import chores
from workers.process import pool as pool_module
from workers.process.pool import ChildrenPool
from workers.process.results import JobLimits
from workers.process.runner import Runner

pytestmark = pytest.mark.any_database


@pytest.fixture
def sandbox():
    sandbox = Sandbox(1)
    sandbox.start()
    yield sandbox
    sandbox.close()


def test_its_job_goes_to_a_new_child(jobs, sandbox, monkeypatch, tmp_path):
    # Shorter than in earnest, and long enough for a new child on a busy machine.
    monkeypatch.setattr(pool_module, "START_SECONDS", 5.0)
    limits = JobLimits(
        lease_seconds=3600.0, job_seconds=3600.0, memory_mb=1000, max_attempts=3, retry_seconds=0
    )
    runner = Runner(jobs, ChildrenPool(sandbox, chores.CHORES, slots=1), name="worker", limits=limits)
    frozen = sandbox.run(os.getpid, seconds=PATIENCE)
    os.kill(frozen, signal.SIGSTOP)
    job = jobs.submit({"log": str(tmp_path / "log")}, "digest")

    def work() -> bool:
        runner.fill()
        runner.keep_leases()
        runner.collect(refill=False)
        return jobs.get(job.id).is_finished

    wait_until(work)
    assert jobs.get(job.id).state is JobState.SUCCEEDED
    assert [a.outcome for a in jobs.attempts(job.id)] == [AttemptOutcome.RETURNED, AttemptOutcome.SUCCEEDED]
