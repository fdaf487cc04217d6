import pytest

from tests.support.databases import database, jobs, solutions, template, url
from tests.workers.processes import Worker

__all__ = ["database", "jobs", "solutions", "start_worker", "template", "url"]


@pytest.fixture
def start_worker(url):
    """Start workers on the test's database; kill whatever is left of them."""
    workers = []

    def start(**options):
        workers.append(Worker(url, **options))
        return workers[-1]

    yield start
    for worker in workers:
        worker.clean_up()
