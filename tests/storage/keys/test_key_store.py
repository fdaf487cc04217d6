import re
from datetime import timedelta
from pathlib import Path

import pytest
from sqlalchemy import event, update

from service.jobs.keys import KeyNotFoundError, KeyStanding, Role, key_hash, key_prefix
from service.jobs.records import POINTS_PER_JOB, queued_as
from service.storage.codecs.packing import SOLVED, ChunkPoints, chunk_outcome
from service.storage.database.database import Database
from service.storage.keys import USED_SECONDS, KeyLimits, KeyStore, charge
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.tables.base import DatabaseNow
from service.storage.tables.operations import ApiKeyRow
from tests.support.databases import PROBLEM, SUMMARY
from tests.support.finishing import finish_success


@pytest.fixture
def keys(database) -> KeyStore:
    return KeyStore(database)


def stored_bytes(keys, prefix):
    return next(key.stored_bytes for key in keys.all().keys if key.prefix == prefix)


def test_a_key_is_opened_by_its_text_and_by_nothing_else(keys):
    key, text = keys.create(Role.SUBMIT, name="bench")
    assert key.opens_with(text)
    assert not key.opens_with(text[:-1] + ("a" if text[-1] != "a" else "b"))
    assert not key.opens_with(key.prefix)
    assert keys.all().keys == (key,)
    assert (key.role, key.name, key.stored_bytes) == (Role.SUBMIT, "bench", 0)


def test_a_key_has_a_public_part_and_256_secret_bits(keys):
    texts = [keys.create(Role.READ)[1] for _ in range(3)]
    assert len({text[-43:] for text in texts}) == 3
    for text in texts:
        assert re.fullmatch(r"plh_[0-9A-Za-z]{8}_[0-9A-Za-z]{43}", text)
        assert key_prefix(text) == text[:12]
    assert 62**43 > 2**256


@pytest.mark.parametrize("text", ["", "plh_", "plh_12345678", "x" * 56, "plh_12345678_" + "ä" * 43])
def test_what_is_no_key_has_no_prefix(text):
    assert key_prefix(text) is None


def test_the_secret_is_not_in_the_database(sqlite_url):
    database = Database(sqlite_url)
    _, text = KeyStore(database).create(Role.ADMIN)
    database.close()
    folder = Path(sqlite_url.removeprefix("sqlite:///")).parent
    content = b"".join(file.read_bytes() for file in sorted(folder.glob("polhode.db*")))
    assert text[:12].encode() in content
    assert key_hash(text) in content
    assert text[13:].encode() not in content


def test_a_key_says_nothing_of_its_hash(keys):
    key, _ = keys.create(Role.READ)
    assert repr(key.hash) not in repr(key)


@pytest.mark.parametrize("seconds", [0.0, -1.0, 3600.0])
def test_a_key_expires_by_the_clock_of_the_database(keys, seconds):
    key, _ = keys.create(Role.READ, seconds=seconds)
    assert key.expires_at == key.created_at + timedelta(seconds=seconds)
    expected = KeyStanding.LIVE if seconds > 0 else KeyStanding.EXPIRED
    assert key.standing(keys.all().now) is expected


def test_a_revoked_key_stays_so_and_revoking_again_changes_nothing(keys):
    key, _ = keys.create(Role.READ, seconds=-1.0)
    first = keys.revoke(key.prefix)
    assert first.standing(keys.all().now) is KeyStanding.REVOKED
    assert keys.revoke(key.prefix) == first


def test_revoking_what_is_not_there_is_an_error_that_repeats_no_secret(keys):
    with pytest.raises(KeyNotFoundError) as caught:
        keys.revoke("plh_12345678_secret")
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize(
    ("role", "may"),
    [(Role.METRICS, 1), (Role.READ, 2), (Role.SUBMIT, 3), (Role.OPERATE, 4), (Role.ADMIN, 5)],
)
def test_each_role_may_do_what_those_before_it_may(role, may):
    assert [role.may(needed) for needed in Role] == [True] * may + [False] * (5 - may)


@pytest.mark.parametrize(
    ("ago", "is_noted"), [(None, True), (USED_SECONDS / 2, False), (2 * USED_SECONDS, True)]
)
def test_the_last_use_is_noted_once_a_minute(database, keys, ago, is_noted):
    key, _ = keys.create(Role.READ)
    if ago is not None:
        with database.write() as session:
            session.execute(update(ApiKeyRow).values(last_used_at=DatabaseNow() - ago))
    before = keys.all().keys[0].last_used_at
    keys.touch(key.id)
    assert (keys.all().keys[0].last_used_at != before) is is_noted


def test_limits_are_kept_with_the_key(keys):
    keys.create(Role.SUBMIT, limits=KeyLimits(requests_per_second=0.5, queued_jobs=3, stored_bytes=5 * 10**9))
    key = keys.all().keys[0]
    assert (key.requests_per_second, key.max_queued_jobs, key.max_stored_bytes) == (0.5, 3, 5 * 10**9)


