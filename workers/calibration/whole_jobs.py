"""Whole jobs as a user pays for them, on a database of their own."""

import json
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from service.sandbox import Sandbox
from service.storage.database import Database
from service.storage.ids import new_id
from service.storage.jobs.job_store import SqlJobStore
from service.storage.migration import migrate
from workers.computation import solve_document

_LEASE_SECONDS = 3600.0

SecondsOf = Callable[[str], float]
"""What a problem, as JSON, takes."""


@contextmanager
def whole_jobs() -> Iterator[SecondsOf]:
    """Yield what measures a job: submitted, claimed, solved by a child process, and stored."""
    with tempfile.TemporaryDirectory(prefix="polhode-calibration-") as folder:
        url = f"sqlite:///{Path(folder) / 'jobs.db'}"
        migrate(url)
        database = Database(url)
        sandbox = Sandbox(1, preload=["workers.computation"])
        jobs = SqlJobStore(database)

        def seconds_of(document: str) -> float:
            problem = json.loads(document)
            began = time.perf_counter()
            # A digest of its own: nothing is reused.
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
