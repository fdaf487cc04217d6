"""Settings come from the environment, when asked, and wrong ones are refused."""

import pytest
from pydantic import ValidationError
from sqlalchemy import make_url

from service.settings import Settings, SettingsError, read_settings


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
    ("url", "said"),
    [
        # A database in memory would be another one in every process, and in every thread.
        ("sqlite://", "names no file"),
        ("sqlite:///", "names no file"),
        ("sqlite://polhode.db", "names no file"),
        ("sqlite:///:memory:", "names no file"),
        ("sqlite:///file:polhode.db?mode=memory&uri=true", "names no file"),
        ("sqlite:///polhode.db?mode=ro", r"\?mode=ro is no option"),
        ("sqlite:///polhode.db?timeout=long", r"\?timeout=long is no option"),
        ("sqlite:///polhode.db?timeout=1&cache=shared", "is no option"),
        ("postgres://me:secret@host/name", "^database_url: postgres:// is no database"),
        ("postgresql://me:secret@host/name", "postgresql:// is no database"),
        ("mysql://me:secret@host/name", "mysql:// is no database"),
        ("polhode.db", "it is no database"),
        ("me:secret", "it is no database"),
        ("", "it is no database"),
        ("postgresql+psycopg://me:secret@host:54x/name", "host or port"),
        ("postgresql+psycopg://me:secret@host:5432:1/name", "host or port"),
    ],
)
def test_addresses_that_cannot_be_used_are_refused_in_one_line_without_their_secrets(url, said):
    with pytest.raises(SettingsError, match=said) as refused:
        read_settings(database_url=url)
    message = str(refused.value)
    assert "accepted" in message
    assert "secret" not in message
    assert "\n" not in message


@pytest.mark.parametrize(
    "url",
    [
        "sqlite:///polhode.db",
        "sqlite:////var/lib/a folder/50%/polhode.db?timeout=2.5",
        "postgresql+psycopg://",
        "postgresql+psycopg://host",
        "postgresql+psycopg://me@[::1]:5432/name",
        "postgresql+psycopg://me:p/a?s:s%40#[@host/name?sslmode=require&connect_timeout=3",
        "postgresql+psycopg:///name?host=/var/run/postgresql",
    ],
)
def test_addresses_that_the_database_reads_are_accepted_as_they_are(url):
    assert read_settings(database_url=url).database_url == url
    # The library that will open it reads the same parts.
    parsed = make_url(url)
    assert parsed.get_backend_name() in ("sqlite", "postgresql")
    assert parsed.host in (None, "", "host", "::1")
    assert parsed.port in (None, 5432)
    assert parsed.database in (None, "name", "polhode.db", "/var/lib/a folder/50%/polhode.db")


def test_only_the_address_is_named_where_the_engine_depends_on_it():
    with pytest.raises(SettingsError) as refused:
        read_settings(database_url="mysql://host/name", engine="postgres")
    assert "engine" not in str(refused.value)


@pytest.mark.parametrize(
    ("host", "listens_on"), [("[::1]", "::1"), ("::1", "::1"), ("localhost", "localhost")]
)
def test_hosts_may_be_written_as_in_urls(host, listens_on):
    settings = Settings(host=host)
    assert (settings.host, settings.is_loopback) == (listens_on, True)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("LEASE_SECONDS", "0"),
        ("WORKERS", "-1"),
        ("ENGINE", "magic"),
        ("PORT", "70000"),
        ("JOB_MEMORY_MB", "50"),
    ],
)
def test_impossible_settings_are_refused(monkeypatch, name, value):
    monkeypatch.setenv(f"POLHODE_{name}", value)
    with pytest.raises(ValidationError, match=name.lower()):
        Settings()
