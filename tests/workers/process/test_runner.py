"""What becomes of jobs in a real worker: limits, cancelling, stopping, waking."""

import signal

import pytest

from service.jobs.records import AttemptOutcome, JobState
from service.local.wakeup import WakeUpSocket
from service.storage.codecs.packing import SOLVED, decode_points
from service.storage.sweeps.sweep_store import SweepStore
from tests.support.lists import list_jobs
from tests.support.waiting import PATIENCE, is_alive, wait_for, wait_until

pytestmark = pytest.mark.any_database


@pytest.fixture
def wake_up():
    wake_up = WakeUpSocket()
    yield wake_up
    wake_up.close()


@pytest.fixture
def log(tmp_path):
    return tmp_path / "log"


def started(log):
    return log.exists() and log.read_text().split()


def finished(jobs, job):
    return wait_until(lambda: jobs.get(job.id).is_finished and jobs.get(job.id))


def test_jobs_succeed_with_their_results(jobs, solutions, start_worker):
    submitted = [jobs.submit({"number": n}, str(n)) for n in range(10)]
    start_worker(slots=2)
    for job in submitted:
        done = finished(jobs, job)
        assert (done.state, done.attempt) == (JobState.SUCCEEDED, 1)
        assert solutions.get(done.solution_id).problem == job.problem
        assert (solutions.dense(done.solution_id), solutions.samples(done.solution_id)) == (
            b"dense",
            b"samples",
        )


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("chore", "code"),
    [
        ("refuse", "no_motion"),
        ("raise", "internal_error"),
        ("nan", "internal_error"),
        ("spin", "time_limit"),
        ("sleep", "time_limit"),
        ("hog", "memory_limit"),
    ],
)
def test_a_failure_is_told_and_not_tried_again(jobs, start_worker, chore, code):
    job = jobs.submit({"chore": chore, "seconds": 60}, "digest")
    start_worker(job_seconds=1.0 if code == "time_limit" else 60.0)
    done = finished(jobs, job)
    assert (done.state, done.attempt, done.error["code"]) == (JobState.FAILED, 1, code)
    assert done.error["detail"]
    assert [a.outcome for a in jobs.attempts(job.id)] == [AttemptOutcome.FAILED]


def test_a_failed_job_does_not_spoil_its_child(jobs, start_worker):
    for n, chore in enumerate(["hog", "raise", "spin", "refuse", "succeed"]):
        jobs.submit({"chore": chore}, str(n))
    start_worker(job_seconds=0.5)
    wait_until(lambda: all(job.is_finished for job in list_jobs(jobs).jobs))
    assert [job.state for job in list_jobs(jobs).jobs] == [JobState.SUCCEEDED] + [JobState.FAILED] * 4


@pytest.mark.parametrize("rings", [True, False])
def test_cancelling_stops_the_work_long_before_the_lease_ends(jobs, wake_up, start_worker, log, rings):
    job = jobs.submit({"chore": "spin", "log": str(log)}, "digest")
    # A worker that is notified need not look; one that does not looks soon.
    start_worker(lease_seconds=3600, wake_up=wake_up, poll_seconds=3600 if rings else 0.1)
    (child,) = wait_until(lambda: started(log))
    jobs.cancel(job.id)
    if rings:
        wake_up.notify()
    wait_until(lambda: not is_alive(child))
    # The slot is free again.
    after = jobs.submit({}, "another")
    wake_up.notify()
    assert finished(jobs, after).state is JobState.SUCCEEDED
    assert jobs.get(job.id).state is JobState.CANCELLED


def test_a_long_job_keeps_its_lease(jobs, start_worker):
    job = jobs.submit({"chore": "sleep", "seconds": 2.5}, "digest")
    start_worker(lease_seconds=2.0)
    start_worker(lease_seconds=2.0)
    assert (finished(jobs, job).state, finished(jobs, job).attempt) == (JobState.SUCCEEDED, 1)


def test_equal_jobs_are_computed_once(jobs, start_worker, log):
    submitted = [jobs.submit({"log": str(log)}, "digest") for _ in range(3)]
    start_worker()
    assert [finished(jobs, job).reused for job in submitted] == [False, True, True]
    assert len(started(log)) == 1


def test_sigterm_lets_running_jobs_finish_and_leaves_the_rest(jobs, start_worker, log):
    running = jobs.submit({"chore": "sleep", "seconds": 1.0, "log": str(log)}, "1")
    waiting = jobs.submit({}, "2")
    worker = start_worker()
    wait_until(lambda: started(log))
    assert worker.terminate() == 0
    assert jobs.get(running.id).state is JobState.SUCCEEDED
    assert jobs.get(waiting.id).state is JobState.QUEUED
    wait_until(lambda: not worker.session())


