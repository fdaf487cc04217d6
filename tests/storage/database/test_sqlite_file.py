"""Nothing is acknowledged that goes to a file which is deleted, replaced or not writable; readyz says so."""

import os
import shutil
import sqlite3
import stat
from collections import namedtuple
from pathlib import Path

import pytest
from sqlalchemy import event, exc, make_url, text

from service.app import create_app
from service.settings import Settings
from service.storage.database import availability
from service.storage.database.availability import LEAST_FREE_BYTES, DatabaseFile, is_away
from service.storage.database.database import Database
from service.storage.database.migration import migrate
from service.storage.inspection.inspect import inspect
from service.storage.upkeep.backup import back_up, restore
from service.storage.upkeep.presence import ServicePresence
from tests.support.api import STATE, TestClient
from tests.support.databases import url_of
from tests.support.postgres import binaries
from tests.support.waiting import wait_until

Disk = namedtuple("Disk", "f_blocks f_bfree f_bavail f_frsize")


@pytest.fixture
def file(sqlite_url):
    return Path(make_url(sqlite_url).database)


@pytest.fixture
def client(sqlite_url, verdicts):
    with TestClient(
        create_app(Settings(database_url=sqlite_url), sandbox=verdicts), raise_server_exceptions=False
    ) as client:
        assert client.post("/v1/jobs", json=STATE).status_code == 202
        assert client.get("/readyz").status_code == 200
        yield client


def presence_of(client):
    return client.app.state.resources.presence


def not_ready(client):
    answer = client.get("/readyz")
    assert answer.status_code == 503
    return answer.json()["checks"]["database"]


def assert_nothing_is_acknowledged(client):
    answer = client.post("/v1/jobs", json={**STATE, "time": {"stop": 21, "samples": 201}})
    assert answer.status_code == 503
    assert int(answer.headers["retry-after"]) > 0
    # What is read there would be gone soon, too.
    assert client.get("/v1/jobs").status_code == 503


def test_a_deleted_file_gets_no_jobs_and_is_not_made_anew(client, file):
    file.unlink()
    assert_nothing_is_acknowledged(client)
    assert "deleted or moved" in not_ready(client)
    assert not file.exists()


def test_a_file_that_comes_back_is_used_again(client, file):
    away = file.with_name("away.db")
    file.rename(away)
    assert_nothing_is_acknowledged(client)
    away.rename(file)
    assert client.post("/v1/jobs", json=STATE).status_code == 202
    presence_of(client).write()
    assert client.get("/readyz").status_code == 200


def test_a_replaced_file_gets_no_jobs_until_the_service_starts_anew(client, file, sqlite_url, tmp_path):
    back_up(sqlite_url, tmp_path / "copy")
    (tmp_path / "copy").replace(file)
    assert_nothing_is_acknowledged(client)
    assert "replaced" in not_ready(client)


def test_a_file_replaced_within_a_transaction_makes_it_fail(sqlite_url, file, tmp_path):
    database = Database(sqlite_url)
    shutil.copy(file, tmp_path / "copy")

    def write_while_it_is_replaced():
        with database.write() as session:
            session.execute(text("INSERT INTO workers VALUES ('w', 'h', 'local', 1, 0, 0, true, null, null)"))
            (tmp_path / "copy").replace(file)

    with pytest.raises(exc.OperationalError, match="replaced") as lost:
        write_while_it_is_replaced()
    assert is_away(lost.value)
    database.close()


def test_a_missing_database_is_not_made_by_those_who_use_it(tmp_path):
    database = Database(url_of(tmp_path / "missing.db"))
    with (
        pytest.raises(exc.OperationalError, match="polhode migrate makes it") as missing,
        database.read() as session,
    ):
        session.execute(text("SELECT 1"))
    assert is_away(missing.value)
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_becomes_read_only_is_told_by_readyz(client):
    def refuse(connection, _):
        connection.execute("PRAGMA query_only = ON")

    engine = client.app.state.resources.database.engine
    event.listen(engine, "connect", refuse)
    engine.dispose()
    wait_until(lambda: client.get("/readyz").status_code == 503)
    assert "readonly" in not_ready(client)
    event.remove(engine, "connect", refuse)
    engine.dispose()
    wait_until(lambda: client.get("/readyz").status_code == 200)


