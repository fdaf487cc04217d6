"""A worker whose database is away for hours says so once, and once that it is back; so does a new worker."""

import logging
import sqlite3
from types import SimpleNamespace

import pytest
from sqlalchemy import exc

from service.local.workers import WorkerProcess
from service.storage.database.availability import DatabaseFileError
from service.storage.database.database import Database
from service.storage.upkeep.presence import WorkerRegistry
from tests.support.databases import copy_of
from workers.process.start import Waker
from workers.process.worker import EngineLoop, Presence


class Nobody:
    """A runner and a presence with nothing to do, whose database is away in some of its turns."""

    def __init__(self, away):
        self.away = list(away)
        self.is_busy = False
        self.loop = None

    def collect(self, *, refill):
        if self.away and self.away.pop(0):
            raise away()
        return []

    def fill(self):
        if not self.away:
            self.loop.stop()
        return []

    def keep(self, *, is_warm, kernels):
        pass

    def keep_leases(self):
        pass

    reconcile = give_back = keep_leases

    def seconds_left(self):
        return 0.0


def away():
    gone: sqlite3.Error = DatabaseFileError("the file is gone")
    return exc.OperationalError("SELECT 1", {}, gone)


def run(monkeypatch, caplog, nobody, presence):
    """Let a worker work until it has nothing to do; return what it says."""
    monkeypatch.setattr("workers.process.worker._AWAY_SECONDS", 0.0)
    waker = Waker()
    nobody.loop = EngineLoop(
        nobody,
        presence,
        waker,
        service=None,
        announcements=None,
        readiness=SimpleNamespace(may_take_jobs=lambda: True, is_over=lambda: True, kernels=lambda: None),
        poll_seconds=0.0,
        grace_seconds=0.0,
    )
    with caplog.at_level(logging.WARNING, logger="workers"):
        nobody.loop.run()
    waker.close()
    assert not nobody.away
    return [record.getMessage() for record in caplog.records]


AWAY = "the database cannot be reached; trying again until it can"
BACK = "the database can be reached again"


@pytest.mark.parametrize("turns", [[True] * 1000, [True, False] * 500], ids=["for long", "again and again"])
def test_it_is_told_once_and_once_that_it_is_over(monkeypatch, caplog, turns):
    nobody = Nobody(turns)
    assert run(monkeypatch, caplog, nobody, nobody) == [AWAY, BACK]


def test_a_worker_that_starts_meanwhile_enters_later(monkeypatch, caplog, tmp_path, sqlite_template):
    database = Database(copy_of(sqlite_template, tmp_path))
    registry = WorkerRegistry(database, lease_seconds=3600.0)
    enter, faults = registry.enter, [away(), away()]

    def tried(worker, *, alone):
        if faults:
            raise faults.pop()
        enter(worker, alone=alone)

    monkeypatch.setattr(registry, "enter", tried)
    presence = Presence(registry, WorkerProcess("w", "here", "local", 1), seconds=3600.0, alone=True)
    assert run(monkeypatch, caplog, Nobody([]), presence) == [AWAY, BACK]
    assert registry.state() == "warm"
    presence.end()
    assert registry.state() == "none"
    database.close()
