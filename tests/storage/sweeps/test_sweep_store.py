"""Sweeps as they are stored: made at once, followed, listed, cancelled, by several workers at a time."""

import threading

import pytest
from sqlalchemy import func, select, update

from service.api.tagged import TAGGED
from service.jobs.kernels import Kernels
from service.jobs.keys import Role
from service.jobs.queue import RECENT_SECONDS, ChunkRun
from service.jobs.records import JobKind, JobNotFoundError, JobState, SweepFinishedError, SweepNotFoundError
from service.local.workers import WorkerProcess
from service.storage.codecs.packing import decode_points
from service.storage.inspection.inspect import inspect
from service.storage.keys import KeyStore
from service.storage.sweeps import sweep_store as recent_chunks
from service.storage.sweeps.sweep_store import SweepStore, chunk_runs, complete_since, standing_in
from service.storage.tables.jobs import AttemptRow, JobRow
from service.storage.upkeep.presence import WorkerRegistry
from tests.support.databases import PROBLEM
from tests.support.lists import list_jobs, list_sweeps
from tests.support.sweeps import POINTS, SWEEP, finish_chunk, finish_sweep


@pytest.fixture
def sweeps(database):
    return SweepStore(database)


def submit(sweeps, *, points=POINTS, most=9, **further):
    return sweeps.submit(SWEEP, points=points, most=most, **further)


def test_ten_million_points_are_one_row_and_one_job(sweeps, database):
    record = submit(sweeps, points=10**7)
    assert sweeps.get(record.id) == record
    with database.read() as session:
        assert session.scalar(select(func.count()).select_from(JobRow)) == 1


def test_chunks_are_no_jobs_of_anybody(sweeps, jobs):
    submit(sweeps)
    claim = jobs.claim("worker", lease_seconds=60.0)
    assert claim.kind is JobKind.CHUNK
    assert claim.payload == {"sweep": SWEEP, "way": "compiled", "waits": True, **claim.problem}
    assert list_jobs(jobs).total == 0
    for forbidden in (jobs.get, jobs.cancel, jobs.attempts):
        with pytest.raises(JobNotFoundError):
            forbidden(claim.job_id)


@pytest.mark.parametrize("points", [3, 100_000])
def test_the_way_of_a_sweep_is_chosen_by_its_first_worker_and_obeyed_by_all(sweeps, jobs, database, points):
    registry = WorkerRegistry(database, lease_seconds=60.0)
    registry.see(WorkerProcess("cold", "here", "local", 1), is_warm=False, kernels=Kernels(1, 9, 30.0))
    registry.see(WorkerProcess("warm", "here", "local", 1), is_warm=True)
    record = submit(sweeps, points=points)
    assert record.way is None
    first = jobs.claim("cold", lease_seconds=60.0)
    way = "plain" if points == 3 else "compiled"
    assert (first.way, sweeps.get(record.id).way) == (way, way)
    # That it is queued again for lack of kernels changes nothing.
    assert jobs.give_back(first, "waits for kernels")
    again = jobs.claim("warm", lease_seconds=60.0)
    assert (again.job_id, again.payload["way"], sweeps.get(record.id).way) == (first.job_id, way, way)


