"""A job and its announcement are one: both happen, or neither; and what is queued is taken once, in order."""

import select

import pytest
from sqlalchemy import inspect, text

from service.jobs.records import JobState
from service.storage.database.migration import migrate
from service.storage.jobs import job_store
from service.storage.jobs.queue import announce
from tests.support.finishing import finish_success
from tests.support.waiting import PATIENCE, wait_until
from workers.process.notifications import Notifications

TABLES = ("jobs", "attempts", "solutions", "dense_outputs", "samples")


class RefusalError(Exception):
    pass


def test_a_submission_that_is_rolled_back_leaves_nothing(installation, jobs, monkeypatch):
    monkeypatch.setattr(job_store, "announce", refuse_after_announcing)
    with pytest.raises(RefusalError):
        jobs.submit_many([({"n": n}, f"rolled back {n}") for n in range(3)])
    assert [installation.count(table) for table in TABLES] == [0] * len(TABLES)


@pytest.mark.parametrize("installation", ["local on postgres", "postgres on postgres"], indirect=True)
def test_jobs_are_announced_when_they_are_committed_and_only_with_that_engine(
    installation, jobs, monkeypatch
):
    notifications = Notifications(installation.database.engine)
    notifications.listen()
    with monkeypatch.context() as patch:
        patch.setattr(job_store, "announce", refuse_after_announcing)
        with pytest.raises(RefusalError):
            jobs.submit({}, "rolled back")
    assert not can_be_read(notifications, seconds=0.0)
    ids = [job.id for job in jobs.submit_many([({"n": n}, f"announced {n}") for n in range(3)])]
    is_announced = installation.engine == "postgres"
    assert can_be_read(notifications, seconds=PATIENCE if is_announced else 0.0) == is_announced
    notifications.clear()
    assert not can_be_read(notifications, seconds=0.0)
    notifications.close()
    for job_id in ids:
        jobs.cancel(job_id)


def can_be_read(notifications, *, seconds):
    return bool(select.select([notifications.fileno()], [], [], seconds)[0])


def refuse_after_announcing(database, connection):
    announce(database, connection)
    raise RefusalError


@pytest.mark.parametrize("installation", ["postgres on postgres"], indirect=True)
def test_jobs_of_an_installation_that_used_procrastinate_are_taken_over(installation, jobs):
    """The table has all jobs, whatever was beside it; and the former name of the engine is accepted."""
    waiting = jobs.submit({}, "queued by procrastinate")
    with installation.database.write() as session:
        columns = "id bigserial, queue_name text, status text, queueing_lock text"
        session.execute(text(f"CREATE TABLE procrastinate_jobs ({columns})"))
        row = f"'polhode', 'todo', '{waiting.id}#0'"
        names = "queue_name, status, queueing_lock"
        session.execute(text(f"INSERT INTO procrastinate_jobs ({names}) VALUES ({row})"))
    migrate(installation.url)
    worker = installation.start_worker(engine="procrastinate")
    wait_until(lambda: jobs.get(waiting.id).is_finished)
    worker.terminate()
    assert (jobs.get(waiting.id).state, jobs.get(waiting.id).attempt) == (JobState.SUCCEEDED, 1)
    with installation.database.write() as session:
        session.execute(text("DROP TABLE procrastinate_jobs"))


def test_the_queue_is_in_order_and_each_job_is_taken_once(installation, jobs):
    submitted = {p: jobs.submit({"p": p}, f"order {p}", priority=p).id for p in (0, -3, 7, 2)}
    twins = [job.id for job in jobs.submit_many([({"n": n}, f"twin {n}") for n in range(2)], priority=2)]
    installation.announce_again()
    order = [submitted[7], submitted[2], *twins, submitted[0], submitted[-3]]
    first = [claim.job_id for claim in jobs.take("first", 2, lease_seconds=60).claims]
    rest = []
    while claims := jobs.take("second", 3, lease_seconds=60).claims:
        rest += [claim.job_id for claim in claims]
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
    assert not jobs.heartbeat([zombie], lease_seconds=60)
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
    assert jobs.take("worker", 1, lease_seconds=60).claims == ()
    jobs.cancel(job.id)


def contents(installation):
    """Every row of the database."""
    found = {}
    with installation.database.read() as session:
        for table in sorted(inspect(session.connection()).get_table_names()):
            rows = session.execute(text(f"SELECT * FROM {table}")).all()
            found[table] = sorted(map(repr, rows))
    return found