def test_after_the_grace_a_job_is_given_back(jobs, start_worker, log):
    job = jobs.submit({"chore": "spin", "log": str(log)}, "digest")
    worker = start_worker(grace_seconds=0.1)
    wait_until(lambda: started(log))
    assert worker.terminate() == 0
    assert jobs.get(job.id).state is JobState.QUEUED
    assert [a.outcome for a in jobs.attempts(job.id)] == [AttemptOutcome.RETURNED]
    wait_until(lambda: not worker.session())


def test_a_second_signal_returns_jobs_at_once(jobs, start_worker, log):
    job = jobs.submit({"chore": "spin", "log": str(log)}, "digest")
    worker = start_worker(grace_seconds=3600)
    wait_until(lambda: started(log))
    worker.process.send_signal(signal.SIGINT)
    # Both may arrive as one, if the first was not handled yet.
    wait_until(lambda: worker.process.poll() is not None or worker.process.send_signal(signal.SIGINT))
    assert worker.process.wait(timeout=PATIENCE) == 0
    assert jobs.get(job.id).state is JobState.QUEUED
    assert [a.outcome for a in jobs.attempts(job.id)] == [AttemptOutcome.RETURNED]
    wait_until(lambda: not worker.session())


def test_a_worker_stops_with_the_service_that_started_it(jobs, wake_up, start_worker):
    worker = start_worker(wake_up=wake_up)
    job = jobs.submit({}, "digest")
    finished(jobs, job)
    wake_up.close()
    assert worker.process.wait(timeout=PATIENCE) == 0


def test_the_wake_up_socket_spares_the_poll_interval(jobs, wake_up, start_worker):
    start_worker(wake_up=wake_up, poll_seconds=3600)
    first = jobs.submit({}, "0")
    wake_up.notify()
    finished(jobs, first)
    job = jobs.submit({}, "1")
    wake_up.notify()
    assert wait_for(wake_up, job.id, is_finished=lambda: jobs.get(job.id).is_finished, timeout=PATIENCE)


def test_a_job_that_nobody_announced_is_found(jobs, start_worker):
    start_worker(poll_seconds=0.1)
    assert finished(jobs, jobs.submit({}, "digest")).state is JobState.SUCCEEDED


def submit_sweep(database, points=200, **sweep):
    document = {"seconds": 0.02, **sweep}
    return SweepStore(database).submit(document, points=points, most=30)


def finished_sweep(database, sweep):
    sweeps = SweepStore(database)

    def done():
        found = sweeps.get(sweep.id)
        return found if found.finished_at is not None else None

    assert wait_until(done).state is JobState.SUCCEEDED
    chunks = list(sweeps.chunks(sweep.id))
    assert [i for c in chunks for i in range(c.first, c.first + c.count)] == list(range(sweep.points))
    points = [decode_points(data) for data in sweeps.data(sweep.id, [chunk.first for chunk in chunks])]
    return {
        index: outcome
        for chunk, found in zip(chunks, points, strict=True)
        for index, outcome in enumerate(found.outcomes, start=chunk.first)
        if outcome != SOLVED
    }


def test_a_sweep_is_computed_chunk_by_chunk(database, start_worker):
    sweep = submit_sweep(database)
    start_worker(slots=2)
    assert finished_sweep(database, sweep) == {}


def test_points_that_a_chunk_hands_back_are_computed_by_another(database, start_worker):
    sweep = submit_sweep(database, chore="stop", bad=[3, 17, 40, 41, 199])
    start_worker()
    assert finished_sweep(database, sweep) == {}


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("chore", "code"),
    [("crash", "lost_worker"), ("raise", "internal_error"), ("spin", "time_limit"), ("hog", "memory_limit")],
)
def test_the_point_that_ends_its_chunk_is_found_and_no_other_suffers(database, start_worker, chore, code):
    sweep = submit_sweep(database, points=40, chore=chore, bad=[23])
    start_worker(job_seconds=0.5 if code == "time_limit" else 60.0, max_attempts=1)
    assert finished_sweep(database, sweep) == {23: code}


def test_a_sweep_goes_on_after_its_worker_was_killed(database, start_worker):
    sweep = submit_sweep(database, points=1000)
    first = start_worker()
    wait_until(lambda: SweepStore(database).get(sweep.id).done)
    first.kill()
    start_worker()
    assert finished_sweep(database, sweep) == {}
