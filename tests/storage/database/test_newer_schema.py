"""A database of a later version: every command says so in one line, changes nothing, and has no traceback."""

import subprocess
import sys
from pathlib import Path

import pytest
from sqlalchemy import text
from typer.testing import CliRunner

from service.app import create_app
from service.cli.commands import app
from service.local.wakeup import WakeUpSocket
from service.settings import Settings
from service.storage.database.database import make_engine
from service.storage.database.migration import UnknownRevisionError, migrate, newest_revision
from tests.support.api import TestClient
from tests.support.commands import polhode
from workers.cli.main import run

POLHODE = Path(sys.executable).with_name("polhode")


@pytest.fixture
def newer_url(url, monkeypatch):
    """A database that a later version has upgraded."""
    engine = make_engine(url)
    with engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    monkeypatch.setenv("POLHODE_DATABASE_URL", url)
    yield url
    with engine.connect() as connection:
        assert connection.execute(text("SELECT version_num FROM alembic_version")).all() == [("9999",)]
    engine.dispose()


def assert_said(said):
    assert "schema 9999, made by a later version" in said
    assert newest_revision() in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    "arguments",
    [
        ["migrate"],
        ["keys", "list"],
        ["keys", "create", "--role", "read"],
        ["keys", "revoke", "plh_12345678"],
        ["prune", "--samples-older-than", "1d"],
        ["calibrate", "--quick"],
    ],
    ids=" ".join,
)
def test_commands_refuse_it_in_one_line(newer_url, arguments):
    result = CliRunner().invoke(app, arguments)
    assert (result.exit_code, result.stdout) == (1, "")
    assert result.stderr.count("\n") == 1
    assert_said(result.stderr)


@pytest.mark.parametrize("is_alone", [True, False], ids=["alone", "by a service"])
def test_a_worker_refuses_it_in_one_line(newer_url, is_alone, capsys, monkeypatch):
    # A worker chooses one thread for its process; later tests here, and their children, keep what they had.
    monkeypatch.setattr("workers.process.start.use_one_thread", lambda: None)
    monkeypatch.setattr("workers.cli.main.start_logging", lambda *_: None)
    wake_up = WakeUpSocket()
    assert run(wake_fd=None if is_alone else wake_up.new_socket().detach()) == 1
    wake_up.close()
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert_said(said)


@pytest.mark.any_database
def test_serve_refuses_it_in_one_line(newer_url, tmp_path):
    command = [POLHODE, "serve", "--port", "0"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert_said(done.stderr)


def test_the_doctor_says_whose_it_is_and_mends_nothing(newer_url, capsys):
    assert polhode("doctor", "--fix") == 1
    said = capsys.readouterr()
    assert_said(said.out)
    assert "polhode migrate" not in said.out
    assert said.err == ""


def test_a_service_under_which_it_was_upgraded_is_not_ready(newer_url, verdicts):
    with TestClient(create_app(Settings(database_url=newer_url), sandbox=verdicts)) as client:
        answer = client.get("/readyz")
    assert answer.status_code == 503
    assert_said(answer.json()["checks"]["database"])


def test_a_backup_of_it_is_made_and_told_for_what_it_is(sqlite_url, tmp_path):
    engine = make_engine(sqlite_url)
    with engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    engine.dispose()
    file, choice = str(tmp_path / "backup"), ["--database-url", sqlite_url]
    made = CliRunner().invoke(app, ["backup", file, *choice])
    assert made.exit_code == 0
    assert "schema 9999, which this version cannot restore: made by a later version" in made.stderr
    refused = CliRunner().invoke(app, ["restore", file, "--force", *choice])
    assert refused.exit_code == 1
    assert "9999, which this version does not know" in refused.stderr


def test_it_is_refused_before_anything_is_changed(newer_url):
    with pytest.raises(UnknownRevisionError) as refused:
        migrate(newer_url)
    assert refused.value.stored == "9999"


def test_an_early_schema_is_told_what_upgrades_it_first(sqlite_url):
    engine = make_engine(sqlite_url)
    with engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '0007'"))
    engine.dispose()
    with pytest.raises(
        UnknownRevisionError, match=r"0007, made by an early version.*revision d38f90f upgrades"
    ):
        migrate(sqlite_url)
