"""Signals end every command, whenever they arrive.

A child process sends itself the signal inside a callback of the garbage
collector, where an exception would only be printed, at a moment that is chosen:
the import of a module, or the call of a function.
"""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from sqlalchemy import func, select

from service.storage.database.database import Database
from service.storage.tables.operations import WorkerRow
from tests.support.databases import copy_of
from tests.support.waiting import wait_until

ROOT = Path(__file__).parents[2]
POLHODE = Path(sys.executable).with_name("polhode")
SECONDS = 300.0  # a process that has swallowed its signal would stay for ever

DRIVER = """
import gc, importlib, importlib.abc, signal, sys
entry, moment, number, *sys.argv[1:] = sys.argv[1:]

def deliver(phase, info):
    if phase == "start":
        gc.callbacks.remove(deliver)
        signal.raise_signal(int(number))

def collect():
    gc.callbacks.append(deliver)
    gc.collect()

class AtImport(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == moment:
            sys.meta_path.remove(self)
            collect()

module, _, function = moment.partition(":")
if function:
    owner = importlib.import_module(module)
    original = getattr(owner, function)
    def at_call(*arguments, **options):
        collect()
        return original(*arguments, **options)
    setattr(owner, function, at_call)
else:
    sys.meta_path.insert(0, AtImport())
sys.exit(importlib.import_module(entry).main())
"""
SERVICE, WORKER = "service.cli.main", "workers.__main__"
SOLVE = '{"file": "-", "csv": null, "as_json": false}'


@pytest.fixture
def run(tmp_path, sqlite_template):
    """Run a command that signals itself; return how it ended."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("POLHODE_")}
    environment = {
        **kept,
        "POLHODE_DATABASE_URL": copy_of(sqlite_template, tmp_path),
        "PYTHONPATH": str(ROOT),
    }

    def ended(entry, moment, number, *arguments, content=""):
        return subprocess.run(
            [sys.executable, "-c", DRIVER, entry, moment, str(int(number)), *map(str, arguments)],
            capture_output=True,
            text=True,
            timeout=SECONDS,
            input=content,
            env=environment,
            cwd=tmp_path,
            check=False,
        )

    return ended


INTERRUPTED, TERMINATED = "interrupted\n", "stopped by SIGTERM\n"


@pytest.mark.parametrize(
    ("number", "code", "line", "entry", "moment", "arguments"),
    [
        (signal.SIGINT, 130, INTERRUPTED, SERVICE, "typer", ["serve"]),
        (
            signal.SIGINT,
            130,
            INTERRUPTED,
            WORKER,
            "numpy",
            ["solve", SOLVE],
        ),
        (signal.SIGTERM, 143, TERMINATED, SERVICE, "sqlalchemy", ["migrate"]),
    ],
)
def test_a_command_that_has_not_begun_ends_at_once(run, number, code, line, entry, moment, arguments):
    ended = run(entry, moment, number, *arguments)
    assert (ended.returncode, ended.stdout, ended.stderr) == (code, "", line)


@pytest.mark.parametrize(
    ("entry", "moment", "arguments"),
    [
        (SERVICE, "uvicorn", ["serve", "--port", "0"]),
        (WORKER, "workers.process.start", ["run"]),
    ],
)
def test_a_service_that_is_terminated_at_its_start_has_left_nothing_undone(run, entry, moment, arguments):
    ended = run(entry, moment, signal.SIGTERM, *arguments)
    assert (ended.returncode, ended.stderr) == (0, TERMINATED)


@pytest.mark.parametrize("moment", ["service.cli.http_server:announce", "uvicorn.lifespan.on"])
def test_a_service_that_has_something_to_put_in_order_does_so(run, moment):
    # Before and after the server listens to signals itself.
    ended = run(SERVICE, moment, signal.SIGTERM, "serve", "--port", "0", "--workers", "0")
    assert ended.returncode == 0, ended.stderr
    assert "Traceback" not in ended.stderr
    assert "serving http://" in ended.stderr


def test_a_worker_that_has_entered_the_database_leaves_it(run, tmp_path):
    ended = run(WORKER, "selectors:PollSelector", signal.SIGTERM, "run")
    assert ended.returncode == 0
    assert "Traceback" not in ended.stderr
    database = Database(f"sqlite:///{tmp_path / 'polhode.db'}")
    with database.read() as session:
        assert session.scalar(select(func.count()).select_from(WorkerRow)) == 0
    database.close()


SWEEP = """{
  "base": {"body": {"A": 2, "C": 1}, "potential": {"type": "gravity", "a": -1},
           "motion": {"type": "planar", "lambda": 1}, "time": {"stop": 1, "samples": 3}},
  "axes": [{"pointer": "/motion/lambda", "values": ["1/2", 1]}], "keep": ["period"]}"""


def test_a_sweep_that_was_stopped_says_what_is_missing(run, tmp_path):
    out = tmp_path / "points.csv"
    moment = "workers.cli.sweep:_progress"
    options = json.dumps({"file": "-", "out": str(out), "workers": None, "as_json": False})
    ended = run(WORKER, moment, signal.SIGINT, "sweep", options, content=SWEEP)
    assert ended.returncode == 1
    assert ended.stderr == "stopped: 2 of 2 points are missing, those with index 0 to 1\n"
    assert out.read_text(encoding="utf-8").startswith('"index"')


@pytest.mark.parametrize("command", ["validate", "solve"])
def test_ctrl_c_while_a_command_starts_or_reads_is_one_line(command, tmp_path):
    # Its document never comes, so that it cannot be finished before.
    with subprocess.Popen(
        [POLHODE, command, "-"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        cwd=tmp_path,
    ) as process:
        try:
            wait_until(lambda: catches_sigterm(process.pid), SECONDS)
            # As a terminal does it: to every process of the group.
            os.killpg(process.pid, signal.SIGINT)
            said, complaint = process.communicate(timeout=SECONDS)
        finally:
            process.kill()
    assert (process.returncode, said, complaint) == (130, "", INTERRUPTED)


def catches_sigterm(process: int) -> bool:
    """Whether the first line of the program has run: no interpreter catches SIGTERM by itself."""
    status = Path(f"/proc/{process}/status").read_text(encoding="ascii")
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt:"))
    return bool(int(caught.split()[1], 16) >> (signal.SIGTERM - 1) & 1)
