"""The wake-up socket only saves waiting, and never makes anybody wait for nothing."""

import selectors
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest

from service.local import wakeup
from service.local.wakeup import WARM, WakeUpSocket, WorkerSocket
from tests.support.waiting import wait_for


@pytest.fixture
def wake_up():
    wake_up = WakeUpSocket()
    yield wake_up
    wake_up.close()


@pytest.fixture
def line(wake_up):
    worker = WorkerSocket(wake_up.new_socket().detach())
    assert worker.is_open()  # reads the first message, that the database is ready
    yield worker
    worker.close()


@contextmanager
def waiting(wake_up, job, is_finished):
    """Wait for a job by the wake-up socket alone, in a thread; what is done meanwhile must end the wait."""
    has_looked = threading.Event()

    def look() -> bool:
        found = is_finished()
        has_looked.set()
        return found

    with ThreadPoolExecutor(1) as pool:
        answer = pool.submit(wait_for, wake_up, job, is_finished=look, timeout=3600.0)
        assert has_looked.wait(60.0)
        yield answer
        answer.result(timeout=60.0)


@pytest.fixture
def bell_alone(monkeypatch):
    """Nobody looks by himself."""
    monkeypatch.setattr(wakeup, "_LOOK_SECONDS", 3600.0)


@pytest.mark.usefixtures("bell_alone")
def test_a_finished_job_ends_the_wait_at_once(wake_up, line):
    finished = threading.Event()

    with waiting(wake_up, "job-1", finished.is_set) as answer:
        finished.set()
        line.tell("job-1")
    assert answer.result() is True


def test_a_job_that_finished_before_the_wait_is_seen(wake_up):
    assert wait_for(wake_up, "job-1", is_finished=lambda: True, timeout=0.0)


@pytest.mark.usefixtures("bell_alone")
def test_a_new_job_is_not_looked_at_before_it_is_reported_even_if_it_was_before_the_wait(wake_up):
    looks = []

    def look() -> bool:
        looks.append(len(looks))
        return True

    wake_up.announce("job-1")
    assert wait_for(wake_up, "job-1", is_finished=look, timeout=3600.0, is_new=True)
    assert looks == [0]
    assert not wait_for(wake_up, "job-2", is_finished=look, timeout=0.0, is_new=True)
    assert looks == [0]


def test_a_job_that_another_machine_finished_is_found_by_looking(wake_up):
    finished = threading.Event()
    threading.Timer(0.05, finished.set).start()
    assert wait_for(wake_up, "job-1", is_finished=finished.is_set, timeout=60.0)


def test_the_wait_ends_at_its_timeout(wake_up):
    assert not wait_for(wake_up, "job-1", is_finished=lambda: False, timeout=0.02)


def test_a_line_stays_open_however_often_it_is_notified(wake_up, line):
    for _ in range(100_000):  # more than a socket's buffer holds
        wake_up.notify()
    assert line.is_open()


def test_the_worker_notices_that_the_service_hung_up(wake_up, line):
    wake_up.close()
    assert not line.is_open()


def test_a_worker_that_died_does_not_disturb_the_others(wake_up, line):
    wake_up.new_socket().close()
    wake_up.notify()
    assert line.is_open()
    line.tell("job-1")
    assert not wait_for(wake_up, "job-2", is_finished=lambda: False, timeout=0.01)


@pytest.mark.usefixtures("bell_alone")
def test_a_closed_socket_makes_nobody_wait(wake_up):
    """A service that stops answers its waiting clients as things stand."""
    with waiting(wake_up, "job-1", lambda: False) as answer:
        wake_up.close()
    assert answer.result() is False


def test_a_worker_hears_that_the_database_is_ready_and_nothing_before():
    wake_up = WakeUpSocket(is_database_ready=False)
    early = WorkerSocket(wake_up.new_socket().detach())
    assert heard(early) is False
    wake_up.tell_database_is_ready()
    assert heard(early) is True
    late = WorkerSocket(wake_up.new_socket().detach())  # of a worker that is started again
    assert heard(late) is True
    for line in (early, late):
        line.close()
    wake_up.close()


def test_it_is_told_when_a_worker_is_warm(wake_up, line):
    told = threading.Event()
    wake_up.when_warm(told.set)
    line.tell(WARM)
    assert told.wait(60.0)


def heard(line):
    """Tell whether a message waits on a line."""
    with selectors.PollSelector() as selector:
        selector.register(line, selectors.EVENT_READ)
        return bool(selector.select(0))
