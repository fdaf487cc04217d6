"""The worker process beside a service is back at once when it was killed; if it cannot live, that is told."""

import errno
import json
import subprocess
import sys
import threading

import pytest

from service.app import create_app
from service.local.wakeup import WakeUpSocket
from service.local.workers import LocalWorkers, Restarts, WorkerProcess, WorkerStanding
from service.settings import Settings
from service.storage.database.database import Database
from service.storage.upkeep.presence import WorkerRegistry
from tests.support.api import TestClient
from tests.support.waiting import wait_until

FOREVER = [sys.executable, "-S", "-c", "import signal; signal.pause()"]
WARM_AT_ONCE = """
import json, os, signal, sys
os.write(json.loads(sys.argv[-1])["wake_fd"], b"warm\\n")
signal.pause()
"""
ENDS_AT_THE_SECOND = f"""
import os, signal
signals = []
def note(*_):
    signals.append(1)
    if len(signals) == 2:
        os._exit(7)  # at once: a third signal would kill what only ends
signal.signal(signal.SIGTERM, note)
{WARM_AT_ONCE.replace("signal.pause()", "while True: signal.pause()")}
"""
AT_ONCE = [sys.executable, "-S", "-c", "raise SystemExit(3)"]


@pytest.fixture
def keep(monkeypatch):
    """Run a command as the worker of a service."""
    started = []

    def begin(command):
        def with_options(name, **options):
            return [*command, name, json.dumps(options)]

        monkeypatch.setattr("service.local.workers.worker_command", with_options)
        wake_up = WakeUpSocket()
        started.append((LocalWorkers(Settings(workers=1, grace_seconds=0.0), wake_up), wake_up))
        return started[-1][0]

    yield begin
    for workers, wake_up in started:
        workers.stop()
        wake_up.close()


def test_a_killed_worker_is_started_again(keep):
    workers = keep(FOREVER)
    first = workers._process
    assert workers.standing() == WorkerStanding(Restarts())
    first.kill()
    wait_until(lambda: workers._process is not first and workers.standing().is_running)
    assert workers._process.poll() is None
    assert (workers.standing().restarts.deaths, workers.standing().last_code) == (1, -9)


def pauses_of(workers, monkeypatch):
    """Note how long is waited before the next start, and wait for nothing."""
    waits, stopping = [], workers._stopping
    monkeypatch.setattr(stopping, "wait", lambda seconds: waits.append(seconds) or stopping.is_set())
    return waits


def test_a_worker_that_ran_for_a_while_is_back_without_a_pause(keep, monkeypatch):
    monkeypatch.setattr("service.local.workers.EARLY_SECONDS", 0.0)
    workers = keep(FOREVER)
    waits, first = pauses_of(workers, monkeypatch), workers._process
    first.kill()
    wait_until(lambda: workers._process is not first)
    assert waits == [0.0]


def test_workers_that_are_killed_at_work_are_back_without_a_pause_however_often(keep, monkeypatch):
    workers = keep([sys.executable, "-S", "-c", WARM_AT_ONCE])
    waits = pauses_of(workers, monkeypatch)
    for _ in range(3):
        worker = workers._process
        wait_until(workers._has_worked.is_set)
        worker.kill()
        wait_until(lambda worker=worker: workers._process is not worker)
    assert waits == [0.0] * 3


def test_a_second_signal_to_the_service_is_one_to_its_worker(keep, monkeypatch):
    workers = keep([sys.executable, "-S", "-c", ENDS_AT_THE_SECOND])
    monkeypatch.setattr(workers._settings, "grace_seconds", 3600.0)
    wait_until(workers._has_worked.is_set)
    urges = []
    stopping = threading.Thread(target=workers.stop, args=(urges.append,))
    stopping.start()
    wait_until(lambda: urges)
    # Both may arrive as one, if the first was not handled yet.
    wait_until(lambda: workers._process.poll() is not None or urges[0]())
    stopping.join()
    assert workers._process.returncode == 7


def test_a_worker_that_dies_at_once_again_is_told_with_its_pause(keep):
    workers = keep(AT_ONCE)
    standing = wait_until(
        lambda: (now := workers.standing()).restarts.early_deaths >= 2 and not now.is_running and now
    )
    assert standing.last_code == 3
    assert "ended with code 3, 2 times in a row" in str(standing)


def test_a_worker_that_cannot_be_started_now_is_started_later(keep, monkeypatch):
    workers = keep(FOREVER)
    first, failures = workers._process, []
    start = subprocess.Popen

    def fail_once(*arguments, **options):
        if not failures:
            failures.append(OSError(errno.EAGAIN, "no process left"))
            raise failures[0]
        return start(*arguments, **options)

    monkeypatch.setattr("service.local.workers.subprocess.Popen", fail_once)
    first.kill()
    wait_until(lambda: workers._process is not first and workers.standing().is_running)
    assert failures
    assert workers.standing().restarts.deaths == 2


def client_of(sqlite_url, verdicts, standing):
    settings = Settings(database_url=sqlite_url)
    return TestClient(create_app(settings, sandbox=verdicts, local_worker=lambda: standing))


@pytest.mark.parametrize(
    ("standing", "said", "up", "pause"),
    [
        (WorkerStanding(Restarts(2, 0), -9, None), "ok", 1.0, 0.0),
        (WorkerStanding(Restarts(5, 4), 1, 3.5), "ended with code 1, 4 times in a row", 0.0, 3.5),
    ],
)
def test_readyz_and_metrics_tell_how_the_worker_does(sqlite_url, verdicts, standing, said, up, pause):
    with client_of(sqlite_url, verdicts, standing) as client:
        ready = client.get("/readyz")
        # Requests are answered and jobs accepted all the same.
        assert (ready.status_code, said in ready.json()["checks"]["worker"]) == (200, True)
        lines = dict(
            line.rsplit(" ", 1) for line in client.get("/metrics").text.splitlines() if line[0] != "#"
        )
    assert float(lines["polhode_local_worker_up"]) == up
    assert float(lines["polhode_local_worker_pause_seconds"]) == pause
    assert float(lines["polhode_local_worker_deaths_total"]) == standing.restarts.deaths


def test_readyz_tells_whether_a_worker_would_take_a_job_now(sqlite_url, verdicts):
    database = Database(sqlite_url)
    registry = WorkerRegistry(database, lease_seconds=3600.0)
    worker = WorkerProcess("w", "here", "local", 1)
    runs, ended = WorkerStanding(Restarts()), WorkerStanding(Restarts(5, 4), 1, 3.5)
    standing = [runs]
    app = create_app(Settings(database_url=sqlite_url), sandbox=verdicts, local_worker=lambda: standing[-1])
    with TestClient(app) as client:
        said = []

        def ask():
            said.append(client.get("/readyz").json()["workers"])

        ask()  # its process runs, and has not entered the database
        standing.append(ended)
        ask()
        registry.enter(worker, alone=True)
        ask()
        registry.see(worker, is_warm=True)
        ask()
        registry.leave(worker)
        ask()
    database.close()
    assert said == ["starting", "none", "starting", "warm", "none"]


def test_without_a_worker_of_its_own_a_service_tells_nothing_of_one(sqlite_url, verdicts):
    with TestClient(create_app(Settings(database_url=sqlite_url), sandbox=verdicts)) as client:
        assert "worker" not in client.get("/readyz").json()["checks"]
        assert "polhode_local_worker" not in client.get("/metrics").text
