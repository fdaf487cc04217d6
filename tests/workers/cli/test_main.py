"""The worker's own command line."""

import json
import os
import signal
import subprocess

import pytest

from service.local.workers import worker_command
from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.storage.database.database import Database
from service.storage.jobs.job_store import JobStore
from tests.support.commands import polhode
from tests.support.databases import url_of
from tests.support.waiting import wait_until
from tests.workers.processes import ROOT
from workers.cli.documents import draw_file
from workers.cli.main import main


@pytest.mark.parametrize("arguments", [[], ["walk"], ["--help"]])
def test_wrong_usage_ends_with_2_and_tells_the_commands(arguments, capsys):
    assert main(arguments) == 2
    assert "run, children, solve, atlas, study, sweep, compile, calibrate, doctor" in capsys.readouterr().err


@pytest.mark.parametrize("slots", ["0", "many"])
def test_a_number_of_slots_that_cannot_be_is_refused(slots, capsys):
    assert polhode("worker", "--slots", slots) == 2
    assert "Usage" in capsys.readouterr().err


def test_impossible_settings_end_with_2_and_the_reason(monkeypatch, capsys):
    monkeypatch.setenv("POLHODE_LEASE_SECONDS", "0")
    assert polhode("worker") == 2
    assert "lease_seconds" in capsys.readouterr().err


def test_compiling_says_that_the_solvers_are_ready(capsys):
    assert polhode("compile") == 0
    assert "ready" in capsys.readouterr().out


def test_a_worker_alone_makes_its_database_computes_and_stops(tmp_path):
    file = tmp_path / "new.db"
    command, environment = (
        worker_command("run", slots=1),
        {**os.environ, "POLHODE_DATABASE_URL": url_of(file)},
    )
    with subprocess.Popen(command, cwd=ROOT, env=environment, stderr=subprocess.DEVNULL) as worker:
        try:
            wait_until(lambda: (tmp_path / "new.db-wal").exists() and file.stat().st_size > 4096)
            database = Database(url_of(file))
            jobs = JobStore(database)
            # No problem at all: the computation must say so, whatever it says.
            job = jobs.submit({}, "digest")
            done = wait_until(lambda: jobs.get(job.id).is_finished and jobs.get(job.id))
            assert done.error
            database.close()
            worker.send_signal(signal.SIGTERM)
            assert worker.wait(timeout=120) == 0
        finally:
            worker.kill()


@pytest.mark.parametrize(
    ("fault", "code"),
    [
        (SandboxTimeoutError("the time limit passed"), "verdict_time_limit"),
        (SandboxMemoryError("the memory limit was reached"), "memory_limit"),
        (SandboxCrashError("the child process was killed"), "lost_worker"),
    ],
)
def test_an_atlas_without_an_end_is_refused_as_a_problem_is(fault, code, tmp_path, monkeypatch, capsys):
    def run(*_: object, **__: object) -> None:
        raise fault

    monkeypatch.setattr(Sandbox, "run", run)
    file = tmp_path / "atlas.json"
    file.write_text('{"body": {"A": 2, "C": 1}, "potential": {"type": "gravity", "a": -1}, "lambda": [1, 2]}')
    assert draw_file(file, as_json=True, picture=None) == 1
    said = capsys.readouterr()
    assert json.loads(said.out)["code"] == code
    assert said.err.startswith(f"{code}: ")
