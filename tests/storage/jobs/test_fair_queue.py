"""Who is claimed next, by the real store: people before batches, keys in turn, priorities, age."""

from concurrent.futures import ThreadPoolExecutor
from itertools import groupby, pairwise
from threading import Barrier

import pytest
from sqlalchemy import select, update

from service.jobs.queue import Lane
from service.jobs.records import JobState, Solved
from service.storage.codecs.packing import SOLVED, ChunkPoints, chunk_outcome
from service.storage.database.database import Database
from service.storage.database.rows import new_id
from service.storage.jobs.job_store import JobStore
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.tables.jobs import JobRow
from tests.support.databases import PROBLEM, SUMMARY
from tests.support.finishing import finish_success
from tests.support.waiting import PATIENCE

SOLUTION = Solved(SUMMARY, b"dense", b"samples")
ALICE, BOB, CAROL = (new_id() for _ in range(3))


@pytest.fixture
def sweeps(database):
    return SweepStore(database)


@pytest.fixture
def submit(jobs):
    """Submit problems like no other; return the ids of their jobs."""

    def submit(count=1, **options):
        return [job.id for job in jobs.submit_many([(PROBLEM, new_id()) for _ in range(count)], **options)]

    return submit


def take(jobs, count=1, starved=()):
    return jobs.take("worker", count, lease_seconds=60.0, starved=starved).claims


def keys_in_order(jobs, count):
    return [claim.key_id for claim in take(jobs, count)]


def queue_sweep(sweeps, jobs, **options):
    """Submit a sweep and compute its first chunk: sixteen wait."""
    sweep = sweeps.submit({"axes": []}, points=1_000_000, most=1000, **options)
    while (first := take(jobs)[0]).sweep_id != sweep.id:
        pass
    outcome = chunk_outcome(ChunkPoints([SOLVED] * first.problem["count"], {}), 1.0)
    assert jobs.finish(first, outcome)[0]
    return sweep


def test_a_single_job_comes_before_every_chunk_that_waits(jobs, sweeps, submit):
    for key in (None, ALICE, BOB):
        queue_sweep(sweeps, jobs, key_id=key, priority=-1 if key is BOB else 0)
    (single,) = submit()
    assert [claim.job_id for claim in take(jobs)] == [single]


def test_single_jobs_come_before_lists_and_lists_before_sweeps(jobs, sweeps, submit):
    queue_sweep(sweeps, jobs)
    listed = submit(3, lane=Lane.LIST)
    singles = [*submit(), *submit()]
    claims = take(jobs, 6)
    assert [claim.job_id for claim in claims[:5]] == singles + listed
    assert [claim.lane for claim in claims] == [Lane.SINGLE] * 2 + [Lane.LIST] * 3 + [Lane.SWEEP]


def test_a_lane_that_is_owed_a_job_gets_one(jobs, sweeps, submit):
    queue_sweep(sweeps, jobs)
    submit(3, lane=Lane.LIST)
    submit(5)
    assert [claim.lane for claim in take(jobs, 3, (Lane.SWEEP,))] == [Lane.SWEEP, *[Lane.SINGLE] * 2]
    assert [claim.lane for claim in take(jobs, 1, (Lane.LIST, Lane.SWEEP))] == [Lane.LIST]
    claims = take(jobs, 20, (Lane.SWEEP, Lane.LIST))
    runs = [(lane, len(list(found))) for lane, found in groupby(claim.lane for claim in claims)]
    assert runs == [(Lane.SWEEP, 1), (Lane.LIST, 1), (Lane.SINGLE, 3), (Lane.LIST, 1), (Lane.SWEEP, 14)]
    assert take(jobs, 5, (Lane.SWEEP,)) == ()


def test_problems_are_taken_together_in_order_and_nothing_else_is(jobs, sweeps, submit):
    queue_sweep(sweeps, jobs)
    urgent = submit(2, priority=1)
    listed, singles = submit(3, lane=Lane.LIST), submit(4)

    def taken(count, together, starved=()):
        claims = jobs.take("worker", count, lease_seconds=60.0, starved=starved, together=together).claims
        return [claim.job_id if claim.lane is not Lane.SWEEP else "chunk" for claim in claims]

    # Not across priorities: a chunk may be more urgent than the problems that follow.
    assert taken(1, 5) == urgent
    assert taken(1, 3) == singles[:3]
    # A lane that is starved a job gets as many as one place takes, and the other place what comes first.
    assert taken(2, 2, (Lane.LIST,)) == [*listed[:2], singles[3]]
    assert [taken(1, 5), taken(1, 5)] == [listed[2:], ["chunk"]]
    (last,) = submit()
    assert taken(2, 5) == [last, "chunk"]
    assert taken(3, 5, (Lane.SWEEP,)) == ["chunk"] * 3


