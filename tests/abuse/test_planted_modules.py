"""Files that lie in the folder where the service is started are not executed, whatever they are called."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from service.storage.database.database import Database
from service.storage.tables.operations import WorkerRow
from tests.support.api import STATE
from tests.support.databases import url_of
from tests.support.serving import serving
from tests.support.waiting import wait_until

POLHODE = Path(sys.executable).with_name("polhode")
OURS = ("workers", "service", "migrations")
STANDARD = ("json", "logging", "multiprocessing", "signal", "socket", "site", "encodings")
LIBRARIES = ("numpy", "numba", "pebble", "sqlalchemy", "pydantic", "flint", "uvicorn", "heyoka")
STARTERS = ("sitecustomize", "usercustomize")


@pytest.fixture
def trap(tmp_path, monkeypatch):
    """A folder full of modules that leave a trace when they are executed."""
    # A sandbox of an earlier test makes this process safe, and all that it starts.
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    folder, trace = tmp_path / "trap", tmp_path / "trace"
    folder.mkdir()
    code = f"with open({str(trace)!r}, 'a') as trace: print(__name__, file=trace)\n"
    for name in (*OURS, *STANDARD, *LIBRARIES, *STARTERS):
        (folder / f"{name}.py").write_text(code)
    (folder / "problem.json").write_text(json.dumps(STATE))
    yield folder
    assert not trace.exists(), trace.read_text()


def test_the_trap_works(trap):
    subprocess.run([sys.executable, "-c", "import workers"], cwd=trap, check=True)
    trace = trap.with_name("trace")
    assert "workers" in trace.read_text().split()
    trace.unlink()


def test_serve_its_worker_and_their_children_execute_nothing_of_the_working_folder(trap):
    with serving(trap, workers=1) as service:
        service.solve(STATE)
        worker = subprocess.Popen([POLHODE, "worker"], cwd=trap, stderr=subprocess.DEVNULL)
        try:
            wait_until(lambda: len(registered(trap)) == 2, 60.0)
        finally:
            worker.terminate()
            worker.wait(timeout=60)


def registered(folder):
    database = Database(url_of(folder / "polhode.db"))
    with database.read() as session:
        found = [row.name for row in session.query(WorkerRow).where(WorkerRow.slots > 0)]
    database.close()
    return found


def test_a_child_of_a_command_executes_nothing_of_the_working_folder(trap):
    done = subprocess.run([POLHODE, "validate", "problem.json"], cwd=trap, capture_output=True, timeout=120)
    assert done.returncode == 0, done.stderr