def test_a_sweep_that_changes_its_way_keeps_no_point_and_begins_again(sweeps, jobs, database):
    keys = KeyStore(database)
    key, _ = keys.create(Role.SUBMIT)
    record = submit(sweeps, key_id=key.id)
    finish_sweep(jobs, chunks=3)
    of_compiled = standing_in(sweeps.get(record.id))
    asks, loses = (jobs.claim("worker", lease_seconds=60.0) for _ in range(2))
    assert (of_compiled.done, asks.way) == (27, "compiled")
    assert keys.all().keys[0].stored_bytes > 0
    assert jobs.change_way(asks, "plain", "kernels cannot be compiled")
    now = sweeps.get(record.id)
    assert (now.state, now.way, now.done, now.refused, now.point_seconds) == (
        JobState.RUNNING,
        "plain",
        0,
        0,
        None,
    )
    assert (list(sweeps.chunks(record.id)), keys.all().keys[0].stored_bytes) == ([], 0)
    assert [finding.code for finding in inspect(database) if finding.broken] == []
    # Who computes another chunk has lost it, and so has who asks twice.
    assert jobs.held([asks, loses]) == frozenset()
    assert not jobs.change_way(asks, "plain", "kernels cannot be compiled")
    finish_sweep(jobs, chunks=3)
    of_plain = standing_in(sweeps.get(record.id))
    # As many points, but others: who has the former ones is not told that nothing has changed.
    assert (of_plain.done, of_plain.refused) == (of_compiled.done, of_compiled.refused)
    tagged = TAGGED["/v1/sweeps/{sweep_id}/points"]
    assert tagged.identity(of_plain) != tagged.identity(of_compiled)
    finish_sweep(jobs)
    done = sweeps.get(record.id)
    assert (done.state, done.way, done.done) == (JobState.SUCCEEDED, "plain", POINTS)
    indices = [i for chunk in sweeps.chunks(record.id) for i in range(chunk.first, chunk.first + chunk.count)]
    assert indices == list(range(POINTS))


def test_what_a_chunk_refuses_is_final_where_its_way_is_all_there_is(sweeps, jobs):
    record = submit(sweeps)
    finish_sweep(jobs, chunks=1)
    claim = jobs.claim("worker", lease_seconds=60.0)
    assert jobs.change_way(claim, claim.way, "kernels cannot be compiled")
    again = jobs.claim("worker", lease_seconds=60.0)
    assert (again.job_id, again.payload) == (claim.job_id, {**claim.payload, "waits": False})
    assert sweeps.get(record.id).done == 9


def test_a_job_that_waits_is_given_to_nobody_before_its_time(sweeps, jobs):
    submit(sweeps)
    claim = jobs.claim("worker", lease_seconds=60.0)
    assert jobs.give_back(claim, "waits for kernels", pause_seconds=3600.0)
    assert jobs.claim("worker", lease_seconds=60.0) is None


def test_a_sweep_runs_from_its_first_claim_and_ends_with_its_last_point(sweeps, jobs):
    record = submit(sweeps, points=3)
    claim = jobs.claim("worker", lease_seconds=60.0)
    running = sweeps.get(record.id)
    assert (running.state, running.started_at is not None) == (JobState.RUNNING, True)
    assert running.remaining_seconds is None
    finish_chunk(jobs, claim)
    done = sweeps.get(record.id)
    assert (done.state, done.done, done.finished_at is not None) == (JobState.SUCCEEDED, 3, True)
    with pytest.raises(SweepFinishedError):
        sweeps.cancel(record.id)


@pytest.fixture
def four_chunks(sweeps, jobs, database):
    """A sweep whose first chunk and three further ones are done, one after the other, and a fifth at work."""
    record = submit(sweeps, points=10**6)
    finish_sweep(jobs, chunks=1)
    assert sweeps.get(record.id).remaining_seconds is None
    claims = [jobs.claim("worker", lease_seconds=60.0) for _ in range(4)]
    for claim in claims[:3]:
        finish_chunk(jobs, claim)
    instants = [(1000.0 + 2 * k, 1001.5 + 2 * k) for k in range(3)]
    with database.write() as session:
        for claim, (started_at, ended_at) in zip(claims, instants, strict=False):
            values = {"started_at": started_at, "ended_at": ended_at}
            session.execute(update(AttemptRow).where(AttemptRow.job_id == claim.job_id).values(values))
        session.execute(update(JobRow).where(JobRow.id == claims[3].job_id).values(started_at=1006.0))
    return record, instants


def test_the_latest_tries_are_those_at_its_chunks_but_the_first(sweeps, database, four_chunks):
    record, instants = four_chunks
    other = submit(sweeps)
    expected = [ChunkRun(1006.0, None, 0), *(ChunkRun(*each, 9) for each in instants)]
    with database.read() as session:
        runs = chunk_runs(session, [record.id, other.id], since=999.0)
        assert sorted(runs[record.id], key=lambda run: run.until(0.0)) == expected
        assert runs[other.id] == []
        later = chunk_runs(session, [record.id], since=1002.0)[record.id]
        assert sorted(later, key=lambda run: run.until(0.0)) == [expected[0], *expected[2:]]


