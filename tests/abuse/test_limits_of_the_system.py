"""A system without room for a service is told in one plain line; the least setting of memory is enough."""

import json
import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from service.local.workers import FOLDER_VARIABLE
from service.sandbox import lack_of_room
from service.settings import Settings
from tests.support.databases import copy_of

POLHODE = Path(sys.executable).with_name("polhode")
UNUSED = "61734"
"""A user who has no process, so that nobody else's are counted."""
AS_SOMEBODY = (
    *("setpriv", "--clear-groups", f"--reuid={UNUSED}", "--ambient-caps=+dac_override"),
    *("--inh-caps=-all,+dac_override", "--bounding-set=-all,+dac_override"),
)
"""Root is not limited. Somebody else who may read the files of root is."""


@pytest.mark.parametrize("command", [["serve", "--port", "0"], ["worker"]], ids=["serve", "worker"])
@pytest.mark.parametrize(
    ("limit", "most", "said"),
    [
        (resource.RLIMIT_NPROC, 12, "the limit of 12 processes and threads (ulimit -u) is too low: "),
        (resource.RLIMIT_AS, 600 * 10**6, "the limit of 600 MB of address space (ulimit -v) is too low: "),
    ],
    ids=["processes", "memory"],
)
def test_a_limit_that_is_too_low_is_told_in_one_line(tmp_path, sqlite_template, command, limit, most, said):
    begins_with = ()
    if limit == resource.RLIMIT_NPROC and os.geteuid() == 0:
        if shutil.which("setpriv") is None:
            pytest.skip("root is not limited, and cannot become somebody else here")
        begins_with = AS_SOMEBODY
    ended = subprocess.run(
        [*begins_with, POLHODE, *command],
        preexec_fn=lambda: resource.setrlimit(limit, (most, most)),
        env={**os.environ, "POLHODE_DATABASE_URL": copy_of(sqlite_template, tmp_path)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert (ended.returncode, ended.stdout) == (1, "")
    assert ended.stderr.startswith(said)
    assert ended.stderr.count("\n") == 1


def test_there_is_room_without_limits_and_with_those_that_suffice(monkeypatch):
    limits = {resource.RLIMIT_NPROC: resource.RLIM_INFINITY, resource.RLIMIT_AS: resource.RLIM_INFINITY}
    monkeypatch.setattr("service.sandbox.resource.getrlimit", lambda which: (limits[which], 0))
    monkeypatch.setattr("service.sandbox.os.geteuid", lambda: 1000)
    assert lack_of_room(tasks=10**6, megabytes=10**6) is None
    limits |= {resource.RLIMIT_NPROC: 50, resource.RLIMIT_AS: 10**9}
    assert lack_of_room(tasks=50, megabytes=1000) is None
    assert "ulimit -u" in lack_of_room(tasks=51, megabytes=1000)
    assert "ulimit -v" in lack_of_room(tasks=50, megabytes=1001)
    monkeypatch.setattr("service.sandbox.os.geteuid", lambda: 0)
    assert lack_of_room(tasks=51, megabytes=1000) is None


def test_a_home_that_cannot_be_written_to_is_told_by_the_first_line_of_a_worker(tmp_path, sqlite_template):
    home = tmp_path / "home"
    home.touch()
    environment = {"POLHODE_DATABASE_URL": copy_of(sqlite_template, tmp_path), FOLDER_VARIABLE: str(home)}
    with subprocess.Popen(
        [POLHODE, "worker"], env={**os.environ, **environment}, cwd=tmp_path, stderr=subprocess.PIPE
    ) as worker:
        assert worker.stderr is not None
        first = json.loads(worker.stderr.readline())
        worker.terminate()
        worker.communicate(timeout=120)
    assert (first["level"], first["logger"]) == ("warning", "workers.cli.main")
    assert f"{home}/compiled cannot be made (Not a directory): set {FOLDER_VARIABLE} to" in first["message"]


_FIRST_JOB = """
import json, sys
from service.sandbox import Sandbox
from workers.process.tasks import PRELOAD, solve_problem

sandbox = Sandbox(1, memory_mb=int(sys.argv[1]), preload=PRELOAD)
print(type(sandbox.run(solve_problem, sys.argv[2], seconds=240)).__name__)
sandbox.close()
"""
_FROM_A_STATE = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "expression", "expression": "a*g1 + b/g3^2", "parameters": {"a": -1, "b": "1/20"}},
    "motion": {"type": "state", "omega": ["1/10", "1/5", "3/10"], "gamma": ["3/5", 0, "4/5"]},
    "time": {"stop": 10, "samples": 101},
}


def test_the_least_memory_of_a_job_is_enough_for_all_that_the_first_one_loads(tmp_path):
    """A motion from a state, where nothing is compiled, loads SciPy's integrators, the largest library."""
    (least,) = (each.ge for each in Settings.model_fields["job_memory_mb"].metadata)
    done = subprocess.run(
        [sys.executable, "-P", "-c", _FIRST_JOB, str(least), json.dumps(_FROM_A_STATE)],
        env={**os.environ, "POLHODE_WAY": "plain", "PYTHONPATH": str(Path(__file__).parents[2])},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert (done.stdout, done.returncode) == ("Solved\n", 0), done.stderr
