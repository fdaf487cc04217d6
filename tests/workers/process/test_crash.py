"""Whatever is killed, every job is solved exactly once, and nothing is left running."""

import os
import signal

import pytest

from service.jobs.queue import Lane
from service.jobs.records import AttemptOutcome, JobState
from service.storage.jobs.rows import BEGUN
from tests.support.waiting import wait_until
from tests.workers.processes import stop_between_transactions

LEASE = 1.0
"""Lease of the workers in these tests."""
LONG = 3.0
"""Lease of those who take over: a busy machine may renew a short lease too late."""


@pytest.fixture
def log(tmp_path):
    return tmp_path / "log"


def children(log):
    """The processes that have begun with the job, in order."""
    return [int(pid) for pid in log.read_text().split()] if log.exists() else []


def state_of(jobs, job):
    return jobs.get(job.id).state


def outcomes(jobs, job):
    return [attempt.outcome for attempt in jobs.attempts(job.id)]


def test_a_killed_child_is_replaced_at_once(jobs, start_worker, log):
    job = jobs.submit({"chore": "sleep", "seconds": 1.0, "log": str(log)}, "digest")
    start_worker(lease_seconds=3600)
    wait_until(lambda: children(log))
    os.kill(children(log)[0], signal.SIGKILL)
    # Long before the lease ends.
    wait_until(lambda: state_of(jobs, job) is JobState.SUCCEEDED)
    assert outcomes(jobs, job) == [AttemptOutcome.LOST, AttemptOutcome.SUCCEEDED]
    # A busy worker may see the child dead before it reads that it took the call: no signal is told then.
    detail = jobs.attempts(job.id)[0].detail
    assert "SIGKILL" in detail or "died before it was known to run" in detail


def test_a_killed_worker_is_replaced_after_its_lease(jobs, start_worker, log):
    job = jobs.submit({"chore": "sleep", "seconds": 0.5, "log": str(log)}, "digest")
    first = start_worker(lease_seconds=LEASE)
    wait_until(lambda: children(log))
    first.kill()
    # What is to come back by the lease is not brought by anything that takes long.
    start_worker(lease_seconds=LONG, poll_seconds=3600)
    wait_until(lambda: state_of(jobs, job) is JobState.SUCCEEDED)
    assert outcomes(jobs, job) == [AttemptOutcome.RETURNED, AttemptOutcome.SUCCEEDED]
    returned, succeeded = jobs.attempts(job.id)
    assert (returned.ended_at - returned.started_at).total_seconds() >= LEASE
    assert succeeded.started_at >= returned.ended_at
    assert len(children(log)) == 2


def test_a_second_worker_takes_over_from_a_killed_one(jobs, start_worker, log):
    first = start_worker(lease_seconds=LEASE)
    job = jobs.submit({"chore": "sleep", "seconds": 0.5, "log": str(log)}, "digest")
    wait_until(lambda: children(log))
    start_worker(lease_seconds=LONG)
    first.kill()
    wait_until(lambda: state_of(jobs, job) is JobState.SUCCEEDED)
    assert len(children(log)) == 2


@pytest.mark.any_database
@pytest.mark.one_in(2)
@pytest.mark.parametrize("chore", ["spin", "sleep"])
def test_nothing_is_left_of_a_killed_worker(jobs, start_worker, log, chore):
    jobs.submit({"chore": chore, "seconds": 60, "log": str(log)}, "digest")
    worker = start_worker(slots=2)
    wait_until(lambda: children(log))
    assert len(worker.session()) >= 4  # itself, the fork server, two children
    worker.kill()
    wait_until(lambda: not worker.session())


