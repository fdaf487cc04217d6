"""The migrated schema is the one that the code expects."""

import re
import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import event, insert, inspect, text
from sqlalchemy.exc import DBAPIError

from service.jobs.queue import Lane
from service.storage.database import migration
from service.storage.database.database import make_engine
from service.storage.database.migration import migrate, migrations_folder
from service.storage.database.rows import new_id
from service.storage.jobs.queue import first_jobs
from service.storage.tables.jobs import JobRow
from service.storage.tables.operations import METADATA
from tests.support.databases import FIRST, upgrade_to, url_of


def test_the_models_and_the_migrations_make_one_schema(empty_url):
    """Columns with their types and defaults, keys, references, checks, indexes with their conditions."""
    migrate(empty_url)
    engine = make_engine(empty_url)
    by_models = parts_of(engine)
    with engine.begin() as connection:
        METADATA.drop_all(connection)
        connection.execute(text("DROP TABLE alembic_version"))
    upgrade_to(empty_url, "head")
    assert parts_of(engine) == by_models
    with engine.connect() as connection:
        options = {"compare_type": True, "include_object": is_told}
        context = MigrationContext.configure(connection, opts=options)
        assert compare_metadata(context, METADATA) == []
    engine.dispose()


def is_told(element, name, kind, reflected, other):
    # SQLite's reflection does not tell DESC.
    return name not in ("ix_jobs_queue", "ix_jobs_lanes")


_POSTGRES_PARTS = (
    "SELECT table_name, column_name, data_type, character_maximum_length, is_nullable, column_default "
    "FROM information_schema.columns WHERE table_schema = 'public'",
    "SELECT conrelid::regclass::text, conname, pg_get_constraintdef(oid) FROM pg_constraint "
    "WHERE connamespace = 'public'::regnamespace",
    "SELECT tablename, indexname, indexdef FROM pg_indexes WHERE schemaname = 'public'",
    "SELECT tgrelid::regclass::text, pg_get_triggerdef(oid) FROM pg_trigger WHERE NOT tgisinternal",
    "SELECT proname, prosrc FROM pg_proc WHERE pronamespace = 'public'::regnamespace",
    "SELECT 'alembic_version', version_num FROM alembic_version",
)


# Alembic lays its own table out otherwise.
_SQLITE_PARTS = "SELECT sql FROM sqlite_master WHERE sql IS NOT NULL AND tbl_name <> 'alembic_version'"


def parts_of(engine):
    """Return all that a schema is made of, in the database's own words, in an order of its own."""
    with engine.connect() as connection:
        if engine.dialect.name == "postgresql":
            rows = [tuple(row) for query in _POSTGRES_PARTS for row in connection.exec_driver_sql(query)]
            return sorted(rows, key=repr)
        statements = connection.exec_driver_sql(_SQLITE_PARTS)
        found = [lines_of(sql.replace('"', "")) for (sql,) in statements]
        return sorted([*found, list(connection.exec_driver_sql("SELECT * FROM alembic_version").one())])


def lines_of(statement):
    """Return the parts of a statement: columns that were added, and constraints, come in any order."""
    parts = re.split(r",(?![^()]*\))|\n", statement)
    return sorted(stripped for part in parts if (stripped := part.strip(" \t;")))


