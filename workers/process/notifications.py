"""Notifications of queued jobs by Postgres, apart from the worker loop: only this module loads its driver."""

import contextlib

import psycopg
from psycopg import sql
from sqlalchemy import Engine

from service.storage.jobs.queue import CHANNEL


class Notifications:
    """Announcements of jobs that other machines have queued.

    They only shorten waiting: a job announced while not listening is found by
    the next poll.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._connection: psycopg.Connection | None = None

    def listen(self) -> None:
        """Listen on a connection of our own, made like the others; raises if the database is unreachable."""
        if self._connection is not None:
            return
        ours = self._engine.raw_connection()
        connection = ours.driver_connection
        ours.detach()  # it does not go back to the pool
        assert isinstance(connection, psycopg.Connection)  # SQLAlchemy gives it as any driver's
        connection.autocommit = True
        connection.execute(sql.SQL("LISTEN {}").format(sql.Identifier(CHANNEL)))
        self._connection = connection

    def fileno(self) -> int:
        """Return the descriptor to select on, that of the connection; -1 while not listening."""
        return -1 if self._connection is None else self._connection.fileno()

    def clear(self) -> None:
        """Discard the notifications; the next :meth:`listen` replaces a broken connection."""
        assert self._connection is not None
        try:
            for _ in self._connection.notifies(timeout=0):
                pass
        except psycopg.Error:
            self.close()

    def close(self) -> None:
        """Hang up."""
        if self._connection is not None:
            with contextlib.suppress(psycopg.Error):
                self._connection.close()
            self._connection = None
