"""A sweep by workers on several hosts: chunks are delivered as they are made, every point is stored once."""

import signal

import numpy as np
from sqlalchemy import select

from service.jobs.records import AttemptOutcome, JobState
from service.storage.codecs.packing import SOLVED, decode_points
from service.storage.tables.jobs import AttemptRow, JobRow
from tests.support.waiting import wait_until

POINTS = 200
LARGEST_CHUNK = 30
PATIENT = {"poll_seconds": 3600, "lease_seconds": 3600}
"""Settings of workers that would not look at the queue while these tests last."""


def submit(installation, **sweep):
    submitted = installation.sweeps.submit({"seconds": 0.02, **sweep}, points=POINTS, most=LARGEST_CHUNK)
    installation.wake_up.notify()
    return submitted


def finished(installation, sweep):
    """Return the sweep when its last point is done."""

    def done():
        found = installation.sweeps.get(sweep.id)
        return found if found.finished_at is not None else None

    return wait_until(done)


def periods(installation, sweep):
    """The period of every stored point, in their order; it is the point's index."""
    firsts = [chunk.first for chunk in installation.sweeps.chunks(sweep.id)]
    stored = [decode_points(data) for data in installation.sweeps.data(sweep.id, firsts)]
    assert {outcome for points in stored for outcome in points.outcomes} == {SOLVED}
    return np.concatenate([points.numbers["period"] for points in stored]).tolist()


def attempts(installation, sweep):
    """The (job, worker, outcome) of every attempt at a chunk; those at one chunk in their order."""
    statement = select(AttemptRow.job_id, AttemptRow.worker, AttemptRow.outcome)
    of_sweep = statement.join(JobRow, JobRow.id == AttemptRow.job_id).where(JobRow.sweep_id == sweep.id)
    with installation.database.read() as session:
        return [tuple(row) for row in session.execute(of_sweep.order_by(AttemptRow.number))]


def is_of(worker, name):
    """Tell whether a worker's name, host:process:number, is that of a worker."""
    return name.split(":")[1] == str(worker.process.pid)


def caught_at_work(installation, sweep, worker):
    """Stop a worker and return the job that it has; if it has none at the time, let it go on."""
    worker.process.send_signal(signal.SIGSTOP)
    for job, name, end in attempts(installation, sweep):
        if end is None and is_of(worker, name):
            return job
    worker.process.send_signal(signal.SIGCONT)
    return None


def assert_each_point_is_there_once(installation, sweep):
    done = finished(installation, sweep)
    assert (done.state, done.done, done.refused) == (JobState.SUCCEEDED, POINTS, 0)
    assert periods(installation, sweep) == list(range(POINTS))


def test_what_a_chunk_makes_reaches_workers_that_do_not_look(installation):
    crew = [installation.start_worker(host, **PATIENT) for host in (0, 1)]
    sweep = submit(installation, pause=0.02)
    assert_each_point_is_there_once(installation, sweep)
    assert {outcome for _, _, outcome in attempts(installation, sweep)} == {AttemptOutcome.SUCCEEDED}
    for worker in crew:
        assert worker.terminate() == 0


def test_the_chunk_of_a_killed_worker_is_computed_on_another_host(installation):
    sweep = submit(installation, pause=0.1)
    killed = installation.start_worker(1, lease_seconds=0.6)
    other = installation.start_worker(2, lease_seconds=3600)
    wait_until(lambda: installation.sweeps.get(sweep.id).done)
    caught = wait_until(lambda: caught_at_work(installation, sweep, killed))
    killed.kill()
    assert installation.sweeps.get(sweep.id).done < POINTS
    assert_each_point_is_there_once(installation, sweep)
    # A busy machine may renew a lease too late, so that a living worker has lost another chunk, too.
    ends = [(is_of(killed, name), end) for job, name, end in attempts(installation, sweep) if job == caught]
    assert ends[-1] == (False, AttemptOutcome.SUCCEEDED)
    assert ends.count((True, AttemptOutcome.RETURNED)) == 1
    assert other.terminate() == 0


def test_a_cancelled_sweep_leaves_nothing_to_do(installation):
    worker = installation.start_worker()
    sweep = submit(installation, pause=0.1)
    wait_until(lambda: installation.sweeps.get(sweep.id).done)
    cancelled = installation.sweeps.cancel(sweep.id)
    assert 0 < cancelled.done < POINTS
    assert worker.terminate() == 0
    assert installation.sweeps.get(sweep.id) == cancelled
    assert periods(installation, sweep) == list(range(cancelled.done))
