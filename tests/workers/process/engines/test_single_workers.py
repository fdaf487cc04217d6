"""Workers that start, are woken, stop, and are killed."""

import signal

from service.jobs.records import AttemptOutcome, JobState
from tests.support.waiting import PATIENCE, wait_until


def state_of(jobs, job):
    return jobs.get(job.id).state


def test_priority_comes_first_a_stop_waits_for_what_runs_and_a_notice_wakes(installation, jobs, submit, log):
    low, high, usual = submit(priority=-1), submit(priority=5, chore="sleep", seconds=0.6), submit()
    cancelled = jobs.cancel(submit(priority=9).id)
    first = installation.start_worker(poll_seconds=3600, lease_seconds=3600)
    wait_until(log.exists)
    first.process.send_signal(signal.SIGTERM)
    assert first.process.wait(timeout=PATIENCE) == 0
    states = [state_of(jobs, job) for job in (high, usual, low)]
    assert states == [JobState.SUCCEEDED, JobState.QUEUED, JobState.QUEUED]

    second = installation.start_worker(poll_seconds=3600, lease_seconds=3600)
    wait_until(lambda: state_of(jobs, low) is JobState.SUCCEEDED)
    assert jobs.get(usual.id).started_at < jobs.get(low.id).started_at

    # It looks once an hour, so somebody must have told it.
    for _ in range(3):
        told = submit()
        wait_until(lambda job=told: state_of(jobs, job) is JobState.SUCCEEDED)
    assert second.terminate() == 0
    assert installation.count("workers") == 0
    assert jobs.get(cancelled.id) == cancelled
    assert (cancelled.state, cancelled.attempt) == (JobState.CANCELLED, 0)


def test_the_job_of_a_killed_worker_waits_for_its_lease(installation, jobs, submit, log):
    job = submit(chore="sleep", seconds=0.3)
    first = installation.start_worker(1, lease_seconds=0.5)
    wait_until(log.exists)
    first.kill()
    # A busy machine may renew a short lease too late: whoever takes over has a long one.
    second = installation.start_worker(2, lease_seconds=3600)
    wait_until(lambda: state_of(jobs, job) is JobState.SUCCEEDED)
    returned, succeeded = jobs.attempts(job.id)
    assert (returned.outcome, succeeded.outcome) == (AttemptOutcome.RETURNED, AttemptOutcome.SUCCEEDED)
    assert (returned.ended_at - returned.started_at).total_seconds() >= 0.5
    assert succeeded.started_at >= returned.ended_at
    assert len(log.read_text().split()) == 2
    assert second.terminate() == 0


def test_what_is_left_after_the_grace_is_given_back_and_delivered_again(installation, jobs, submit, log):
    job = submit(chore="sleep", seconds=1.5)
    first = installation.start_worker(grace_seconds=0.1)
    wait_until(log.exists)
    assert first.terminate() == 0
    assert state_of(jobs, job) is JobState.QUEUED
    (claim,) = jobs.take("next", 1, lease_seconds=60).claims
    assert (claim.job_id, claim.attempt) == (job.id, 2)
    jobs.cancel(job.id)
