from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.serving import Service, serving


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with serving(Path(tmp_path_factory.mktemp("service"))) as running:
        yield running
