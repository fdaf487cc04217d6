"""A worker whose database is away for hours says so once, and once that it is back."""

import logging
import sqlite3

from sqlalchemy import exc

from service.storage.database.sqlite_file import DatabaseFileError
from workers.process.loop import EngineLoop
from workers.process.waker import Waker


class Nobody:
    """A runner and a presence with nothing to do, whose database is away for some turns."""

    def __init__(self, turns_away):
        self.turns_away = turns_away
        self.is_busy = False
        self.loop = None

    def collect(self, *, refill):
        if self.turns_away:
            self.turns_away -= 1
            gone: sqlite3.Error = DatabaseFileError("the file is gone")
            raise exc.OperationalError("SELECT 1", {}, gone)
        return []

    def fill(self):
        self.loop.stop()
        return []

    def keep(self, *, is_warm, kernels):
        pass

    def keep_leases(self):
        pass

    reconcile = give_back = keep_leases

    def seconds_left(self):
        return 0.0


def test_it_is_told_once_and_once_that_it_is_over(monkeypatch, caplog):
    monkeypatch.setattr("workers.process.loop._AWAY_SECONDS", 0.0)
    nobody, waker = Nobody(turns_away=1000), Waker()
    nobody.loop = EngineLoop(
        nobody,
        nobody,
        waker,
        line=None,
        announcements=None,
        takes_jobs=lambda: True,
        is_warm=lambda: True,
        kernels=lambda: None,
        poll_seconds=0.0,
        grace_seconds=0.0,
    )
    with caplog.at_level(logging.INFO, logger="workers"):
        nobody.loop.run()
    waker.close()
    assert nobody.turns_away == 0
    assert [record.getMessage() for record in caplog.records] == [
        "the database cannot be reached; trying again until it can",
        "the database can be reached again",
    ]
