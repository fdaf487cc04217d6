"""Backups are whole while others write, and what is restored is a database in order."""

import os
import re
import sqlite3
import threading

import pytest
from sqlalchemy import func, inspect, select, text

from service.jobs.records import JobState
from service.storage.database.database import Database, make_engine
from service.storage.database.migration import migrate
from service.storage.database.rows import new_id
from service.storage.inspection.inspect import inspect as inspect_database
from service.storage.jobs.job_store import JobStore
from service.storage.solutions.solution_store import SolutionStore
from service.storage.tables.jobs import JobRow
from service.storage.upkeep.backup import BackupError, back_up, restore
from tests.support.databases import FIRST, PROBLEM, SUMMARY, empty_database, upgrade_to, url_of
from tests.support.finishing import finish_success
from tests.support.lists import list_jobs
from tests.support.postgres import binaries


@pytest.fixture(autouse=True)
def client_programs(monkeypatch):
    """Use the programs of the tests' own server: others may be older than it."""
    monkeypatch.setenv("PATH", f"{binaries()}{os.pathsep}{os.environ['PATH']}")


@pytest.fixture
def other_url(url, tmp_path, request):
    """An empty database of the same kind, never migrated."""
    kind = "sqlite" if url.startswith("sqlite") else "postgres"
    yield from empty_database(kind, request, tmp_path)


def fill(jobs):
    """Put jobs in every state into the database, and return them."""
    ids = [jobs.submit(PROBLEM, new_id()).id for _ in range(5)]
    for finish in (
        lambda claim: finish_success(jobs, claim, SUMMARY, dense=b"dense", samples=b"samples"),
        lambda claim: jobs.finish_failure(claim, {"code": "no_motion"}),
        lambda claim: None,
    ):
        finish(jobs.claim("worker", lease_seconds=0.0))
    jobs.cancel(ids[3])
    return [jobs.get(job_id) for job_id in ids]


def assert_in_order(database):
    assert [finding.code for finding in inspect_database(database) if not finding.is_clean] == []


def opened(url, look):
    database = Database(url)
    try:
        return look(database)
    finally:
        database.close()


def test_a_restored_database_is_what_it_was(jobs, url, other_url, tmp_path):
    before = fill(jobs)
    contents = back_up(url, tmp_path / "b")
    assert contents.rows["jobs"] == 5
    jobs.submit(PROBLEM, "later")
    assert restore(other_url, tmp_path / "b") == contents

    def look(database):
        restored = JobStore(database)
        assert [restored.get(job.id) for job in before] == before
        assert list_jobs(restored).total == 5
        solution_id = before[0].solution_id
        assert SolutionStore(database).dense(solution_id) == b"dense"
        assert SolutionStore(database).samples(solution_id) == b"samples"
        assert_in_order(database)
        # What was running when the backup was made is given to another worker.
        assert restored.reconcile(max_attempts=3, retry_seconds=0.0) == (before[2].id,)
        assert restored.get(before[2].id).state is JobState.QUEUED
        assert restored.claim("another", lease_seconds=60.0) is not None

    opened(other_url, look)


def test_a_backup_while_others_write_is_of_one_instant(jobs, url, other_url, tmp_path):
    stop, errors = threading.Event(), []

    def write():
        own = Database(url)
        store = JobStore(own)
        try:
            while not stop.is_set():
                store.submit(PROBLEM, new_id())
                claim = store.claim("worker", lease_seconds=60.0)
                finish_success(store, claim, SUMMARY, dense=os.urandom(20_000), samples=b"s")
        except Exception as fault:
            errors.append(fault)
        finally:
            own.close()

    writer = threading.Thread(target=write)
    writer.start()
    try:
        totals = []
        for number in range(3):
            while list_jobs(jobs).total < 20 * (number + 1):
                assert writer.is_alive()
            totals.append(back_up(url, tmp_path / f"b{number}").rows["jobs"])
    finally:
        stop.set()
        writer.join()
    assert errors == []
    assert totals == sorted(totals)
    assert totals[0] >= 20
    contents = restore(other_url, tmp_path / "b2")
    assert contents.rows["jobs"] == totals[2]
    # A job and its solution come together or not at all.
    opened(other_url, assert_in_order)


