"""The bell only saves waiting, and never makes anybody wait for nothing."""

import threading
import time

import pytest

from service.jobs.wakeup import Doorbell, WorkerLine


@pytest.fixture
def doorbell():
    bell = Doorbell()
    yield bell
    bell.close()


@pytest.fixture
def line(doorbell):
    worker = WorkerLine(doorbell.new_line().detach())
    yield worker
    worker.close()


def test_a_finished_job_ends_the_wait_at_once(doorbell, line):
    finished = threading.Event()

    def finish() -> None:
        finished.set()
        line.tell("job-1")

    threading.Timer(0.05, finish).start()
    start = time.monotonic()
    assert doorbell.wait_for("job-1", is_finished=finished.is_set, timeout=5.0)
    # The next look without the bell would be at 0.25 s.
    assert time.monotonic() - start < 0.2


def test_a_job_that_finished_before_the_wait_is_seen(doorbell):
    assert doorbell.wait_for("job-1", is_finished=lambda: True, timeout=0.0)


def test_a_job_that_another_machine_finished_is_found_by_looking(doorbell):
    finished = threading.Event()
    threading.Timer(0.05, finished.set).start()
    assert doorbell.wait_for("job-1", is_finished=finished.is_set, timeout=5.0)


def test_the_wait_ends_at_its_timeout(doorbell):
    assert not doorbell.wait_for("job-1", is_finished=lambda: False, timeout=0.02)


def test_a_line_stays_open_however_often_it_is_rung(doorbell, line):
    for _ in range(100_000):  # more than a socket's buffer holds
        doorbell.ring()
    assert line.is_open()


def test_the_worker_notices_that_the_service_hung_up(doorbell, line):
    doorbell.close()
    assert not line.is_open()


def test_a_worker_that_died_does_not_disturb_the_others(doorbell, line):
    doorbell.new_line().close()
    doorbell.ring()
    assert line.is_open()
    line.tell("job-1")
    assert not doorbell.wait_for("job-2", is_finished=lambda: False, timeout=0.01)


def test_a_closed_bell_makes_nobody_wait(doorbell):
    """A service that stops answers its waiting clients as things stand."""
    threading.Timer(0.05, doorbell.close).start()
    start = time.monotonic()
    assert not doorbell.wait_for("job-1", is_finished=lambda: False, timeout=5.0)
    # The next look without the bell would be at 0.25 s.
    assert time.monotonic() - start < 0.2
