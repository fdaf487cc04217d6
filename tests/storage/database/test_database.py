"""Writers wait for each other; readers wait for nobody."""

import math
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from sqlalchemy import select, text
from sqlalchemy.exc import DBAPIError, StatementError

from service.storage.database.availability import is_away
from service.storage.database.database import Database, SearchTimeError
from service.storage.jobs.job_store import JobStore
from service.storage.tables.base import DatabaseNow
from service.storage.tables.jobs import JobRow
from tests.support.databases import PROBLEM, SUMMARY
from tests.support.finishing import finish_success
from tests.support.lists import list_jobs
from tests.support.waiting import wait_until


def test_many_writers_never_find_the_database_busy(jobs):
    def work(_):
        for _ in range(20):
            jobs.submit(PROBLEM, "digest")
            # All that is queued may be in the hands of others at this moment, who then find this one's.
            claim = next(filter(None, (jobs.claim("worker", lease_seconds=60) for _ in range(1000))))
            jobs.finish_failure(claim, {"code": "no_motion"})

    with ThreadPoolExecutor(6) as pool:
        list(pool.map(work, range(6)))
    page = list_jobs(jobs, limit=500)
    assert page.total == 120
    assert {(job.state, job.attempt) for job in page.jobs} == {("failed", 1)}


def test_a_reader_does_not_wait_for_a_writer(database, jobs):
    job = jobs.submit(PROBLEM, "digest")
    with database.write() as session:
        session.get(JobRow, job.id).digest = "other"
        session.flush()
        with ThreadPoolExecutor(1) as pool:
            assert pool.submit(jobs.get, job.id).result(timeout=60).digest == "digest"
    assert jobs.get(job.id).digest == "other"


def store_and_fail(database):
    with database.write() as session:
        session.add(JobRow(id="0" * 32, state="queued", problem=PROBLEM, digest="x", created_at=0.0))
        session.flush()
        raise ZeroDivisionError


def test_an_exception_rolls_everything_back(database, jobs):
    with pytest.raises(ZeroDivisionError):
        store_and_fail(database)
    assert list_jobs(jobs).total == 0


def test_a_word_that_a_column_does_not_know_is_not_written(database):
    with pytest.raises(StatementError, match="'paused' is none of cancelled"), database.write() as session:
        session.add(JobRow(id="0" * 32, state="paused", problem=PROBLEM, digest="x", created_at=0.0))


def test_no_nan_is_ever_stored_in_a_document(jobs):
    job = jobs.submit(PROBLEM, "digest")
    claim = jobs.claim("worker", lease_seconds=60)
    with pytest.raises((StatementError, ValueError)):
        finish_success(jobs, claim, {**SUMMARY, "error": math.nan}, dense=b"", samples=b"")
    assert jobs.get(job.id).state == "running"


def test_the_clock_of_the_database_runs_in_seconds_since_1970(database, jobs):
    began = time.time()
    first = jobs.submit(PROBLEM, "digest").created_at.timestamp()
    threading.Event().wait(0.05)
    second = jobs.submit(PROBLEM, "digest").created_at.timestamp()
    with database.read() as session:
        now = session.scalar(select(DatabaseNow()))
    ended = time.time()
    # The databases of the tests share the clock of this machine; SQLite's has milliseconds.
    assert began - 1e-3 <= first < second <= now <= ended
    assert second - first >= 0.04


def fall_silent(database, meanwhile):
    """Lock every job, say nothing until ``meanwhile`` is done, and go on as if no time had passed."""
    with database.write() as session:
        session.execute(select(JobRow.id).with_for_update())
        meanwhile()
        session.execute(select(JobRow.id))


def test_postgres_takes_its_locks_back_from_a_client_that_says_nothing_more(postgres_url, monkeypatch):
    monkeypatch.setattr("service.storage.database.database.IDLE_SECONDS", 1)
    database = Database(postgres_url)
    jobs = JobStore(database)
    job = jobs.submit(PROBLEM, "digest")

    def others():
        assert jobs.claim("worker", lease_seconds=60) is None  # what is locked is passed over
        assert wait_until(lambda: jobs.claim("worker", lease_seconds=60)).job_id == job.id

    with pytest.raises(DBAPIError) as caught:
        fall_silent(database, others)
    assert is_away(caught.value)
    database.close()


ENDLESS = text("WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n) SELECT max(k) FROM n")


def test_a_search_that_takes_long_is_stopped_and_its_connection_goes_on(database):
    with (
        pytest.raises(SearchTimeError, match=r"stopped after 0\.05 seconds"),
        database.search(0.05) as session,
    ):
        session.execute(ENDLESS)
    with database.read() as session:
        # Neither the clock of SQLite nor the limit of Postgres is left behind.
        longer = text("WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n WHERE k < 1000000)"
                      " SELECT max(k) FROM n")  # fmt: skip
        assert session.scalar(longer) == 1_000_000
    with pytest.raises(DBAPIError), database.search() as session:
        session.execute(text("SELECT nothing FROM nowhere"))
