"""The compiling task: one of a machine, which goes on where another was killed, and does not begin in want.

The tasks here are real, with real locks and kernels; only the kernels of their groups are few.
"""

import json
import os
import subprocess
import sys
from contextlib import nullcontext, suppress
from pathlib import Path

import pytest

from service.jobs.kernels import KERNELS, Kernels
from service.local.workers import FOLDER_VARIABLE
from tests.support.waiting import wait_until
from tests.workers.processes import ROOT
from workers.cli import compile as task
from workers.computation import compiled_code
from workers.computation.compiled_code import GROUPS
from workers.process import start as compiling
from workers.process.start import Compiling

TASK = """
import os, sys
from pathlib import Path
from workers.cli import compile as task
from workers.computation import compiled_code
log, stop_after = Path(sys.argv[1]), int(sys.argv[2])
os.sched_setaffinity(0, list(os.sched_getaffinity(0))[:1])  # no second process, which would compile all
made = 0

save = compiled_code.KernelCode.save

def save_and_note(self, kind, *further):
    global made
    save(self, kind, *further)
    made += 1
    with log.open("a") as file:
        file.write(f"{kind}:{self._function.__name__}\\n")
    if made == stop_after:
        print("stopped", flush=True)
        sys.stdin.read()

def compile_group(group):
    compiled_code.keep_compiled_code()
    from workers.solvers.compiled.doubled.arithmetic import exact_product, subtract
    exact_product(1.0, 2.0)
    subtract((1.0, 0.0), (2.0, 0.0))
    compiled_code.note_of(group).touch()

task.compile_group = compile_group
compiled_code.KernelCode.save = save_and_note
sys.exit(task.compile_solvers())
"""
PARTS = {"exact_product", "subtract", "add", "two_sum", "quick_sum"}
"""The kernels of a group, with those that they call."""
SAVED = [*(f"part:{name}" for name in PARTS), "entry:exact_product", "entry:subtract"]
DYING = """
import os, signal, subprocess, sys
from pathlib import Path
log, deaths = Path(sys.argv[1]), int(sys.argv[2])
second = subprocess.Popen(["sleep", "600"])
with log.open("a") as file:
    file.write(f"{second.pid}\\n")
if len(log.read_text().split()) <= deaths:
    os.kill(os.getpid(), signal.SIGKILL)
second.kill()
second.wait()
"""


@pytest.fixture
def start(tmp_path):
    """Start tasks on one folder that write down what they compile; kill whatever is left of them."""
    started = []

    def started_one(*, stop_after=0):
        command = [sys.executable, "-P", "-c", TASK, str(tmp_path / "log"), str(stop_after)]
        folder = {FOLDER_VARIABLE: str(tmp_path / "code"), "PYTHONPATH": str(ROOT)}
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        started.append(subprocess.Popen(command, env={**os.environ, **folder}, **pipes))
        return started[-1]

    yield started_one
    for each in started:
        each.kill()
        each.communicate()


def holds_open(process, file):
    """Tell whether a process has a file open: so it waits for its lock."""
    for opened in Path(f"/proc/{process.pid}/fd").iterdir():
        with suppress(FileNotFoundError):  # what was open is closed by now
            if opened.readlink() == file:
                return True
    return False


@pytest.mark.long
def test_of_tasks_at_once_one_compiles_and_where_it_is_killed_another_goes_on(start, tmp_path):
    killed = start(stop_after=2)
    assert killed.stdout.readline() == "stopped\n"
    others = [start(), start()]
    for each in others:
        wait_until(lambda each=each: holds_open(each, tmp_path / "code" / "compiled" / "lock"))
    compiled = (tmp_path / "log").read_text().split()
    assert len(compiled) == 2
    killed.kill()
    assert [each.wait(timeout=120.0) for each in others] == [0, 0]
    # Each once, by whoever it was: nothing was lost, and nothing made by two.
    compiled = (tmp_path / "log").read_text().split()
    assert sorted(compiled) == sorted(SAVED)


def test_it_does_not_begin_where_memory_is_short_and_says_so(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    # Another test of this process may have seen all groups ready.
    monkeypatch.setattr(compiled_code, "_ready", set())
    available, told, compiled = [800.0, 1200.0, 2500.0], [], []
    monkeypatch.setattr(task, "_available_mb", lambda: available.pop(0))
    monkeypatch.setattr(task, "_LOOK_SECONDS", 0.0)
    monkeypatch.setattr(task, "_alongside", lambda: nullcontext(None))
    monkeypatch.setattr(task, "compile_group", compiled.append)
    task._compile(lambda how_far: told.append((how_far, list(compiled))), waits_for_memory=True)
    assert (tuple(compiled), available) == (GROUPS, [])
    waiting = [(how_far, done) for how_far, done in told if how_far.waits]
    assert waiting == [
        (Kernels(0, KERNELS, None, waits=f"{mb} MB of memory are available, and compiling needs 2000"), [])
        for mb in (800, 1200)
    ]
    assert str(waiting[0][0]).startswith("not compiled yet: 800 MB")
    assert Kernels.read(json.loads(json.dumps(waiting[0][0].document()))) == waiting[0][0]


@pytest.mark.parametrize("deaths", [2, 3])
def test_a_task_that_is_killed_is_started_again_some_times(tmp_path, monkeypatch, deaths):
    log = tmp_path / "log"
    command = [sys.executable, "-c", DYING, str(log), str(deaths)]
    monkeypatch.setattr(compiling, "worker_command", lambda *_, **__: command)
    of_worker = Compiling(lambda: None)
    fault = of_worker.run(lambda: False)
    # Its second process, which holds its pipes, has not outlived it: else this would have waited.
    assert len(log.read_text().split()) == 3
    if deaths == 2:
        assert (fault, of_worker.kernels) == (None, None)
    else:
        assert fault == "kernels are not compiled: the task died of SIGKILL"
        assert of_worker.kernels == Kernels(0, KERNELS, None, "the task died of SIGKILL")
