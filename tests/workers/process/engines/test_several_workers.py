"""Three workers on hosts whose clocks differ by two hours: every job is run once, whatever happens to it."""

from pathlib import Path

import pytest

from service.jobs.records import AttemptOutcome, JobState
from service.storage.database.database import Database
from service.storage.jobs.job_store import JobStore
from tests.support.waiting import is_alive, wait_until
from tests.workers.processes import network_apart

JOB_SECONDS = 4.0
"""Many times what a job takes to reach its limit of memory, on a busy machine too."""
LEASE = 2.5
"""A busy machine may renew a lease of a fraction of a second too late, and the job is lost once more."""


@pytest.fixture(scope="module", autouse=True)
def crew(installation):
    workers = [
        installation.start_worker(host, job_seconds=JOB_SECONDS, lease_seconds=LEASE) for host in (0, 1, 2)
    ]
    yield workers
    for worker in workers:
        assert worker.terminate() == 0


def finished(jobs, job):
    return wait_until(lambda: jobs.get(job.id).is_finished and jobs.get(job.id))


def outcomes(jobs, job):
    return [attempt.outcome for attempt in jobs.attempts(job.id)]


def runs(log):
    return [int(pid) for pid in log.read_text().split()] if log.exists() else []


def test_every_job_is_run_once_whoever_gets_it(installation, crew, jobs, submit, log):
    submitted = []

    def several_have_worked():
        some = [submit(chore="sleep", seconds=0.05) for _ in range(6)]
        assert {finished(jobs, job).state for job in some} == {JobState.SUCCEEDED}
        submitted.extend(some)
        return len({jobs.attempts(job.id)[0].worker for job in submitted}) == 3

    wait_until(several_have_worked)
    assert {tuple(outcomes(jobs, job)) for job in submitted} == {(AttemptOutcome.SUCCEEDED,)}
    assert len(runs(log)) == len(submitted)
    apart = installation.engine == "postgres" and network_apart()
    assert len({network_of(worker.process.pid) for worker in crew}) == (len(crew) if apart else 1)


def network_of(process):
    return Path(f"/proc/{process}/ns/net").readlink()


def test_a_job_that_is_announced_five_times_is_run_once(installation, jobs, submit, log):
    job = submit(chore="sleep", seconds=0.2)
    for _ in range(4):
        installation.announce_again()
    after = submit()
    assert finished(jobs, job).state is finished(jobs, after).state is JobState.SUCCEEDED
    assert (jobs.get(job.id).attempt, len(runs(log))) == (1, 2)


def test_a_job_that_nobody_announced_is_found_by_polling(installation, jobs):
    database = Database(installation.url)
    job = JobStore(database).submit({}, "not announced")
    database.close()
    assert (finished(jobs, job).state, jobs.get(job.id).attempt) == (JobState.SUCCEEDED, 1)


def test_a_job_longer_than_its_lease_is_kept_whatever_the_clocks_say(jobs, submit):
    submitted = [submit(chore="sleep", seconds=1.2 * LEASE) for _ in range(3)]
    assert [finished(jobs, job).state for job in submitted] == [JobState.SUCCEEDED] * 3
    for job in submitted:
        # A worker that took two of them, since those before were short, has given one back to the others.
        returned = [outcome for outcome in outcomes(jobs, job) if outcome is AttemptOutcome.RETURNED]
        assert outcomes(jobs, job) == [*returned, AttemptOutcome.SUCCEEDED]


@pytest.mark.parametrize(("chore", "code"), [("spin", "time_limit"), ("hog", "memory_limit")])
def test_a_limit_fails_the_job_for_good(jobs, submit, chore, code):
    job = submit(chore=chore)
    assert (finished(jobs, job).state, jobs.get(job.id).error["code"]) == (JobState.FAILED, code)
    assert outcomes(jobs, job) == [AttemptOutcome.FAILED]


def test_a_poison_job_stops_after_three_attempts_with_its_history(jobs, submit, log):
    dead = finished(jobs, submit(chore="crash"))
    assert (dead.state, dead.error["code"]) == (JobState.FAILED, "lost_worker")
    assert [attempt["outcome"] for attempt in dead.error["attempts"]] == ["lost"] * 3
    assert len(runs(log)) == 3
    first, second, third = jobs.attempts(dead.id)
    assert second.started_at >= first.ended_at
    # 0.1 s, a fifth less at the least.
    assert (third.started_at - second.ended_at).total_seconds() >= 0.08


def test_a_running_job_is_cancelled(installation, jobs, submit, log):
    job = submit(chore="spin")
    (child,) = wait_until(lambda: runs(log))
    assert jobs.cancel(job.id).state is JobState.CANCELLED
    installation.wake_up.notify()
    wait_until(lambda: not is_alive(child))
    assert outcomes(jobs, job) == [AttemptOutcome.CANCELLED]
