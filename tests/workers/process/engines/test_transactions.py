"""A job and its delivery are one: both happen, or neither."""

import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from sqlalchemy import inspect, text

from service.storage.jobs.job_store import SqlJobStore
from tests.support.finishing import finish_success
from tests.support.waiting import wait_until

TABLES = ("jobs", "attempts", "solutions", "dense_outputs", "samples", "procrastinate_jobs")


class RefusalError(Exception):
    pass


def test_a_submission_that_is_rolled_back_leaves_nothing(installation):
    class FallsAfterwards(type(installation.dispatcher)):
        def dispatch(self, connection, deliveries):
            super().dispatch(connection, deliveries)
            raise RefusalError

    store = SqlJobStore(installation.database, FallsAfterwards())
    with pytest.raises(RefusalError):
        store.submit_many([({"n": n}, f"rolled back {n}") for n in range(3)])
    assert [installation.count(table) for table in TABLES] == [0] * len(TABLES)


def test_the_queue_is_in_order_and_each_job_is_taken_once(installation, jobs):
    submitted = {p: jobs.submit({"p": p}, f"order {p}", priority=p).id for p in (0, -3, 7, 2)}
    twins = [job.id for job in jobs.submit_many([({"n": n}, f"twin {n}") for n in range(2)], priority=2)]
    for job_id in (submitted[7], submitted[7], submitted[-3]):
        installation.deliver_again(job_id)
    order = [submitted[7], submitted[2], *twins, submitted[0], submitted[-3]]
    first = [claim.job_id for claim in jobs.take("first", 2, lease_seconds=60).claims]
    rest = []
    while claims := jobs.take("second", 3, lease_seconds=60).claims:
        rest += [claim.job_id for claim in claims]
    # A delivery too many may leave a place free, and changes no order.
    assert first + rest == order
    for job_id in order:
        jobs.cancel(job_id)


def test_a_fenced_zombie_changes_no_row(installation, jobs):
    job = jobs.submit({}, "zombie")
    (zombie,) = jobs.take("zombie", 1, lease_seconds=-1.0).claims
    assert jobs.reconcile(max_attempts=3, retry_seconds=0.0) == (job.id,)
    (successor,) = jobs.take("successor", 1, lease_seconds=60).claims
    assert successor.attempt == 2
    before = contents(installation)
    assert not finish_success(jobs, zombie, {"method": "quadrature"}, dense=b"", samples=b"")
    assert not jobs.finish_failure(zombie, {"code": "x"})
    assert not jobs.heartbeat(zombie, lease_seconds=60)
    assert not jobs.lose(zombie, "x", max_attempts=3, retry_seconds=0.0)
    assert not jobs.give_back(zombie)
    assert jobs.held([zombie]) == frozenset()
    assert contents(installation) == before
    jobs.cancel(job.id)


def test_a_lost_job_is_not_taken_before_its_pause_is_over(installation, jobs):
    job = jobs.submit({}, "pause")
    for _ in range(2):  # after the first loss there is no pause
        (claim,) = jobs.take("worker", 1, lease_seconds=60).claims
        assert jobs.lose(claim, "died", max_attempts=3, retry_seconds=1000.0)
    installation.deliver_again(job.id)
    assert jobs.take("worker", 1, lease_seconds=60).claims == ()
    assert jobs.repair() == 0
    jobs.cancel(job.id)


def test_only_what_is_due_and_not_delivered_is_repaired(installation, jobs):
    submitted = [job.id for job in jobs.submit_many([({"n": n}, f"repair {n}") for n in range(3)])]
    assert jobs.repair() == 0
    installation.lose_deliveries()
    needed = 3 if installation.engine == "procrastinate" else 0
    assert [jobs.repair(), jobs.repair()] == [needed, 0]
    claims = jobs.take("worker", 5, lease_seconds=60).claims
    assert [claim.job_id for claim in claims] == submitted
    assert jobs.repair() == 0
    for job_id in submitted:
        jobs.cancel(job_id)


@pytest.mark.parametrize("installation", ["procrastinate on postgres"], indirect=True)
def test_a_delivery_that_is_removed_meanwhile_keeps_nobody_from_the_job(installation, jobs):
    """Somebody removes it and has not committed yet: who takes the job waits for that, and has it."""
    job = jobs.submit({}, "removed meanwhile")
    with ThreadPoolExecutor(1) as other:
        with installation.database.write() as session:
            session.execute(text("DELETE FROM procrastinate_jobs"))
            taken = other.submit(jobs.take, "taker", 1, lease_seconds=60)
            assert wait_until(lambda: waiting_for_locks(installation) == 1)
        (claim,) = taken.result(timeout=60).claims
    assert claim.job_id == job.id
    jobs.cancel(job.id)


def waiting_for_locks(installation):
    statement = "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database()"
    statement += " AND wait_event_type = 'Lock'"
    with installation.database.read() as session:
        return session.scalars(text(statement)).one()


def test_two_that_repair_at_once_deliver_once(installation, jobs):
    job = jobs.submit({}, "repaired twice")
    installation.lose_deliveries()
    with ThreadPoolExecutor(1) as pool:
        with installation.database.write_rows() as connection:
            first = installation.dispatcher.repair(connection)
            second = pool.submit(jobs.repair)
            # By now it has seen the loss, and waits for the end of this transaction.
            time.sleep(0.3)
        assert second.result(timeout=30) == 0
    assert first == (installation.engine == "procrastinate")
    assert [claim.job_id for claim in jobs.take("worker", 5, lease_seconds=60).claims] == [job.id]
    jobs.cancel(job.id)


def contents(installation):
    """Every row of the database."""
    found = {}
    with installation.database.read() as session:
        for table in sorted(inspect(session.connection()).get_table_names()):
            rows = session.execute(text(f"SELECT * FROM {table}")).all()
            found[table] = sorted(map(repr, rows))
    return found
