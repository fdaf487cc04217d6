"""Every test here runs with every engine on every database that it serves."""

import pytest

from tests.support.databases import copy_of
from tests.support.effort import seldom
from tests.workers.process.engines.installation import installed

ENGINES = ["local on sqlite", *seldom("local on postgres"), "postgres on postgres"]


@pytest.fixture(scope="module", params=ENGINES)
def installation(request, postgres, postgres_template, sqlite_template, tmp_path_factory):
    """A database that no other module uses, and an engine."""
    engine, _, kind = request.param.split()
    folder = tmp_path_factory.mktemp("installation")
    if kind == "sqlite":
        with installed(copy_of(sqlite_template, folder), engine, folder) as made:
            yield made
        return
    name = postgres.create_database(postgres_template)
    with installed(postgres.url(name), engine, folder) as made:
        yield made
    postgres.drop_database(name)


@pytest.fixture
def jobs(installation):
    return installation.jobs


@pytest.fixture
def log(tmp_path):
    return tmp_path / "log"


@pytest.fixture
def submit(installation, log):
    """Submit chores, each of which is like no other, and notify."""
    numbers = iter(range(10**6))

    def submit(*, priority=0, **chore):
        number = f"{log}-{next(numbers)}"
        job = installation.jobs.submit(
            {"log": str(log), "number": number, **chore}, number[-60:], priority=priority
        )
        installation.wake_up.notify()
        return job

    return submit
