from collections.abc import Iterator

import matplotlib
import pytest

import polhode as ph
from tests.support.serving import Service, serving

matplotlib.use("Agg")  # pictures without a screen


@pytest.fixture(scope="session", params=["sqlite", pytest.param("postgres", marks=pytest.mark.long)])
def service(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A running service; whatever is asked of it is asked on Postgres too, in the long tests."""
    if request.param == "sqlite":
        yield request.getfixturevalue("running_service")
        return
    server = request.getfixturevalue("postgres")
    url = server.url(server.create_database(request.getfixturevalue("postgres_template")))
    with serving(tmp_path_factory.mktemp("service"), POLHODE_DATABASE_URL=url) as running:
        yield running


@pytest.fixture
def connected(service, tmp_path, monkeypatch):
    """A client of a running service, with a cache of its own."""
    monkeypatch.setenv("POLHODE_URL", service.address)
    monkeypatch.setenv("POLHODE_CACHE", str(tmp_path / "cache"))
    with ph.connect() as client:
        yield client


@pytest.fixture
def base():
    """A problem whose motion has a period of about 6.3."""
    return ph.problem(
        body=(2, 1), potential="a*g1 + b/g3^2", a=-1, b="1/20", lam=1, stop=10, samples=11, tolerance=1e-9
    )
