"""One planar job runs through few modules, so that one can follow it: from POST to samples.

Counted are modules of ``service`` and ``workers`` of which a function is called while a job that is not the
first is submitted, examined, computed and read: in the process of the API, in the child that examines, and in
the child that computes. What the worker does between them, claim and store, is not.
"""

import json
import sys
import threading
from pathlib import Path

import pytest

from service.app import create_app
from service.sandbox import Sandbox
from service.settings import Settings
from service.storage.database.database import Database
from service.storage.jobs.job_store import JobStore
from tests.support.api import PLANAR, AnyTestClient
from workers.process.tasks import PRELOAD, solve_problem

ROOT = Path(__file__).parents[1]
MOST = 170
"""Were 207 before modules became chapters; 165 now, and a few may come."""
OTHER = {**PLANAR, "potential": {"type": "gravity", "a": -1}}
FUNCTION = 2  # the flag CO_NEWLOCALS: what runs when a module is imported is no call of its functions

_called = set()


def _note(frame, event, _):
    if event == "call" and frame.f_code.co_flags & FUNCTION:
        _called.add(frame.f_code.co_filename)


def watch(is_on=True):
    """Note what is called in this thread, and if it is on in threads that begin later."""
    sys.setprofile(_note if is_on else None)
    threading.setprofile(_note if is_on else None)


def forget():
    _called.clear()


def called():
    """Return the modules of ours of which a function was called."""
    parts = tuple(f"{ROOT}/{part}/" for part in ("service", "workers"))
    return sorted(name.removeprefix(f"{ROOT}/") for name in list(_called) if name.startswith(parts))


@pytest.fixture
def children():
    """A child that examines, and one that computes."""
    preloads = (["service.verdicts.formulas", __name__], [*PRELOAD, __name__])
    sandboxes = [Sandbox(1, preload=preload) for preload in preloads]
    yield sandboxes
    for sandbox in sandboxes:
        sandbox.close()


def test_one_planar_job_runs_through_few_modules(children, sqlite_url):
    examiner, solver = children
    database = Database(sqlite_url)
    jobs = JobStore(database)
    try:
        for child in children:
            child.run(watch, seconds=None)
        watch()
        app = create_app(Settings(database_url=sqlite_url), sandbox=examiner)
        with AnyTestClient(app, "http://127.0.0.1:8000") as client:
            for document in (OTHER, PLANAR):
                for child in children:
                    child.run(forget, seconds=None)
                forget()
                assert client.post("/v1/jobs", json=document).status_code == 202
                # The rest of what this thread does is a worker's. Requests are answered by another one.
                watch(is_on=False)
                claim = jobs.claim("count", lease_seconds=60.0)
                outcome = solver.run(solve_problem, json.dumps(claim.payload), claim.windows, seconds=None)
                jobs.finish(claim, outcome)
                solution = client.get(f"/v1/jobs/{claim.job_id}").json()["solution"]
                for path in (f"/v1/solutions/{solution}", f"/v1/solutions/{solution}/trajectory"):
                    assert client.get(path).status_code == 200
    finally:
        watch(is_on=False)
        database.close()
    processes = {
        "API": set(called()),
        "child that examines": set(examiner.run(called, seconds=None)),
        "child that computes": set(solver.run(called, seconds=None)),
    }
    numbers = {process: len(names) for process, names in processes.items()}
    assert min(numbers.values()) > 20  # each of them was watched
    together = set().union(*processes.values())
    assert len(together) <= MOST, (len(together), numbers, sorted(together))
