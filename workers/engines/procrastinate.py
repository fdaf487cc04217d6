"""What the engine for many machines adds to the loop: Postgres says that jobs were delivered."""

import contextlib

import psycopg
from psycopg import sql
from sqlalchemy import Engine

from service.storage.jobs.procrastinate_dispatcher import CHANNEL


class Notifications:
    """The :class:`~workers.engines.loop.Announcements` of Procrastinate's queue.

    They only save waiting: what is said while nobody listens is found by the
    next look.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._connection: psycopg.Connection | None = None

    def listen(self) -> None:
        """Listen by a connection of our own, made like the others; raises if the database is away."""
        if self._connection is not None:
            return
        ours = self._engine.raw_connection()
        connection = ours.driver_connection
        ours.detach()  # it does not go back to the pool
        assert isinstance(connection, psycopg.Connection)
        connection.autocommit = True
        connection.execute(sql.SQL("LISTEN {}").format(sql.Identifier(CHANNEL)))
        self._connection = connection

    def fileno(self) -> int:
        """Return the descriptor of the connection; -1 if there is none."""
        return -1 if self._connection is None else self._connection.fileno()

    def clear(self) -> None:
        """Swallow the notifications; a broken connection is made anew by the next :meth:`listen`."""
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
