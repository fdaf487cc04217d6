"""Every engine has the same order: people before batches, keys in turn."""

import pytest
from sqlalchemy import func, select

from service.jobs.queue import Lane
from service.jobs.records import JobKind, JobState
from service.storage.database.rows import new_id
from service.storage.tables.jobs import AttemptRow, JobRow
from tests.support.waiting import wait_until

ALICE, BOB = new_id(), new_id()


def taken(jobs, count, starved=()):
    return jobs.take("worker", count, lease_seconds=60.0, starved=starved).claims


@pytest.fixture
def cancelled(installation):
    """Cancel in the end what a test has left."""
    yield
    with installation.database.read() as session:
        live = session.execute(
            select(JobRow.id, JobRow.sweep_id).where(JobRow.state.in_(["queued", "running"]))
        ).all()
    for job_id, sweep_id in live:
        if sweep_id is None:
            installation.jobs.cancel(job_id)
        else:
            installation.sweeps.cancel(sweep_id)


def many(jobs, count, **options):
    return [job.id for job in jobs.submit_many([({}, new_id()) for _ in range(count)], **options)]


@pytest.mark.usefixtures("cancelled")
def test_keys_take_turns_and_lanes_have_their_order(installation, jobs):
    installation.sweeps.submit({"axes": []}, points=10, most=10, key_id=ALICE)
    many(jobs, 4, key_id=ALICE, lane=Lane.LIST)
    many(jobs, 6, key_id=ALICE)
    many(jobs, 2, key_id=BOB)
    assert [claim.lane for claim in taken(jobs, 1, (Lane.SWEEP,))] == [Lane.SWEEP]
    claims = taken(jobs, 8)
    assert [claim.lane for claim in claims] == [Lane.SINGLE] * 8
    assert sorted(claim.key_id for claim in claims[:4]) == sorted([ALICE, BOB] * 2)
    assert [claim.lane for claim in taken(jobs, 9)] == [Lane.LIST] * 4


@pytest.mark.usefixtures("cancelled")
def test_single_problems_are_taken_before_older_ones_of_lists(jobs):
    ids = many(jobs, 3, key_id=ALICE, lane=Lane.LIST) + many(jobs, 2, key_id=BOB)
    for k in range(5):
        (claim,) = taken(jobs, 1)
        assert claim.job_id == [*ids[3:], *ids[:3]][k]


@pytest.mark.usefixtures("cancelled")
def test_problems_are_taken_together_and_the_others_stay_in_order(jobs):
    ids = many(jobs, 5, lane=Lane.LIST)
    claims = jobs.take("worker", 1, lease_seconds=60.0, together=3).claims
    assert [claim.job_id for claim in claims] == ids[:3]
    assert [claim.job_id for claim in taken(jobs, 5)] == ids[3:]


@pytest.mark.usefixtures("cancelled")
def test_equal_problems_are_not_taken_together_and_stay_queued(jobs):
    ids = [job.id for job in jobs.submit_many([({}, "equal")] * 3, lane=Lane.LIST)]
    claims = jobs.take("worker", 1, lease_seconds=60.0, together=3).claims
    assert [claim.job_id for claim in claims] == ids[:1]
    assert [claim.job_id for claim in taken(jobs, 5)] == ids[1:]


@pytest.mark.usefixtures("cancelled")
def test_cancelled_jobs_are_not_taken(installation, jobs):
    first, *others = many(jobs, 4)
    for job_id in others:
        jobs.cancel(job_id)
    installation.announce_again()
    assert [claim.job_id for claim in taken(jobs, 5)] == [first]


@pytest.mark.usefixtures("cancelled")
def test_a_single_job_waits_for_the_chunk_that_runs_and_for_no_other(installation, jobs, submit):
    """However many chunks are queued: some fifteen here, each of which takes a while."""
    document = {"axes": [], "seconds": 1.0, "pause": 0.1}
    sweep = installation.sweeps.submit(document, points=10_000, most=1)
    installation.wake_up.notify()
    worker = installation.start_worker(lease_seconds=30.0)
    in_queue = select(func.count()).where(JobRow.sweep_id == sweep.id, JobRow.state == "queued")
    wait_until(lambda: value(installation, in_queue) >= 15)
    job = submit()
    done = wait_until(lambda: jobs.get(job.id).is_finished and jobs.get(job.id))
    worker.terminate()
    assert done.state is JobState.SUCCEEDED
    (attempt,) = jobs.attempts(job.id)
    between = (
        select(func.count())
        .select_from(AttemptRow)
        .join(JobRow, JobRow.id == AttemptRow.job_id)
        .where(
            JobRow.kind == JobKind.CHUNK.value,
            AttemptRow.started_at > done.created_at.timestamp(),
            AttemptRow.started_at < attempt.started_at.timestamp(),
        )
    )
    # One that was claimed while the job was being submitted.
    assert value(installation, between) <= 1


def value(installation, statement):
    with installation.database.read() as session:
        return session.scalar(statement)
