from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.record_examples import CERTIFIED, SWEEP
from tests.support.serving import Service, serving


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service with a job, a solution with enclosures and a sweep, so that what shows them has something."""
    settings = {
        # A job that a request has left running is not waited for.
        "POLHODE_GRACE_SECONDS": "0.5",
        # Half of it is what a search is waited for, and most of those that are made up take longer.
        "POLHODE_VERDICT_SECONDS": "4",
    }
    with serving(Path(tmp_path_factory.mktemp("service")), **settings) as running:
        running.solve(CERTIFIED)
        assert running.call("POST", "/v1/sweeps", SWEEP).status == 202
        yield running