def test_of_equal_problems_one_is_taken_and_the_others_share_its_solution(jobs):
    digest = new_id()
    ids = [job.id for job in jobs.submit_many([(PROBLEM, digest)] * 3 + [(PROBLEM, new_id())])]
    claims = jobs.take("worker", 1, lease_seconds=60.0, together=9).claims
    assert [claim.job_id for claim in claims] == [ids[0], ids[3]]
    ended = [(claim, SOLUTION) for claim in claims]
    held, taken = jobs.finish_problems(ended, then_take=1, lease_seconds=60.0)
    assert held == {ids[0], ids[3]}
    assert taken.reused == (ids[1],)
    assert jobs.take("worker", 1, lease_seconds=60.0).reused == (ids[2],)


def test_keys_take_turns_among_problems_that_are_taken_together(jobs, submit):
    submit(6, key_id=ALICE, lane=Lane.LIST)
    submit(3, key_id=BOB, lane=Lane.LIST)
    claims = jobs.take("worker", 1, lease_seconds=60.0, together=6).claims
    assert sorted(claim.key_id for claim in claims) == sorted([ALICE, BOB] * 3)


def test_a_finished_job_is_followed_by_one_of_a_lane_that_is_owed_it(jobs, sweeps, submit):
    queue_sweep(sweeps, jobs)
    submit(2)
    (claim,) = take(jobs)
    solved = jobs.finish(claim, SOLUTION, then_take=1, lease_seconds=60.0, starved=(Lane.SWEEP,))
    assert [claim.lane for claim in solved[1].claims] == [Lane.SWEEP]


@pytest.mark.parametrize("lane", [Lane.SINGLE, Lane.LIST])
def test_a_thousand_jobs_of_one_key_do_not_starve_three_of_another(jobs, submit, lane):
    submit(1000, key_id=ALICE, lane=lane)
    assert keys_in_order(jobs, 10) == [ALICE] * 10
    submit(3, key_id=BOB, lane=lane)
    submit(2, key_id=CAROL, lane=lane)
    order = keys_in_order(jobs, 10)
    assert all(order.index(key) < 3 for key in (BOB, CAROL))
    for k in range(1, 10):
        assert order[:k].count(BOB) >= min(3, k // 3)
    assert (order.count(BOB), order.count(CAROL)) == (3, 2)


def test_the_sweep_of_one_key_does_not_starve_that_of_another(jobs, sweeps):
    queue_sweep(sweeps, jobs, key_id=ALICE)
    few = sweeps.submit({"axes": []}, points=3, most=1, key_id=BOB)
    sweeps_taken = []
    for _ in range(6):
        (claim,) = take(jobs)
        sweeps_taken.append(claim.key_id)
        points = ChunkPoints([SOLVED] * claim.problem["count"], {})
        assert jobs.finish(claim, chunk_outcome(points, 1.0))[0]
    assert sweeps_taken.count(BOB) == 3
    assert sweeps.get(few.id).state is JobState.SUCCEEDED


def test_being_away_or_cancelling_changes_no_share(jobs, submit):
    submit(20, key_id=ALICE)
    assert keys_in_order(jobs, 5) == [ALICE] * 5
    for job_id in submit(100, key_id=BOB):
        jobs.cancel(job_id)
    (job_id,) = submit(key_id=BOB)
    assert job_id in [claim.job_id for claim in take(jobs, 2)]


def test_within_a_key_and_lane_priority_comes_first_then_age(jobs, submit):
    ids = {priority: submit(2, priority=priority, key_id=ALICE) for priority in (0, -100, 7)}
    order = [claim.job_id for claim in take(jobs, 6)]
    assert order == [*ids[7], *ids[0], *ids[-100]]


def test_a_key_whose_jobs_are_long_has_fewer_of_them_started(jobs, database, submit):
    """What the last job of a key took is what its next ones count for."""
    for key, seconds in ((ALICE, 10.0), (BOB, 0.01)):
        submit(key_id=key)
        (claim,) = take(jobs)
        with database.write() as session:
            began = update(JobRow).where(JobRow.id == claim.job_id)
            session.execute(began.values(started_at=JobRow.started_at - seconds))
        assert finish_success(jobs, claim, SUMMARY, dense=b"", samples=b"")
    for key in (ALICE, BOB):
        submit(30, key_id=key)
    order = keys_in_order(jobs, 22)
    assert 2 <= order.count(ALICE) <= 3


def test_a_job_that_comes_back_keeps_its_turn(jobs, submit):
    first, second = submit(2, key_id=ALICE)
    (claim,) = take(jobs)
    assert jobs.give_back(claim)
    assert [claim.job_id for claim in take(jobs, 2)] == [first, second]


def test_requests_of_a_key_at_the_same_instant_get_turns_of_their_own(postgres_url):
    """Else a key would get further by sending many at once than by sending them in order."""
    database = Database(postgres_url)
    together = Barrier(4)

    def submit(_):
        together.wait(timeout=PATIENCE)
        for _ in range(5):
            JobStore(database).submit(PROBLEM, new_id(), key_id=ALICE)

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(submit, range(4)))
    with database.read() as session:
        turns = session.scalars(select(JobRow.turn).order_by(JobRow.turn)).all()
    database.close()
    assert [b - a for a, b in pairwise(turns)] == [1.0] * 19