def test_what_is_stored_is_charged_to_the_key_of_the_job(jobs, keys):
    mine, other = (keys.create(Role.SUBMIT)[0] for _ in range(2))
    jobs.submit(PROBLEM, "d1", key_id=mine.id)
    jobs.submit(PROBLEM, "d2")
    for _ in range(2):
        claim = jobs.claim("w", lease_seconds=60.0)
        assert finish_success(jobs, claim, SUMMARY, dense=b"12345", samples=b"123")
    assert stored_bytes(keys, mine.prefix) == 8
    assert stored_bytes(keys, other.prefix) == 0


def test_what_a_lost_worker_brings_late_is_not_charged(jobs, keys):
    mine, _ = keys.create(Role.SUBMIT)
    job = jobs.submit(PROBLEM, "d1", key_id=mine.id)
    claim = jobs.claim("w", lease_seconds=60.0)
    jobs.cancel(job.id)
    assert not finish_success(jobs, claim, SUMMARY, dense=b"12345", samples=b"123")
    assert stored_bytes(keys, mine.prefix) == 0


def test_a_solution_that_is_used_again_costs_nothing(jobs, keys):
    mine, _ = keys.create(Role.SUBMIT)
    jobs.submit(PROBLEM, "d1")
    assert finish_success(jobs, jobs.claim("w", lease_seconds=60.0), SUMMARY, dense=b"12345", samples=b"123")
    assert jobs.submit(PROBLEM, "d1", key_id=mine.id).reused
    assert stored_bytes(keys, mine.prefix) == 0


def test_what_is_removed_is_given_back(database, keys):
    mine, _ = keys.create(Role.SUBMIT)
    with database.write() as session:
        charge(session.connection(), mine.id, 10)
        charge(session.connection(), mine.id, -4)
        charge(session.connection(), None, 10**6)
    assert stored_bytes(keys, mine.prefix) == 6


def test_live_jobs_are_counted_by_key_and_no_further_than_asked(jobs, keys):
    mine, other = (keys.create(Role.SUBMIT)[0] for _ in range(2))
    for k in range(4):
        jobs.submit(PROBLEM, f"mine{k}", key_id=mine.id)
    claim = jobs.claim("w", lease_seconds=60.0)  # runs: lives
    jobs.submit(PROBLEM, "nobody's")
    assert keys.live_jobs(mine.id, at_most=10) == 4
    assert keys.live_jobs(mine.id, at_most=3) == 3
    assert keys.live_jobs(None, at_most=10) == 1
    assert keys.live_jobs(other.id, at_most=10) == 0
    assert jobs.finish_failure(claim, {"code": "no_motion", "detail": ""})
    assert keys.live_jobs(mine.id, at_most=10) == 3


def test_a_sweep_counts_by_the_points_that_it_has_left(database, jobs, keys):
    mine, _ = keys.create(Role.SUBMIT)
    sweeps = SweepStore(database)
    first = sweeps.submit({"axes": []}, points=POINTS_PER_JOB * 5, most=POINTS_PER_JOB, key_id=mine.id)
    sweeps.submit({"axes": []}, points=1, most=POINTS_PER_JOB, key_id=mine.id)
    sweeps.submit({"axes": []}, points=POINTS_PER_JOB * 100, most=POINTS_PER_JOB)
    jobs.submit(PROBLEM, "mine", key_id=mine.id)
    assert keys.live_jobs(mine.id, at_most=10) == 5 + 1 + 1
    assert keys.live_jobs(mine.id, at_most=3) == 3
    while (claim := jobs.claim("w", lease_seconds=60.0)).sweep_id != first.id:
        pass
    count = claim.problem["count"]
    assert jobs.finish(claim, chunk_outcome(ChunkPoints([SOLVED] * count, {}), 1.0))[0]
    left = queued_as(POINTS_PER_JOB * 5 - count)
    assert keys.live_jobs(mine.id, at_most=100) == left + 1 + 1
    sweeps.cancel(first.id)
    assert keys.live_jobs(mine.id, at_most=100) == 1 + 1


def test_the_count_reads_nothing_but_the_live_jobs_of_the_key_in_an_index(sqlite_url):
    database = Database(sqlite_url)
    statements = []
    event.listen(
        database.engine, "before_cursor_execute", lambda *given: statements.append((given[2], given[3]))
    )
    KeyStore(database).live_jobs("01a1fcba-3232-7921-abd1-05ca72abad77", at_most=10)
    (statement, parameters), *_ = (each for each in statements if " jobs" in each[0])
    with database.engine.connect() as connection:
        plan = connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {statement}", parameters).all()
    database.close()
    assert any("COVERING INDEX ix_jobs_of_key (key_id=? AND state=? AND lane<?)" in row[3] for row in plan), (
        plan
    )
