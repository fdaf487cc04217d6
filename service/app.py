"""The HTTP application: what it owns, from start to end."""

import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import FastAPI

from service.api.resources import Resources
from service.api.routes import install
from service.jobs.wakeup import Doorbell
from service.sandbox import Sandbox
from service.settings import Settings
from service.storage.database import Database
from service.storage.job_store import SqlJobStore
from service.storage.solution_store import SolutionStore

VERDICT_WORKERS = 2
"""Children that reach verdicts: one slow formula must not stop everybody else's."""
WAITING_PLACES = 16
"""Clients that may wait for jobs at the same time; each takes one of the server's 40 threads."""


def create_app(settings: Settings, *, doorbell: Doorbell | None = None) -> FastAPI:
    """Return the application on a database that has been migrated.

    ``doorbell`` is given by whoever also starts local workers and then closes
    it; without one the application has its own, which nobody hears.
    """
    bell = doorbell or Doorbell()

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        database = Database(settings.database_url)
        sandbox = Sandbox(VERDICT_WORKERS, memory_mb=settings.job_memory_mb, preload=("service.examination",))
        sandbox.start()
        app.state.resources = Resources(
            settings=settings,
            database=database,
            jobs=SqlJobStore(database),
            solutions=SolutionStore(database),
            sandbox=sandbox,
            doorbell=bell,
            waiting=threading.BoundedSemaphore(WAITING_PLACES),
        )
        try:
            yield
        finally:
            sandbox.close()
            database.close()
            if doorbell is None:
                bell.close()

    app = FastAPI(title="polhode", lifespan=lifespan)
    install(app)
    return app
