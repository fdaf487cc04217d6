"""The migrated schema is the one that the code expects."""

import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import CheckConstraint, event, insert, inspect, text
from sqlalchemy.exc import OperationalError

from service.jobs.lanes import Lane
from service.storage.database import new_file
from service.storage.database.database import Database, make_engine
from service.storage.database.ids import new_id
from service.storage.database.migration import migrate
from service.storage.database.revisions import migrations_folder
from service.storage.jobs.job_store import SqlJobStore
from service.storage.jobs.table_dispatcher import TableDispatcher
from service.storage.solutions.accuracy_store import AccuracyStore
from service.storage.solutions.solution_store import SolutionStore
from service.storage.tables.jobs import JobRow
from service.storage.tables.schema import METADATA
from tests.support import accuracy
from tests.support.databases import upgrade_to, url_of
from tests.support.new_file import migrated, schema_of, statements_of


def is_comparable(element, name, kind, reflected, other):
    # SQLite's reflection does not tell DESC; the plans of claims, below, say that the indexes serve.
    return name not in ("ix_jobs_queue", "ix_jobs_lanes")


def test_the_models_are_the_migrated_schema(database):
    with database.engine.connect() as connection:
        options = {"compare_type": True, "include_object": is_comparable}
        context = MigrationContext.configure(connection, opts=options)
        assert compare_metadata(context, METADATA) == []


def test_the_checks_of_the_models_are_in_the_schema(database):
    # Autogenerate does not compare them.
    schema = inspect(database.engine)
    for table in METADATA.sorted_tables:
        expected = {str(c.name): str(c.sqltext) for c in table.constraints if isinstance(c, CheckConstraint)}
        found = {c["name"]: c["sqltext"] for c in schema.get_check_constraints(table.name)}
        if database.engine.dialect.name == "sqlite":
            assert found == expected
        else:  # Postgres tells a condition in its own words
            assert found.keys() == expected.keys()


@pytest.mark.parametrize(("owed", "index"), [((), "ix_jobs_queue"), ((Lane.SWEEP,), "ix_jobs_lanes")])
def test_a_claim_needs_no_sorting_however_long_the_queue(database, owed, index):
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
        taken = TableDispatcher().take(session.connection(), 2, owed)
    first = rows[0]["id"] if owed else rows[1]["id"]
    assert taken == [first, rows[2]["id"] if not owed else rows[1]["id"]]
    assert len(plans) == 1 + len(owed)
    assert index in plans[0]
    for plan in plans:
        assert "B-TREE" not in plan
        # Postgres; the keys within equal priorities are sorted by the index too.
        assert "Sort" not in plan


def test_a_new_file_is_what_all_migrations_make(tmp_path):
    new, by_migrations = tmp_path / "new.db", migrated(tmp_path)
    migrate(url_of(new))
    assert contents(new) == contents(by_migrations)
    # If this fails after a migration was added: python -m tests.support.new_file
    assert [lines_of(each) for each in new_file.statements()] == [
        lines_of(each) for each in statements_of(by_migrations)
    ]


def contents(file):
    """Everything in a file: tables and indexes in their order, columns in theirs, rows, mode of its log."""
    connection = sqlite3.connect(file)
    mode = connection.execute("PRAGMA journal_mode").fetchall()
    names = connection.execute("SELECT type, name, tbl_name FROM sqlite_master ORDER BY rowid").fetchall()
    tables = [name for kind, name, _ in names if kind == "table"]
    columns = [connection.execute(f"PRAGMA table_xinfo({name})").fetchall() for name in tables]
    text = [lines_of(statement) for statement in connection.iterdump()]
    connection.close()
    return mode, names, columns, text


def lines_of(statement):
    """Return the lines of a statement: Alembic writes the constraints of a table in any order."""
    return sorted(line.strip(" \t,;") for line in statement.splitlines())


def test_a_new_file_has_all_of_its_tables_or_none(tmp_path, monkeypatch):
    made = new_file.statements()
    monkeypatch.setattr(new_file, "statements", lambda: [*made, "CREATE TABLE jobs (broken)"])
    with pytest.raises(OperationalError, match="already exists"):
        migrate(url_of(tmp_path / "new.db"))
    assert schema_of(tmp_path / "new.db") == []
    monkeypatch.undo()
    migrate(url_of(tmp_path / "new.db"))
    assert schema_of(tmp_path / "new.db") == made[:-1]


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


def test_a_database_of_the_first_version_keeps_its_data(tmp_path):
    url = url_of(tmp_path / "old.db")
    upgrade_to(url, "0001")
    database = Database(url)
    job_id, solution_id = new_id(), new_id()
    with database.write() as session:
        session.execute(
            text(
                "INSERT INTO solutions (id, job_id, digest, problem, summary, created_at) "
                "VALUES (:id, :job, 'digest', '{}', '{}', 1.5)"
            ),
            {"id": solution_id.replace("-", ""), "job": job_id.replace("-", "")},
        )
        session.execute(
            text(
                "INSERT INTO jobs "
                "(id, state, attempt, progress, reused, solution_id, problem, digest, created_at) "
                "VALUES (:id, 'succeeded', 1, 1, 0, :solution, '{}', 'digest', 1.25)"
            ),
            {"id": job_id.replace("-", ""), "solution": solution_id.replace("-", "")},
        )
        session.execute(
            text("INSERT INTO attempts (job_id, number, worker, started_at) VALUES (:id, 1, 'w', 1.25)"),
            {"id": job_id.replace("-", "")},
        )
    migrate(url)
    jobs = SqlJobStore(database)
    assert jobs.get(job_id).solution_id == solution_id
    # Rebuilding the table of jobs must not take its attempts with it.
    assert [attempt.worker for attempt in jobs.attempts(job_id)] == ["w"]
    assert SolutionStore(database).get(solution_id).job_id == job_id
    AccuracyStore(database).add(accuracy.table())
    assert AccuracyStore(database).latest() == accuracy.table()
    database.close()


def test_several_processes_may_migrate_at_once(tmp_path):
    url = url_of(tmp_path / "100%" / "new.db")
    (tmp_path / "100%").mkdir()
    # Alembic keeps its context in a module, so that processes it must be, not threads.
    import_and_migrate = f"from service.storage.database.migration import migrate; migrate({url!r})"
    with ThreadPoolExecutor(3) as pool:
        results = list(pool.map(run_python, [import_and_migrate] * 3))
    assert [result.stderr for result in results] == [""] * 3
    engine = make_engine(url)
    assert set(METADATA.tables) <= set(inspect(engine).get_table_names())
    engine.dispose()


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