@pytest.mark.parametrize(("starved", "index"), [((), "ix_jobs_queue"), ((Lane.SWEEP,), "ix_jobs_lanes")])
def test_a_claim_needs_no_sorting_however_long_the_queue(database, starved, index):
    plans = []

    def explain(connection, cursor, statement, parameters, context, executemany):
        is_sqlite = connection.dialect.name == "sqlite"
        if statement.startswith("SELECT jobs.id"):
            cursor.execute(f"EXPLAIN {'QUERY PLAN' if is_sqlite else ''} {statement}", parameters)
            plans.append(str(cursor.fetchall()))

    common = {"state": "queued", "problem": {}, "digest": "x", "created_at": 0.0}
    rows = [{**common, "id": new_id(), "turn": float(k), "lane": 0 if k % 50 else 2} for k in range(2000)]
    with database.write() as session:
        session.execute(insert(JobRow), rows)
        # As Postgres does by itself after a while; without it, it takes the table for an empty one.
        session.execute(text("ANALYZE"))
    with database.write() as session:
        event.listen(database.engine, "before_cursor_execute", explain)
        taken = first_jobs(session.connection(), 2, starved)
    first = rows[0]["id"] if starved else rows[1]["id"]
    assert taken == [first, rows[2]["id"] if not starved else rows[1]["id"]]
    assert len(plans) == 1 + len(starved)
    assert index in plans[0]
    for plan in plans:
        assert "B-TREE" not in plan
        # Postgres; the keys within equal priorities are sorted by the index too.
        assert "Sort" not in plan


def test_a_new_database_has_all_of_its_tables_or_none(empty_url, monkeypatch):
    monkeypatch.setattr(migration, "_STAMP", "CREATE TABLE jobs (broken INTEGER)")
    with pytest.raises(DBAPIError, match="already exists"):
        migrate(empty_url)
    assert tables_of(empty_url) == set()
    monkeypatch.undo()
    migrate(empty_url)
    assert tables_of(empty_url) == {*METADATA.tables, "alembic_version"}


def tables_of(url):
    engine = make_engine(url)
    found = set(inspect(engine).get_table_names())
    engine.dispose()
    return found


def test_a_file_with_tables_of_somebody_else_keeps_them(tmp_path):
    connection = sqlite3.connect(tmp_path / "others.db")
    connection.executescript("CREATE TABLE theirs (x); INSERT INTO theirs VALUES (1);")
    connection.close()
    migrate(url_of(tmp_path / "others.db"))
    engine = make_engine(url_of(tmp_path / "others.db"))
    with engine.connect() as connection:
        assert connection.exec_driver_sql("SELECT x FROM theirs").all() == [(1,)]
    assert set(METADATA.tables) <= set(inspect(engine).get_table_names())
    engine.dispose()


def test_migrating_again_changes_nothing(url, database, jobs):
    job = jobs.submit({"x": 1}, "digest")
    migrate(url)
    assert jobs.get(job.id) == job


@pytest.mark.one_in(2)
@pytest.mark.parametrize("begin", ["empty", FIRST])
def test_several_processes_may_migrate_at_once(begin, empty_url):
    if begin != "empty":
        upgrade_to(empty_url, begin)
    # Alembic keeps its context in a module, so that processes it must be, not threads.
    import_and_migrate = f"from service.storage.database.migration import migrate; migrate({empty_url!r})"
    with ThreadPoolExecutor(3) as pool:
        results = list(pool.map(run_python, [import_and_migrate] * 3))
    assert [result.stderr for result in results] == [""] * 3
    assert set(METADATA.tables) <= tables_of(empty_url)


def test_a_folder_may_have_a_name_that_alembic_would_interpolate(tmp_path):
    (tmp_path / "100%").mkdir()
    url = url_of(tmp_path / "100%" / "old.db")
    upgrade_to(url, FIRST)
    migrate(url)
    assert set(METADATA.tables) <= tables_of(url)


def run_python(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


def test_the_database_keeps_a_write_ahead_log(sqlite_url):
    with make_engine(sqlite_url).connect() as connection:
        assert connection.exec_driver_sql("PRAGMA journal_mode").scalar() == "wal"
        assert connection.exec_driver_sql("PRAGMA synchronous").scalar() == 2  # FULL
        assert connection.exec_driver_sql("PRAGMA foreign_keys").scalar() == 1
        assert connection.exec_driver_sql("PRAGMA busy_timeout").scalar() == 30_000


def test_the_migrations_are_found():
    assert (migrations_folder() / "env.py").is_file()
