"""The migrated schema is the one that the code expects."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from sqlalchemy import CheckConstraint, inspect

from service.storage.accuracy_store import AccuracyStore
from service.storage.database import Database, make_engine
from service.storage.job_store import SqlJobStore
from service.storage.migration import migrate, migrations_folder
from service.storage.solution_store import SolutionQuery, SolutionStore
from service.storage.tables import Base
from tests.support import accuracy
from tests.support.databases import PROBLEM, SUMMARY, url_of


def test_the_models_are_the_migrated_schema(database):
    with database.engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, Base.metadata) == []


def test_the_checks_of_the_models_are_in_the_schema(database):
    # Autogenerate does not compare them.
    schema = inspect(database.engine)
    for table in Base.metadata.sorted_tables:
        expected = {str(c.name): str(c.sqltext) for c in table.constraints if isinstance(c, CheckConstraint)}
        assert {c["name"]: c["sqltext"] for c in schema.get_check_constraints(table.name)} == expected


def test_migrating_again_changes_nothing(url, database, jobs):
    job = jobs.submit({"x": 1}, "digest")
    migrate(url)
    assert jobs.get(job.id) == job


def upgrade_to(url, revision):
    config = Config()
    config.set_main_option("script_location", str(migrations_folder()))
    config.attributes["engine"] = engine = make_engine(url)
    command.upgrade(config, revision)
    engine.dispose()


def test_a_database_of_the_first_version_keeps_its_data(tmp_path):
    url = url_of(tmp_path / "old.db")
    upgrade_to(url, "0001")
    database = Database(url)
    jobs, solutions = SqlJobStore(database), SolutionStore(database)
    jobs.submit(PROBLEM, "digest")
    jobs.finish_success(jobs.claim("worker", lease_seconds=60), SUMMARY, dense=b"d", samples=b"s")
    before = jobs.list_jobs(), solutions.find(SolutionQuery())
    assert "calibrations" not in inspect(database.engine).get_table_names()
    migrate(url)
    assert (jobs.list_jobs(), solutions.find(SolutionQuery())) == before
    assert solutions.dense(before[1].solutions[0].id) == b"d"
    AccuracyStore(database).add(accuracy.table())
    assert AccuracyStore(database).latest() == accuracy.table()
    database.close()


def test_several_processes_may_migrate_at_once(tmp_path):
    url = url_of(tmp_path / "100%" / "new.db")
    (tmp_path / "100%").mkdir()
    # Alembic keeps its context in a module, so that processes it must be, not threads.
    import_and_migrate = f"from service.storage.migration import migrate; migrate({url!r})"
    with ThreadPoolExecutor(3) as pool:
        results = list(pool.map(run_python, [import_and_migrate] * 3))
    assert [result.stderr for result in results] == [""] * 3
    engine = make_engine(url)
    assert set(Base.metadata.tables) <= set(inspect(engine).get_table_names())
    engine.dispose()


def run_python(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


def test_the_database_keeps_a_write_ahead_log(database):
    with database.engine.connect() as connection:
        assert connection.exec_driver_sql("PRAGMA journal_mode").scalar() == "wal"
        assert connection.exec_driver_sql("PRAGMA synchronous").scalar() == 2  # FULL
        assert connection.exec_driver_sql("PRAGMA foreign_keys").scalar() == 1
        assert connection.exec_driver_sql("PRAGMA busy_timeout").scalar() == 30_000


def test_the_migrations_are_found():
    assert (migrations_folder() / "env.py").is_file()