def test_a_write_that_waits_too_long_is_told_by_readyz(client, file):
    holder = sqlite3.connect(file, isolation_level=None)
    holder.execute("BEGIN EXCLUSIVE")
    presence = presence_of(client)
    presence._seconds = 0.05
    wait_until(lambda: "waiting" in (presence.fault() or ""))
    assert "a write has been waiting" in not_ready(client)
    holder.execute("ROLLBACK")
    holder.close()
    presence._seconds = 60.0
    wait_until(lambda: client.get("/readyz").status_code == 200)


@pytest.mark.parametrize(("is_root", "is_full"), [(True, False), (False, True)])
def test_a_full_disk_is_told_and_what_is_reserved_for_root_is_his(file, monkeypatch, is_root, is_full):
    monkeypatch.setattr(os, "statvfs", lambda _: Disk(1000, 500, 0, LEAST_FREE_BYTES))
    monkeypatch.setattr(os, "geteuid", lambda: 0 if is_root else 1000)
    assert (DatabaseFile(file).fault() == "the disk of the database is full") is is_full


def mode_of(path):
    return stat.S_IMODE(path.stat().st_mode)


def test_databases_and_backups_are_their_owners_alone_from_the_first_byte(tmp_path):
    before = os.umask(0)
    try:
        migrate(url_of(tmp_path / "new.db"))
        database = Database(url_of(tmp_path / "new.db"))
        with database.write() as session:
            session.execute(text("INSERT INTO workers VALUES ('w', 'h', 'local', 1, 0, 0, true, null, null)"))
        back_up(url_of(tmp_path / "new.db"), tmp_path / "backup")
        restore(url_of(tmp_path / "restored.db"), tmp_path / "backup")
        modes = {path.name: mode_of(path) for path in tmp_path.iterdir()}
        database.close()
    finally:
        os.umask(before)
    assert modes == dict.fromkeys(
        ["new.db", "new.db-wal", "new.db-shm", "backup", "restored.db"], stat.S_IRUSR | stat.S_IWUSR
    )


def test_a_dump_of_postgres_is_its_owners_alone(postgres_url, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", f"{binaries()}{os.pathsep}{os.environ['PATH']}")
    before = os.umask(0)
    try:
        back_up(postgres_url, tmp_path / "dump")
    finally:
        os.umask(before)
    assert mode_of(tmp_path / "dump") == stat.S_IRUSR | stat.S_IWUSR


def test_a_backup_does_not_follow_a_link_that_waits_under_its_name(sqlite_url, tmp_path):
    (tmp_path / "precious").write_bytes(b"precious")
    (tmp_path / "backup.part").symlink_to(tmp_path / "precious")
    back_up(sqlite_url, tmp_path / "backup")
    assert (tmp_path / "precious").read_bytes() == b"precious"


def test_a_file_that_others_may_read_is_told_and_left_alone(sqlite_url, file):
    def told():
        database = Database(sqlite_url)
        try:
            (finding,) = (each for each in inspect(database) if each.code == "file_mode")
            return finding
        finally:
            database.close()

    file.chmod(0o640)
    finding = told()
    assert (finding.broken, finding.is_clean) == (1, True)
    assert "0640" in finding.examples[0]
    assert "chmod 600" in finding.examples[0]
    assert mode_of(file) == 0o640
    file.chmod(0o600)
    assert told().broken == 0


def test_a_log_that_a_reader_has_kept_is_cut_down_when_the_reader_has_gone(tmp_path, monkeypatch):
    monkeypatch.setattr(availability, "LOG_BYTES", 100_000)
    url = url_of(tmp_path / "polhode.db")
    migrate(url)
    database = Database(url)
    presence = ServicePresence(database)
    with database.read() as session:
        session.execute(text("SELECT count(*) FROM jobs")).all()
        for number in range(200):
            with database.write() as writing:
                writing.execute(text("UPDATE jobs SET note = 'x'"))
                writing.execute(
                    text("INSERT INTO workers (name, host, engine, slots, started_at, seen_at)"
                    " VALUES (:name, 'h', 'local', 1, 0, 0)"), {"name": f"{number} {'x' * 100}"},
                )  # fmt: skip
        grown = database.file.log_bytes()
        assert grown > 200_000
        presence.write()  # the reader still needs it, and the write is not kept waiting
        assert database.file.log_bytes() >= grown
        assert presence.fault() is None
    presence.write()
    assert database.file.log_bytes() <= 100_000
    with database.read() as session:
        assert session.execute(text("SELECT count(*) FROM workers")).scalar_one() == 201
    database.close()
