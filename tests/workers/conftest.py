import pytest

from tests.workers.processes import Worker


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
