from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.record_examples import CERTIFIED, SWEEP
from tests.support.serving import Service, serving


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service with a job, a solution with enclosures and a sweep, so that what shows them has something."""
    # A job that a request has left running is not waited for.
    with serving(Path(tmp_path_factory.mktemp("service")), POLHODE_GRACE_SECONDS="0.5") as running:
        running.solve(CERTIFIED)
        assert running.call("POST", "/v1/sweeps", SWEEP).status == 202
        yield running
