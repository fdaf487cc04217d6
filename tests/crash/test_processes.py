"""Real workers and a real API, killed at their own commits one after the other."""

import random
import signal
import time
from http.client import HTTPException

import pytest

from service.jobs.queue import Lane
from service.jobs.records import JobState
from service.storage.database.database import Database
from service.storage.inspection.inspect import inspect
from service.storage.jobs.job_store import JobStore
from tests.crash.client import problem
from tests.support.databases import url_of
from tests.support.effort import seldom
from tests.support.lists import list_jobs
from tests.support.serving import serving
from tests.support.waiting import PATIENCE, wait_until
from tests.workers.processes import Worker

COMMITS = (1, 3, 5, 7)
"""Commits of a worker that announces itself, takes jobs of each kind below, keeps leases, and ends the jobs.

Killed before these on SQLite and after these on Postgres, it dies after 0 to 7
of its commits; each moment of each commit on both is seen elsewhere.
"""
CHORES = [{"chore": "sleep", "seconds": 0.6}, {"chore": "refuse"}, {"chore": "crash"}, {}]


def broken(database):
    return [finding.code for finding in inspect(database) if finding.broken]


def test_a_worker_may_die_at_any_of_its_commits(database, jobs, url):
    moment = "before" if url.startswith("sqlite") else "after"
    submitted = []
    for number in COMMITS:
        submitted += [jobs.submit(chore, f"{number} {chore}").id for chore in CHORES]
        worker = Worker(url, fault=f"commit:{moment}:{number}", max_attempts=1000)
        try:
            assert worker.process.wait(timeout=PATIENCE) == -signal.SIGKILL
            wait_until(lambda worker=worker: not worker.session())
        finally:
            worker.clean_up()
        assert broken(database) == []
    # What the last of them had is forgiven too. From now on a crash is to blame on its job.
    wait_until(
        lambda: not (jobs.reconcile(max_attempts=9999) or list_jobs(jobs, state=JobState.RUNNING).total)
    )
    worker = Worker(url, slots=2, max_attempts=1)
    try:
        wait_until(lambda: all(jobs.get(job_id).is_finished for job_id in submitted), 60.0)
        assert worker.terminate() == 0
    finally:
        worker.clean_up()
    assert broken(database) == []
    succeeded = sum(jobs.get(job_id).state is JobState.SUCCEEDED for job_id in submitted)
    codes = [jobs.get(job_id).error["code"] for job_id in submitted if jobs.get(job_id).error]
    assert set(codes) == {"no_motion", "lost_worker"}
    assert codes.count("no_motion") == len(COMMITS)
    assert succeeded + len(codes) == len(submitted)


@pytest.mark.long
def test_a_submit_without_an_answer_may_be_repeated(tmp_path):
    for moment, stored in (("before", 0), ("after", 1)):
        with serving(tmp_path, workers=0, POLHODE_FAULT=f"commit:{moment}:1") as service:
            assert service.call("GET", "/v1/jobs").document["total"] == 0
            with pytest.raises((OSError, HTTPException)):
                service.call("POST", "/v1/jobs", problem(1))
            assert service.process.wait(timeout=PATIENCE) == -signal.SIGKILL
        database = Database(url_of(tmp_path / "polhode.db"))
        assert list_jobs(JobStore(database)).total == stored
        database.close()
    with serving(tmp_path, workers=1) as service:
        # Whether it is there or not: whoever asks again gets the one solution.
        solution, _ = service.solve(problem(1))
        found = service.call("GET", "/v1/solutions").document
        assert [each["id"] for each in found["items"]] == [solution["id"]]
    database = Database(url_of(tmp_path / "polhode.db"))
    assert broken(database) == []
    assert {job.state for job in list_jobs(JobStore(database)).jobs} == {JobState.SUCCEEDED}
    database.close()


@pytest.mark.parametrize(("number", "kills"), [(100, 3), *seldom((2000, 50))])
def test_random_kills_of_workers_fail_no_job(database, jobs, url, number, kills):
    chance = random.Random(kills)
    problems = [({"chore": "sleep", "seconds": 0.02, "number": k}, str(k)) for k in range(number)]
    submitted = jobs.submit_many(problems, lane=Lane.LIST)

    def finished() -> int:
        live = (list_jobs(jobs, state=state).total for state in (JobState.QUEUED, JobState.RUNNING))
        return number - sum(live)

    for _ in range(kills):
        worker, before = Worker(url, slots=2, max_attempts=3), finished()
        try:
            # All jobs may have ended before the last kills.
            wait_until(lambda before=before: finished() > min(before, number - 1))
            time.sleep(chance.uniform(0.0, 0.1))  # the moment of the kill
        finally:
            worker.clean_up()
    worker = Worker(url, slots=2, max_attempts=3)
    try:
        # What was lost is computed one by one.
        wait_until(lambda: finished() == number, 10 * PATIENCE)
    finally:
        worker.clean_up()
    assert {jobs.get(job.id).state for job in submitted} == {JobState.SUCCEEDED}
    assert broken(database) == []