def test_no_jobs_are_overwritten_by_mistake(jobs, url, tmp_path):
    fill(jobs)
    back_up(url, tmp_path / "b")
    jobs.submit(PROBLEM, "later")
    with pytest.raises(BackupError, match=r"6 jobs.*--force"):
        restore(url, tmp_path / "b")
    assert list_jobs(jobs).total == 6
    restore(url, tmp_path / "b", force=True)
    assert list_jobs(jobs).total == 5


def test_a_database_without_jobs_may_be_replaced(jobs, url, other_url, tmp_path):
    fill(jobs)
    back_up(url, tmp_path / "b")
    migrate(other_url)
    restore(other_url, tmp_path / "b")
    assert opened(other_url, lambda database: list_jobs(JobStore(database)).total) == 5


def test_an_older_backup_is_brought_to_this_version(url, other_url, tmp_path):
    upgrade_to(other_url, FIRST)
    assert back_up(other_url, tmp_path / "old").revision == FIRST
    # Tables of this version, which the backup has not, are in the way.
    restore(url, tmp_path / "old", force=True)
    opened(url, assert_in_order)


def tables_of(url):
    engine = make_engine(url)
    try:
        return inspect(engine).get_table_names()
    finally:
        engine.dispose()


def set_revision(url, revision):
    engine = make_engine(url)
    with engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = :new"), {"new": revision})
    engine.dispose()


def test_a_backup_of_a_later_version_is_refused(jobs, url, other_url, tmp_path):
    set_revision(url, "9999")
    back_up(url, tmp_path / "b")
    with pytest.raises(BackupError, match=r"schema 9999.*does not know"):
        restore(other_url, tmp_path / "b")
    assert tables_of(other_url) == []


@pytest.mark.parametrize("content", [b"", b"no backup at all", b"SQLite format 3\0" + bytes(5000)])
def test_what_is_no_backup_is_refused(url, jobs, tmp_path, content):
    (tmp_path / "b").write_bytes(content)
    with pytest.raises(BackupError):
        restore(url, tmp_path / "b", force=True)
    assert list_jobs(jobs).total == 0


def test_a_missing_file_is_refused(url, tmp_path):
    with pytest.raises(BackupError, match="no such file"):
        restore(url, tmp_path / "missing")


