"""Workers are seen as long as they live, and the local engine has its database to itself."""

import pytest
from sqlalchemy import select, update

from service.local.workers import OtherHostError, WorkerProcess, new_worker_name, this_host
from service.storage.tables.base import DatabaseNow
from service.storage.tables.operations import WorkerRow
from service.storage.upkeep.presence import FORGOTTEN_SECONDS, WorkerRegistry
from tests.support.commands import polhode

LEASE = 10.0


@pytest.fixture
def registry(database):
    return WorkerRegistry(database, lease_seconds=LEASE)


def worker(host="here", name="worker"):
    return WorkerProcess(name, host, "local", 2)


def names(database):
    with database.read() as session:
        return set(session.scalars(select(WorkerRow.name)))


def let_pass(database, seconds):
    with database.write() as session:
        session.execute(update(WorkerRow).values(seen_at=DatabaseNow() - seconds))


def test_a_worker_is_there_from_its_start_to_its_end(registry, database):
    registry.enter(worker(), alone=True)
    registry.see(worker(), is_warm=True)
    assert names(database) == {"worker"}
    registry.leave(worker())
    assert names(database) == set()


def test_workers_of_one_host_work_together(registry, database):
    registry.enter(worker(name="first"), alone=True)
    registry.enter(worker(name="second"), alone=True)
    assert names(database) == {"first", "second"}


def test_beside_a_living_worker_of_another_host_a_local_one_does_not_start(registry, database):
    registry.enter(worker("there", "other"), alone=False)
    let_pass(database, 2.5 * LEASE)
    with pytest.raises(OtherHostError, match=r"there works .* POLHODE_ENGINE=postgres"):
        registry.enter(worker(), alone=True)
    assert names(database) == {"other"}
    registry.enter(worker(), alone=False)


def test_the_silent_are_taken_to_be_gone_and_the_long_silent_forgotten(registry, database):
    registry.enter(worker("there", "other"), alone=True)
    let_pass(database, 3.5 * LEASE)
    registry.enter(worker(), alone=True)
    assert names(database) == {"worker", "other"}
    let_pass(database, FORGOTTEN_SECONDS + 1)
    registry.see(worker(), is_warm=True)
    assert names(database) == {"worker"}


def test_a_refused_worker_ends_with_1_and_the_reason(registry, url, monkeypatch, capsys):
    registry.enter(worker("there", "other"), alone=False)
    monkeypatch.setenv("POLHODE_HOST_NAME", "here")
    assert polhode("worker", "--database-url", url) == 1
    assert "there works on this database" in capsys.readouterr().err


def test_hosts_and_workers_have_names_of_their_own():
    assert this_host() == this_host()
    assert new_worker_name("a") != new_worker_name("a")
    assert new_worker_name("x" * 300).startswith("x" * 64 + ":")
