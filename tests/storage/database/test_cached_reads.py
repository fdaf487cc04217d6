"""What was read is given again until anybody commits anything, in this process or in another one."""

import sqlite3
import subprocess
import sys
import threading

import pytest
from sqlalchemy import make_url, text

from service.storage.database.cached_reads import CachedReads
from service.storage.database.database import Database


def counted(database, asked=None):
    """A way to read, which counts how often it is used."""
    asked = [] if asked is None else asked

    def read(given, thing_id):
        assert given is database
        asked.append(thing_id)
        return f"{thing_id} {len(asked)}"

    return read, asked


@pytest.fixture
def on_file(sqlite_url):
    database = Database(sqlite_url)
    reads = CachedReads(database)
    yield database, reads, make_url(sqlite_url).database
    reads.close()
    database.close()


def commit_here(path):
    connection = sqlite3.connect(path)
    with connection:
        connection.execute("DELETE FROM idempotency_keys")
        connection.execute("CREATE TABLE IF NOT EXISTS another (x)")
    connection.close()


def commit_elsewhere(path):
    code = (
        "import sqlite3, sys; c = sqlite3.connect(sys.argv[1]);"
        " c.execute('CREATE TABLE another (x)'); c.commit()"
    )
    subprocess.run([sys.executable, "-c", code, path], check=True)


def commit_with_the_engine(path):
    database = Database(f"sqlite:///{path}")
    with database.write() as session:
        session.execute(text("CREATE TABLE another (x)"))
    database.close()


@pytest.mark.parametrize("commit", [commit_here, commit_elsewhere, commit_with_the_engine])
def test_it_is_read_once_for_each_commit(on_file, commit):
    database, reads, path = on_file
    read, asked = counted(database)
    assert reads.cached(read, "a") is None
    assert [reads.get(read, "a") for _ in range(3)] == ["a 1"] * 3
    assert reads.cached(read, "a") == "a 1"
    commit(path)
    assert reads.cached(read, "a") is None
    assert [reads.get(read, "a") for _ in range(3)] == ["a 2"] * 3
    assert asked == ["a", "a"]


def test_its_own_transactions_are_seen_too(on_file):
    database, reads, _ = on_file
    read, _ = counted(database)
    reads.get(read, "a")
    with database.read_rows() as connection:
        connection.execute(text("SELECT count(*) FROM solutions"))
    assert reads.cached(read, "a") == "a 1"
    with database.write_rows() as connection:
        connection.execute(text("CREATE TABLE another (x)"))
    assert reads.cached(read, "a") is None


def test_what_is_committed_while_it_is_read_is_not_taken_for_known(on_file):
    _, reads, path = on_file

    def read(_, thing_id):
        commit_here(path)  # after the row has been read, as far as anybody can tell
        return thing_id

    assert reads.get(read, "a") == "a"
    assert reads.cached(read, "a") is None


def test_a_writer_at_work_keeps_nobody_waiting(on_file):
    database, reads, _ = on_file
    read, _ = counted(database)
    reads.get(read, "a")
    with database.write_rows() as connection:
        connection.execute(text("CREATE TABLE another (x)"))
        assert reads.cached(read, "a") == "a 1"  # it is not committed yet
    assert reads.cached(read, "a") is None


def test_a_file_that_was_replaced_or_moved_is_not_known(on_file, tmp_path):
    database, reads, _ = on_file
    read, _ = counted(database)
    with database.read_rows() as connection:
        connection.execute(text("SELECT count(*) FROM solutions"))
    reads.get(read, "a")
    moved = tmp_path / "moved.db"
    database.file.path.rename(moved)
    assert reads.cached(read, "a") is None
    database.file.path.touch()
    assert reads.cached(read, "a") is None
    moved.replace(database.file.path)
    assert reads.cached(read, "a") == "a 1"


def test_what_was_not_asked_for_lately_goes(on_file):
    database, _, _ = on_file
    reads = CachedReads(database, most=2)
    read, _ = counted(database)
    for thing in "abc":
        reads.get(read, thing)
    assert [reads.cached(read, thing) for thing in "abc"] == [None, "b 2", "c 3"]
    reads.close()


def test_what_cannot_be_read_is_not_remembered(on_file):
    _, reads, _ = on_file

    def read(_, thing_id):
        raise LookupError(thing_id)

    for _ in range(2):
        with pytest.raises(LookupError):
            reads.get(read, "a")
    assert reads.cached(read, "a") is None


def test_threads_may_ask_at_once(on_file):
    database, reads, _ = on_file
    read, asked = counted(database)
    wrong = []

    def ask():
        for k in range(200):
            found = reads.get(read, str(k % 5))
            if not found.startswith(f"{k % 5} "):
                wrong.append(found)

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
    # Each of the four may read each of the five before another one has; nobody commits.
    assert 5 <= len(asked) <= 20


def test_postgres_is_asked_each_time(postgres_url):
    database = Database(postgres_url)
    reads = CachedReads(database)
    read, _ = counted(database)
    assert [reads.get(read, "a") for _ in range(2)] == ["a 1", "a 2"]
    assert reads.cached(read, "a") is None
    reads.close()
    database.close()
