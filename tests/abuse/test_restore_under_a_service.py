"""A database is not replaced under a service or a worker; those that were killed are forgotten."""

import os

import pytest
from sqlalchemy import text, update

from service.app import create_app
from service.local.workers import WorkerProcess
from service.settings import Settings
from service.storage.database.database import make_engine
from service.storage.tables.base import DatabaseNow
from service.storage.tables.operations import WorkerRow
from service.storage.upkeep.backup import BackupError, back_up, restore
from service.storage.upkeep.presence import GONE_SECONDS, ServicePresence, WorkerRegistry, who_is_present
from tests.support.api import TestClient
from tests.support.postgres import binaries
from tests.support.waiting import wait_until


@pytest.fixture(autouse=True)
def client_programs(monkeypatch):
    monkeypatch.setenv("PATH", f"{binaries()}{os.pathsep}{os.environ['PATH']}")


@pytest.fixture
def backup(url, tmp_path):
    back_up(url, tmp_path / "backup")
    return tmp_path / "backup"


def rows(database):
    with database.read() as session:
        return session.execute(text("SELECT engine, slots FROM workers")).all()


def let_pass(database, seconds):
    with database.write() as session:
        session.execute(update(WorkerRow).values(seen_at=DatabaseNow() - seconds))


def test_a_service_without_workers_is_present_until_it_ends(url, database, backup, verdicts):
    settings = Settings(database_url=url, host_name="here", workers=0)
    with TestClient(create_app(settings, sandbox=verdicts)) as client:
        wait_until(lambda: rows(database) == [("service", 0)])
        with pytest.raises(BackupError, match=r"a service of here .* stop the service and its workers first"):
            restore(url, backup, force=True)
        # It is no worker, and those of other hosts may begin.
        assert 'polhode_workers{engine="service"}' not in client.get("/metrics").text
        other = WorkerProcess("other", "there", "local", 1)
        WorkerRegistry(database, lease_seconds=10.0).enter(other, alone=True)
        WorkerRegistry(database, lease_seconds=10.0).leave(other)
    assert rows(database) == []
    restore(url, backup, force=True)


def test_a_worker_is_present_until_it_has_been_silent_for_long(url, database, backup):
    WorkerRegistry(database, lease_seconds=10.0).enter(WorkerProcess("w", "here", "local", 2), alone=False)
    with pytest.raises(BackupError, match=rf"a worker of here .* forgotten {GONE_SECONDS:.0f} s later"):
        restore(url, backup)
    let_pass(database, GONE_SECONDS + 1.0)
    restore(url, backup, force=True)


def test_a_service_that_was_killed_is_forgotten_by_itself(url, database, backup):
    killed = ServicePresence(database, host="here")
    killed.write()
    with pytest.raises(BackupError, match="a service of here"):
        restore(url, backup, force=True)
    let_pass(database, GONE_SECONDS + 1.0)
    restore(url, backup, force=True)


def test_a_clock_that_was_set_back_does_not_make_the_dead_present(database):
    ServicePresence(database, host="here").write()
    let_pass(database, -3600.0)
    with database.engine.connect() as connection:
        assert who_is_present(connection) == []


def test_who_was_there_when_the_backup_was_made_is_not_there_after_it_came_back(url, database, tmp_path):
    ServicePresence(database, host="here").write()
    back_up(url, tmp_path / "busy")
    let_pass(database, GONE_SECONDS + 1.0)
    restore(url, tmp_path / "busy", force=True)
    assert rows(database) == []


def test_a_service_writes_its_row_again_if_somebody_removed_it(database):
    presence = ServicePresence(database)
    presence.write()
    with database.write() as session:
        session.execute(text("DELETE FROM workers"))
    presence.write()
    assert rows(database) == [("service", 0)]


def test_a_later_schema_without_the_list_of_workers_can_be_replaced(url, database, backup):
    engine = make_engine(url)
    with engine.begin() as connection:
        connection.execute(text("DROP TABLE workers"))
    engine.dispose()
    restore(url, backup, force=True)
    assert rows(database) == []