def test_a_damaged_backup_is_refused(jobs, url, other_url, tmp_path):
    fill(jobs)
    for _ in range(200):
        jobs.submit(PROBLEM, new_id())
    file = tmp_path / "b"
    back_up(url, file)
    content = bytearray(file.read_bytes())
    content[len(content) // 2 :] = bytes(len(content) - len(content) // 2)
    file.write_bytes(content)
    with pytest.raises(BackupError):
        restore(other_url, file)
    assert "jobs" not in tables_of(other_url)


def test_an_existing_file_is_replaced_only_if_asked(jobs, url, tmp_path):
    file = tmp_path / "b"
    file.write_bytes(b"precious")
    with pytest.raises(BackupError, match="exists already"):
        back_up(url, file)
    assert file.read_bytes() == b"precious"
    back_up(url, file, force=True)
    assert file.read_bytes() != b"precious"


def test_a_backup_that_fails_leaves_nothing(url, other_url, tmp_path):
    with pytest.raises(BackupError):
        back_up(other_url, tmp_path / "b")  # never migrated
    assert not [path for path in tmp_path.iterdir() if path.name.startswith("b")]


def test_a_folder_that_is_not_there_is_a_reason(url, tmp_path):
    with pytest.raises(BackupError):
        back_up(url, tmp_path / "missing" / "b")


def test_a_backup_of_sqlite_is_one_file_that_any_sqlite_reads(sqlite_url, tmp_path):
    back_up(sqlite_url, tmp_path / "b")
    reader = sqlite3.connect(f"{(tmp_path / 'b').as_uri()}?mode=ro&immutable=1", uri=True)
    assert reader.execute("PRAGMA journal_mode").fetchone() == ("delete",)
    reader.close()
    assert sorted(path.name for path in tmp_path.glob("b*")) == ["b"]


def test_a_restored_sqlite_has_its_write_ahead_log_again(sqlite_url, tmp_path):
    back_up(sqlite_url, tmp_path / "b")
    restore(url_of(tmp_path / "new.db"), tmp_path / "b")
    with make_engine(url_of(tmp_path / "new.db")).connect() as connection:
        assert connection.exec_driver_sql("PRAGMA journal_mode").scalar() == "wal"


def test_another_programs_database_is_not_overwritten(sqlite_url, tmp_path):
    back_up(sqlite_url, tmp_path / "b")
    other = sqlite3.connect(tmp_path / "cookies.db")
    other.execute("CREATE TABLE cookies (name)")
    other.close()
    with pytest.raises(BackupError, match="not a database of polhode"):
        restore(url_of(tmp_path / "cookies.db"), tmp_path / "b")


def test_a_database_that_others_hold_is_not_waited_for_for_ever(sqlite_url, tmp_path, monkeypatch):
    back_up(sqlite_url, tmp_path / "b")
    monkeypatch.setattr("service.storage.upkeep.backup.BUSY_SECONDS", 0.1)
    holder = make_engine(sqlite_url)
    with holder.connect() as connection:
        connection.exec_driver_sql(
            "INSERT INTO workers VALUES ('w', 'h', 'local', 1, 0, 0, true, null, null)"
        )
        with pytest.raises(BackupError, match=r"use it|locked"):
            restore(sqlite_url, tmp_path / "b")
    holder.dispose()


def test_a_database_in_memory_has_no_backup(tmp_path):
    with pytest.raises(BackupError, match="in memory"):
        back_up("sqlite://", tmp_path / "b")


def test_without_the_client_programs_the_reason_says_so(postgres_url, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BackupError, match="pg_dump is not on PATH"):
        back_up(postgres_url, tmp_path / "b")


def test_passwords_are_not_among_the_arguments(tmp_path, monkeypatch, postgres_url):
    spy = tmp_path / "pg_dump"
    version = '[ "$1" = --version ] && echo "pg_dump (PostgreSQL) 99.1" && exit\n'
    spy.write_text(
        f'#!/bin/sh\n{version}echo "$@" > "$0.arguments"\necho "$PGPASSWORD" > "$0.password"\nexit 1\n'
    )
    spy.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    # The server trusts everybody on its socket: whatever the password.
    with pytest.raises(BackupError, match="ended with code 1"):
        back_up(postgres_url.replace("polhode@", "polhode:s3cret@"), tmp_path / "b")
    assert (tmp_path / "pg_dump.password").read_text() == "s3cret\n"
    assert "s3cret" not in (tmp_path / "pg_dump.arguments").read_text()


def server_version(database: Database) -> str:
    with database.read() as session:
        return session.scalar(text("SHOW server_version"))


def test_versions_are_told_and_an_older_program_than_the_server_is_refused_before_it_begins(
    postgres_url, tmp_path, monkeypatch
):
    made = back_up(postgres_url, tmp_path / "b")
    server = opened(postgres_url, server_version)
    # The tests' own programs are those of their server.
    assert re.fullmatch(r"pg_dump ([\d.]+) of a server \1", made.made_by)[1] == server.split()[0]
    old = tmp_path / "pg_dump"
    old.write_text('#!/bin/sh\necho "pg_dump (PostgreSQL) 9.6.24"\n')
    old.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    major = server.partition(".")[0]
    with pytest.raises(BackupError, match=rf"pg_dump 9\.6\.24 cannot .* postgresql-client-{major}\)"):
        back_up(postgres_url, tmp_path / "c")
    assert not (tmp_path / "c").exists()


def test_a_backup_of_a_later_program_is_refused_with_both_versions(postgres_url, tmp_path, monkeypatch):
    old = tmp_path / "pg_restore"
    old.write_text(
        '#!/bin/sh\n[ "$1" = --version ] && echo "pg_restore (PostgreSQL) 12.3" && exit\n'
        'echo "pg_restore: error: unsupported version (1.16) in file header" >&2\nexit 1\n'
    )
    old.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    (tmp_path / "b").touch()
    with pytest.raises(BackupError, match=r"\(1\.16\) .*: a pg_dump later than this pg_restore 12\.3 has"):
        restore(postgres_url, tmp_path / "b")


def test_counts_of_a_backup_are_those_of_its_tables(jobs, url, database, tmp_path):
    fill(jobs)
    with database.read() as session:
        expected = session.scalar(select(func.count()).select_from(JobRow))
    assert back_up(url, tmp_path / "b").rows["jobs"] == expected