@pytest.mark.any_database
def test_a_job_that_kills_every_child_is_given_up(jobs, start_worker, log):
    job = jobs.submit({"chore": "crash", "log": str(log)}, "digest")
    healthy = jobs.submit({"chore": "succeed"}, "another")
    start_worker(max_attempts=3)
    wait_until(lambda: jobs.get(healthy.id).is_finished)
    dead = wait_until(lambda: jobs.get(job.id).is_finished and jobs.get(job.id))
    assert (dead.state, dead.error["code"]) == (JobState.FAILED, "lost_worker")
    assert [attempt["outcome"] for attempt in dead.error["attempts"]] == ["lost"] * 3
    # A pool may notice the death of its child before the signal is known.
    assert any("SIGSEGV" in attempt["detail"] for attempt in dead.error["attempts"])
    assert len(children(log)) == 3
    assert state_of(jobs, healthy) is JobState.SUCCEEDED


@pytest.mark.any_database
def test_a_killed_idle_child_does_not_stop_the_worker(jobs, start_worker, log):
    first = jobs.submit({"log": str(log)}, "1")
    worker = start_worker()
    wait_until(lambda: jobs.get(first.id).is_finished)
    os.kill(children(log)[0], signal.SIGKILL)
    second = jobs.submit({"log": str(log)}, "2")
    wait_until(lambda: state_of(jobs, second) is JobState.SUCCEEDED)
    assert worker.process.poll() is None
    assert worker.terminate() == 0


@pytest.mark.any_database
def test_a_killed_fork_server_does_not_stop_the_worker(jobs, start_worker, log):
    first = jobs.submit({"log": str(log)}, "1")
    worker = start_worker()
    wait_until(lambda: jobs.get(first.id).is_finished)
    for pid in worker.session() - {worker.process.pid}:
        os.kill(pid, signal.SIGKILL)
    second = jobs.submit({"log": str(log)}, "2")
    wait_until(lambda: state_of(jobs, second) is JobState.SUCCEEDED)


def test_a_worker_that_slept_through_its_lease_does_not_finish_the_job(jobs, url, start_worker, log):
    job = jobs.submit({"chore": "sleep", "seconds": 2.0, "log": str(log)}, "digest")
    first = start_worker(lease_seconds=LEASE)
    wait_until(lambda: children(log))
    stop_between_transactions(first, url)
    start_worker(lease_seconds=LONG)
    wait_until(lambda: len(children(log)) == 2)
    # Its child has gone on and finishes; what it hands over is out of date.
    first.process.send_signal(signal.SIGCONT)
    wait_until(lambda: jobs.get(job.id).is_finished)
    assert outcomes(jobs, job) == [AttemptOutcome.RETURNED, AttemptOutcome.SUCCEEDED]
    assert first.terminate() == 0
    assert jobs.get(job.id).attempt == 2


@pytest.mark.long
@pytest.mark.any_database
def test_no_other_job_pays_for_the_one_at_which_workers_die(jobs, start_worker, log):
    problems = [{"number": number} for number in range(40)]
    # Late enough that its worker has others with it.
    problems[20] = {"chore": "sleep", "seconds": 3600.0, "log": str(log)}
    submitted = jobs.submit_many([(problem, str(k)) for k, problem in enumerate(problems)], lane=Lane.LIST)
    deadly, others = submitted[20], [*submitted[:20], *submitted[21:]]
    for deaths in range(1, 5):
        worker = start_worker(lease_seconds=LEASE, max_attempts=3)
        wait_until(lambda deaths=deaths: len(children(log)) == deaths)
        if deaths > 1:
            # It is computed alone, and its worker says that it has begun.
            wait_until(lambda: jobs.attempts(deadly.id)[-1].detail == BEGUN)
        worker.kill()
    start_worker(lease_seconds=LONG, max_attempts=3)
    wait_until(lambda: all(jobs.get(job.id).is_finished for job in submitted))
    assert jobs.get(deadly.id).error["code"] == "lost_worker"
    assert outcomes(jobs, deadly) == [AttemptOutcome.RETURNED, *[AttemptOutcome.LOST] * 3]
    assert {state_of(jobs, job) for job in others} == {JobState.SUCCEEDED}
    # When the others were lost with it, none was alone.
    assert not any(AttemptOutcome.LOST in outcomes(jobs, job) for job in others)
