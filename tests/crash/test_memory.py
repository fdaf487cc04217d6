"""Processes that the kernel kills for their memory: the job ends once, with its reason, and others go on."""

import contextlib
import os
from pathlib import Path

import pytest

from service.jobs.records import JobState
from service.storage.inspection.inspect import inspect
from tests.support.waiting import wait_until
from tests.workers.processes import Worker

pytestmark = pytest.mark.any_database

LIMIT_BYTES = 500 * 2**20
"""Memory of a worker with its children: twice what they have when idle."""
GROUPS = Path("/sys/fs/cgroup")


@pytest.fixture
def small_machine():
    """Return what a command begins with that runs in a control group with little memory."""
    is_one_hierarchy = (GROUPS / "cgroup.controllers").exists()
    group = (GROUPS if is_one_hierarchy else GROUPS / "memory") / f"polhode-{os.getpid()}"
    limits = ("memory.max", "memory.swap.max") if is_one_hierarchy else ("memory.limit_in_bytes", None)
    try:
        group.mkdir()
    except OSError:
        pytest.skip("only root can make a control group")
    try:
        try:
            (group / limits[0]).write_text(str(LIMIT_BYTES))
        except OSError:
            pytest.skip("this machine's control groups do not limit memory")
        with contextlib.suppress(OSError, TypeError):
            (group / limits[1]).write_text("0")
        yield ("sh", "-c", f'echo $$ > {group}/cgroup.procs && exec "$@"', "sh")
    finally:
        wait_until(lambda: not (group / "cgroup.procs").read_text())
        group.rmdir()


@pytest.mark.parametrize("max_attempts", [1, 2])
def test_a_job_that_takes_all_memory_of_the_machine_ends_once(
    database, jobs, url, small_machine, max_attempts
):
    greedy = jobs.submit({"chore": "hog"}, "greedy")
    modest = jobs.submit({}, "modest")
    # Its own limit is beyond what the machine has: so the kernel must decide.
    settings = {"max_attempts": max_attempts, "job_memory_mb": 100_000, "begins_with": small_machine}
    workers = [Worker(url, **settings)]
    try:

        def are_finished():
            if workers[-1].process.poll() is not None:
                # The kernel may choose the worker instead of its child.
                workers.append(Worker(url, **settings))
            return all(jobs.get(job.id).is_finished for job in (greedy, modest))

        wait_until(are_finished, 60.0)
    finally:
        for worker in workers:
            worker.clean_up()
    assert jobs.get(modest.id).state is JobState.SUCCEEDED
    dead = jobs.get(greedy.id)
    assert (dead.state, dead.error["code"]) == (JobState.FAILED, "lost_worker")
    outcomes = [attempt.outcome for attempt in jobs.attempts(greedy.id)]
    # The first time that the kernel takes the worker, nobody knows whose fault it is.
    assert outcomes.count("lost") == max_attempts
    assert outcomes.count("returned") == len(outcomes) - max_attempts <= 1
    assert [finding.code for finding in inspect(database) if finding.broken] == []


def test_a_job_beyond_its_own_limit_ends_at_the_first_attempt_with_the_limit(database, jobs, url):
    greedy = jobs.submit({"chore": "hog"}, "greedy")
    modest = jobs.submit({}, "modest")
    worker = Worker(url, job_memory_mb=200)
    try:
        wait_until(lambda: all(jobs.get(job.id).is_finished for job in (greedy, modest)), 60.0)
        assert worker.process.poll() is None
    finally:
        worker.clean_up()
    dead = jobs.get(greedy.id)
    assert (dead.state, dead.error["code"], dead.attempt) == (JobState.FAILED, "memory_limit", 1)
    assert "200 MiB" in dead.error["detail"]
    assert jobs.get(modest.id).state is JobState.SUCCEEDED
    assert [finding.code for finding in inspect(database) if finding.broken] == []