def test_no_more_tries_are_read_than_tell_something(database, four_chunks, monkeypatch):
    _, instants = four_chunks
    monkeypatch.setattr(recent_chunks, "_LATEST", 2)
    with database.read() as session:
        # The first chunk's end is by the real clock, far later.
        assert complete_since(session, 1010.0) == instants[-1][1]
        assert complete_since(session, 10**10) == 10**10 - RECENT_SECONDS


def test_chunks_have_the_priority_of_their_sweep(sweeps, jobs):
    low, high = submit(sweeps, priority=-5), submit(sweeps, priority=5)
    solve = jobs.submit(PROBLEM, "digest")
    assert jobs.claim("worker", lease_seconds=60.0).sweep_id == high.id
    assert jobs.claim("worker", lease_seconds=60.0).job_id == solve.id
    claim = jobs.claim("worker", lease_seconds=60.0)
    assert claim.sweep_id == low.id
    finish_chunk(jobs, claim)
    # So have those that are made later.
    assert jobs.claim("worker", lease_seconds=60.0).sweep_id == low.id


def test_a_point_that_kills_its_workers_is_a_point_with_a_reason(sweeps, jobs):
    record = submit(sweeps, points=1)
    claim = jobs.claim("worker", lease_seconds=60.0)
    assert jobs.finish_failure(claim, {"code": "time_limit", "detail": "it was too long"})
    done = sweeps.get(record.id)
    assert (done.state, done.done, done.refused) == (JobState.SUCCEEDED, 1, 1)
    assert decode_points(sweeps.data(record.id, [0])[0]).outcomes == ["time_limit"]


def test_a_sweep_none_of_whose_points_can_be_computed_ends(sweeps, jobs):
    record = submit(sweeps, points=18)
    while claim := jobs.claim("worker", lease_seconds=60.0):
        assert jobs.finish_failure(claim, {"code": "memory_limit", "detail": "it was full"})
    done = sweeps.get(record.id)
    assert (done.state, done.refused) == (JobState.SUCCEEDED, 18)


def test_sweeps_are_listed_newest_first_by_state_and_page(sweeps):
    ids = [submit(sweeps).id for _ in range(3)]
    sweeps.cancel(ids[1])
    page = list_sweeps(sweeps, limit=2)
    assert ([record.id for record in page.sweeps], page.total) == ([ids[2], ids[1]], 3)
    assert [record.id for record in list_sweeps(sweeps, limit=2, offset=2).sweeps] == [ids[0]]
    assert [record.id for record in list_sweeps(sweeps, state=JobState.CANCELLED).sweeps] == [ids[1]]


@pytest.mark.parametrize("sweep_id", ["", "no id", "0" * 32])
def test_what_is_not_there_is_not_found(sweeps, sweep_id):
    for ask in (sweeps.get, sweeps.cancel):
        with pytest.raises(SweepNotFoundError):
            ask(sweep_id)


def test_several_workers_and_one_who_cancels_do_not_get_in_each_others_way(sweeps, jobs):
    kept, cancelled = submit(sweeps, points=150, most=5), submit(sweeps, points=150, most=5)
    failures = []

    def work():
        try:
            while claim := jobs.claim(threading.current_thread().name, lease_seconds=60.0):
                if claim.sweep_id == kept.id:
                    finish_chunk(jobs, claim)
                elif claim.problem["first"] >= 20:
                    sweeps.cancel(cancelled.id)
                elif claim.problem["first"] % 2:
                    jobs.finish_failure(claim, {"code": "memory_limit", "detail": "it was full"})
                else:
                    jobs.give_back(claim) if claim.attempt == 1 else jobs.lose(claim, "died", max_attempts=1)
        except Exception as fault:
            failures.append(fault)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []
    finish_sweep(jobs)
    done = sweeps.get(kept.id)
    assert (done.state, done.done) == (JobState.SUCCEEDED, 150)
    indices = [i for chunk in sweeps.chunks(kept.id) for i in range(chunk.first, chunk.first + chunk.count)]
    assert indices == list(range(150))
    assert sweeps.get(cancelled.id).state is JobState.CANCELLED
