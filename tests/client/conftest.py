import matplotlib
import pytest

import polhode as ph
from tests.end_to_end.conftest import service

matplotlib.use("Agg")  # pictures without a screen

__all__ = ["service"]


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
