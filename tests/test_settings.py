"""Settings come from the environment, when asked, and wrong ones are refused."""

import pytest
from pydantic import ValidationError

from service.settings import Settings


def test_the_defaults_are_those_of_the_contract(monkeypatch):
    for name in ("DATABASE_URL", "HOST", "PORT", "LEASE_SECONDS", "ENGINE"):
        monkeypatch.delenv(f"POLHODE_{name}", raising=False)
    settings = Settings()
    assert settings.database_url == "sqlite:///polhode.db"
    assert (settings.host, settings.port, settings.lease_seconds) == ("127.0.0.1", 8000, 10.0)
    assert settings.engine == "local"


def test_the_environment_is_read_when_asked(monkeypatch):
    monkeypatch.setenv("POLHODE_JOB_SECONDS", "12.5")
    assert Settings().job_seconds == 12.5
    monkeypatch.setenv("POLHODE_JOB_SECONDS", "13")
    assert Settings().job_seconds == 13.0


def test_the_engine_of_several_machines_needs_postgres_and_has_a_former_name(monkeypatch):
    monkeypatch.setenv("POLHODE_ENGINE", "procrastinate")
    assert Settings(database_url="postgresql+psycopg://host/name").engine == "postgres"
    with pytest.raises(ValidationError, match=r"needs Postgres.* accepted are"):
        Settings(database_url="sqlite:///polhode.db")


@pytest.mark.parametrize(
    ("name", "value"), [("LEASE_SECONDS", "0"), ("WORKERS", "-1"), ("ENGINE", "magic"), ("PORT", "70000")]
)
def test_impossible_settings_are_refused(monkeypatch, name, value):
    monkeypatch.setenv(f"POLHODE_{name}", value)
    with pytest.raises(ValidationError, match=name.lower()):
        Settings()
