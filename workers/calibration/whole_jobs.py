"""Times whole jobs, from submission to stored solution, on a temporary database."""

import json
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from service.sandbox import Sandbox
from service.storage.database.database import Database
from service.storage.database.migration import migrate
from service.storage.database.rows import new_id
from service.storage.jobs.job_store import SqlJobStore
from workers.computation.compute import solve_document

_LEASE_SECONDS = 3600.0

SecondsOf = Callable[[str], float]
"""Measures the seconds of a problem, given as JSON."""


@contextmanager
def whole_jobs() -> Iterator[SecondsOf]:
    """Yield a function that times a job: submitted, claimed, solved by a child process, and stored."""
    with tempfile.TemporaryDirectory(prefix="polhode-calibration-") as folder:
        url = f"sqlite:///{Path(folder) / 'jobs.db'}"
        migrate(url)
        database = Database(url)
        sandbox = Sandbox(1, preload=["workers.computation.compute"])
        jobs = SqlJobStore(database)

        def seconds_of(document: str) -> float:
            problem = json.loads(document)
            began = time.perf_counter()
            # A digest of its own, so that nothing is reused.
            jobs.submit(problem, new_id())
            claim = jobs.claim("calibration", lease_seconds=_LEASE_SECONDS)
            assert claim is not None
            outcome = sandbox.run(solve_document, json.dumps(claim.payload), seconds=None)
            jobs.finish(claim, outcome)
            return time.perf_counter() - began

        try:
            sandbox.start()
            yield seconds_of
        finally:
            sandbox.close()
            database.close()
