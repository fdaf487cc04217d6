"""The life of a job in the database: claimed once, finished once, behind a fence."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import func, select

from service.jobs.records import (
    ALLOWED,
    MOST_DOUBTS,
    AttemptOutcome,
    ClaimedJobs,
    JobFinishedError,
    JobNotFoundError,
    JobState,
    SolutionNotFoundError,
)
from service.storage.database.rows import new_id
from service.storage.jobs.rows import BEGUN
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionRow
from tests.support.databases import PROBLEM, SUMMARY
from tests.support.effort import examples
from tests.support.finishing import finish_success
from tests.support.lists import list_jobs
from workers.process.results import shared_out

OVER = -1.0  # a lease that has ended when it is granted


def claim(jobs, worker="worker", lease_seconds=60.0):
    return jobs.claim(worker, lease_seconds=lease_seconds)


def succeed(jobs, claimed):
    return finish_success(jobs, claimed, SUMMARY, dense=b"dense", samples=b"samples")


def count_results(database):
    with database.read() as session:
        tables = (SolutionRow, DenseOutputRow, SamplesRow)
        return [session.scalar(select(func.count()).select_from(table)) for table in tables]


def test_a_new_job_waits_with_its_problem(jobs):
    job = jobs.submit(PROBLEM, "digest")
    assert jobs.get(job.id) == job
    assert (job.state, job.attempt, job.problem, job.reused) == (JobState.QUEUED, 0, PROBLEM, False)
    assert not job.is_finished


@pytest.mark.parametrize("job_id", ["0198c0de-0000-7000-8000-000000000000", "1", "'; DROP TABLE jobs"])
def test_an_unknown_job_is_not_found(jobs, job_id):
    with pytest.raises(JobNotFoundError):
        jobs.get(job_id)
    with pytest.raises(JobNotFoundError):
        jobs.cancel(job_id)


def test_the_oldest_job_is_claimed_first(jobs):
    submitted = [jobs.submit(PROBLEM, str(n)).id for n in range(5)]
    assert [claim(jobs).job_id for _ in range(5)] == submitted
    assert claim(jobs) is None


def test_of_many_workers_one_gets_the_job(jobs):
    submitted = {jobs.submit(PROBLEM, str(n)).id for n in range(10)}
    with ThreadPoolExecutor(8) as pool:
        claims = list(pool.map(lambda n: claim(jobs, f"worker-{n}"), range(30)))
    taken = [c.job_id for c in claims if c is not None]
    assert len(taken) == 10
    assert set(taken) == submitted


def test_success_stores_result_and_state_together(jobs, solutions, database):
    job = jobs.submit(PROBLEM, "digest")
    assert succeed(jobs, claim(jobs))
    done = jobs.get(job.id)
    assert (done.state, done.progress, done.reused, done.error) == (JobState.SUCCEEDED, 1.0, False, None)
    solution = solutions.get(done.solution_id)
    assert (solution.job_id, solution.problem, solution.summary) == (job.id, PROBLEM, SUMMARY)
    assert solutions.dense(solution.id) == b"dense"
    assert solutions.samples(solution.id) == b"samples"
    assert count_results(database) == [1, 1, 1]


def test_a_failure_keeps_its_error_and_is_not_tried_again(jobs):
    job = jobs.submit(PROBLEM, "digest")
    error = {"code": "no_motion", "detail": "there is none"}
    assert jobs.finish_failure(claim(jobs), error)
    assert (jobs.get(job.id).state, jobs.get(job.id).error) == (JobState.FAILED, error)
    assert claim(jobs) is None
    assert jobs.reconcile(max_attempts=3) == ()


@pytest.mark.parametrize("stale", [{"attempt": 2}, {"worker": "another"}])
def test_a_write_of_anybody_else_changes_nothing(jobs, database, stale):
    job = jobs.submit(PROBLEM, "digest")
    zombie = replace(claim(jobs), **stale)
    assert not succeed(jobs, zombie)
    assert not jobs.finish_failure(zombie, {"code": "x"})
    assert not jobs.heartbeat([zombie], lease_seconds=60)
    assert not jobs.give_back(zombie)
    assert not jobs.lose(zombie, "x", max_attempts=3)
    assert jobs.held([zombie]) == frozenset()
    assert jobs.get(job.id).state is JobState.RUNNING
    assert count_results(database) == [0, 0, 0]


def test_a_zombie_finds_its_job_finished_by_the_next(jobs, database):
    job = jobs.submit(PROBLEM, "digest")
    zombie = claim(jobs, "first", OVER)
    assert jobs.reconcile(max_attempts=3) == (job.id,)
    second = claim(jobs, "second")
    assert (second.job_id, second.attempt) == (job.id, 2)
    assert not succeed(jobs, zombie)
    assert succeed(jobs, second)
    assert not succeed(jobs, zombie)
    assert count_results(database) == [1, 1, 1]
    outcomes = [(a.worker, a.outcome) for a in jobs.attempts(job.id)]
    assert outcomes == [("first", AttemptOutcome.RETURNED), ("second", AttemptOutcome.SUCCEEDED)]


def test_a_heartbeat_keeps_the_lease(jobs):
    jobs.submit(PROBLEM, "digest")
    claimed = claim(jobs, lease_seconds=OVER)
    assert jobs.heartbeat([claimed], lease_seconds=60)
    assert jobs.reconcile(max_attempts=3) == ()
    assert jobs.held([claimed]) == {claimed.job_id}


def test_progress_rises_while_the_claim_holds_and_is_1_at_success_only(jobs):
    job = jobs.submit(PROBLEM, "digest")
    first = claim(jobs, "first", OVER)
    told = []
    for share in (0.25, 0.125, 0.5):
        jobs.note_progress([(first, share)])
        told.append(jobs.get(job.id).progress)
    assert told == [0.25, 0.25, 0.5]
    jobs.reconcile(max_attempts=3)
    second = claim(jobs, "second")
    # Who has lost the job tells nothing of it any more; who has it now begins anew.
    jobs.note_progress([(first, 0.75), (second, 0.125)])
    assert jobs.get(job.id).progress == 0.5
    assert succeed(jobs, second)
    jobs.note_progress([(second, 0.75)])
    assert jobs.get(job.id).progress == 1.0


def test_a_job_that_kills_its_workers_is_given_up_with_its_history(jobs):
    job = jobs.submit(PROBLEM, "digest")
    for n in range(3):
        jobs.note_begun(claim(jobs, f"worker-{n}", OVER))
        jobs.reconcile(max_attempts=3)
    assert jobs.lose(claim(jobs, "worker-3"), "the child died of SIGSEGV", max_attempts=3)
    dead = jobs.get(job.id)
    assert (dead.state, dead.error["code"]) == (JobState.FAILED, "lost_worker")
    assert [a["worker"] for a in dead.error["attempts"]] == [f"worker-{n}" for n in range(4)]
    assert [a["outcome"] for a in dead.error["attempts"]] == ["returned", "lost", "lost", "lost"]
    assert dead.error["attempts"][3]["detail"] == "the child died of SIGSEGV"
    assert claim(jobs) is None


def test_what_was_lost_with_others_is_claimed_alone_and_before_the_others(jobs):
    submitted = [jobs.submit(PROBLEM, str(n)).id for n in range(6)]
    together = {"lease_seconds": OVER, "together": 3}
    assert [c.job_id for c in jobs.take("first", 1, **together).claims] == submitted[:3]
    assert set(jobs.reconcile(max_attempts=1)) == set(submitted[:3])
    for job_id in submitted[:3]:
        (claimed,) = jobs.take(f"worker of {job_id}", 1, **together).claims
        assert (claimed.job_id, claimed.alone) == (job_id, True)
        jobs.note_begun(claimed)
    rest = jobs.take("another", 1, **together).claims
    assert [(c.job_id, c.alone) for c in rest] == [(job_id, False) for job_id in submitted[3:]]
    # What has begun and is lost alone counts.
    jobs.reconcile(max_attempts=1)
    assert [jobs.get(job_id).state for job_id in submitted] == [JobState.FAILED] * 3 + [JobState.QUEUED] * 3


def test_a_job_with_which_no_child_has_begun_is_not_lost_with_its_worker(jobs):
    job = jobs.submit(PROBLEM, "digest")
    for number in range(MOST_DOUBTS):
        claimed = claim(jobs, f"worker-{number}", OVER)
        assert claimed.alone == (number > 0)
        jobs.reconcile(max_attempts=1)
    assert {attempt.outcome for attempt in jobs.attempts(job.id)} == {AttemptOutcome.RETURNED}
    # Its worker may die of it sooner than it can say so: there is an end of it.
    late = claim(jobs, "last", OVER)
    jobs.reconcile(max_attempts=1)
    assert jobs.get(job.id).error["code"] == "lost_worker"
    # What ended is not written to any more.
    jobs.note_begun(late)
    assert jobs.attempts(job.id)[-1].detail == "the lease ended without a heartbeat"


def test_of_a_job_that_succeeds_alone_nothing_is_left_of_its_beginning(jobs):
    job = jobs.submit(PROBLEM, "digest")
    claim(jobs, "first", OVER)
    jobs.reconcile(max_attempts=3)
    alone = claim(jobs, "second")
    jobs.note_begun(alone)
    assert jobs.attempts(job.id)[-1].detail == BEGUN
    assert succeed(jobs, alone)
    assert jobs.attempts(job.id)[-1].detail is None


def test_two_that_a_worker_computed_beside_each_other_are_not_to_blame_for_its_loss(jobs):
    first, second = (jobs.submit(PROBLEM, str(n)).id for n in range(2))
    for number in range(MOST_DOUBTS):
        assert len(jobs.take(f"worker-{number}", 2, lease_seconds=OVER).claims) == 2
        # However the leases end, one after the other: each had the other beside it.
        assert set(jobs.reconcile(max_attempts=1)) == {first, second}
    for job_id in (first, second):
        assert {attempt.outcome for attempt in jobs.attempts(job_id)} == {AttemptOutcome.RETURNED}
        assert jobs.get(job_id).state is JobState.QUEUED
    # A worker may never have only one of them: there is an end of it.
    assert len(jobs.take("last", 2, lease_seconds=OVER).claims) == 2
    jobs.reconcile(max_attempts=1)
    assert {jobs.get(job_id).state for job_id in (first, second)} == {JobState.FAILED}


def test_a_place_is_for_one_that_is_to_be_alone_or_for_several_others(jobs):
    submitted = [jobs.submit(PROBLEM, str(n)).id for n in range(5)]
    assert jobs.lose(claim(jobs), "died", max_attempts=3)
    taken = jobs.take("worker", 2, lease_seconds=60.0, together=4).claims
    assert [(c.job_id, c.alone) for c in taken] == [(submitted[0], True), (submitted[1], False)]
    assert list(shared_out(taken, 2)) == [(taken[0],), (taken[1],)]


def test_a_worker_that_stops_is_not_a_loss(jobs):
    job = jobs.submit(PROBLEM, "digest")
    for _ in range(5):
        assert jobs.give_back(claim(jobs))
    assert jobs.get(job.id).state is JobState.QUEUED
    assert jobs.lose(claim(jobs), "died", max_attempts=2)
    assert jobs.get(job.id).state is JobState.QUEUED


def test_a_queued_job_is_cancelled(jobs):
    job = jobs.submit(PROBLEM, "digest")
    assert jobs.cancel(job.id).state is JobState.CANCELLED
    assert jobs.get(job.id).is_finished
    assert claim(jobs) is None


def test_a_cancelled_job_never_becomes_succeeded(jobs, database):
    job = jobs.submit(PROBLEM, "digest")
    claimed = claim(jobs)
    assert jobs.cancel(job.id).state is JobState.CANCELLED
    assert jobs.held([claimed]) == frozenset()
    assert not jobs.heartbeat([claimed], lease_seconds=60)
    assert not succeed(jobs, claimed)
    assert jobs.get(job.id).state is JobState.CANCELLED
    assert count_results(database) == [0, 0, 0]
    assert [a.outcome for a in jobs.attempts(job.id)] == [AttemptOutcome.CANCELLED]


def test_cancelling_twice_is_once(jobs):
    job = jobs.submit(PROBLEM, "digest")
    assert jobs.cancel(job.id) == jobs.cancel(job.id)


def test_a_finished_job_cannot_be_cancelled(jobs):
    job = jobs.submit(PROBLEM, "digest")
    succeed(jobs, claim(jobs))
    with pytest.raises(JobFinishedError, match="already succeeded"):
        jobs.cancel(job.id)


def test_the_same_problem_is_answered_from_the_database(jobs, database):
    first = jobs.submit(PROBLEM, "digest")
    succeed(jobs, claim(jobs))
    again = jobs.submit(PROBLEM, "digest")
    assert (again.state, again.reused, again.attempt) == (JobState.SUCCEEDED, True, 0)
    assert again.solution_id == jobs.get(first.id).solution_id
    assert again.is_finished
    assert jobs.get(again.id) == again
    assert count_results(database) == [1, 1, 1]
    assert jobs.submit(PROBLEM, "another digest").state is JobState.QUEUED


@pytest.mark.parametrize("end", ["fail", "cancel", "cancel running", "lose", "leave running"])
def test_nothing_but_a_success_is_reused(jobs, end):
    job = jobs.submit(PROBLEM, "digest")
    claimed = None if end == "cancel" else claim(jobs)
    if end == "fail":
        jobs.finish_failure(claimed, {"code": "no_motion"})
    elif end == "lose":
        jobs.lose(claimed, "died", max_attempts=1)
    elif end != "leave running":
        jobs.cancel(job.id)
    assert jobs.submit(PROBLEM, "digest").state is JobState.QUEUED


def test_equal_jobs_that_wait_together_are_computed_once(jobs, database):
    first, second = jobs.submit(PROBLEM, "digest"), jobs.submit(PROBLEM, "digest")
    succeed(jobs, claim(jobs))
    assert jobs.take("worker", 2, lease_seconds=60) == ClaimedJobs(reused=(second.id,))
    done = jobs.get(second.id)
    assert (done.state, done.reused) == (JobState.SUCCEEDED, True)
    assert done.solution_id == jobs.get(first.id).solution_id
    assert count_results(database) == [1, 1, 1]


def test_two_equal_jobs_computed_at_the_same_time_both_succeed(jobs, database):
    jobs.submit(PROBLEM, "digest")
    jobs.submit(PROBLEM, "digest")
    assert all(succeed(jobs, claimed) for claimed in [claim(jobs), claim(jobs)])
    assert count_results(database) == [2, 2, 2]


def test_jobs_are_listed_newest_first_by_state_and_page(jobs):
    submitted = [jobs.submit(PROBLEM, str(n)).id for n in range(5)]
    claim(jobs)
    page = list_jobs(jobs, state=JobState.QUEUED, limit=2, offset=1)
    assert [job.id for job in page.jobs] == [submitted[3], submitted[2]]
    assert page.total == 4
    assert list_jobs(jobs).total == 5


def test_an_unknown_solution_is_not_found(solutions):
    for method in (solutions.get, solutions.dense, solutions.samples):
        for solution_id in ("1", "0198c0de-0000-7000-8000-000000000000"):
            with pytest.raises(SolutionNotFoundError):
                method(solution_id)


STEPS = ("claim", "succeed", "fail", "lose", "give back", "cancel", "expire")


def take(jobs, job, step, claims):
    """Make one step with the newest claim, or with an old one that no longer holds."""
    if step == "claim":
        claimed = claim(jobs)
        claims.extend([] if claimed is None else [claimed])
    elif step == "cancel":
        try:
            jobs.cancel(job.id)
        except JobFinishedError:
            return
    elif step == "expire":
        for claimed in claims[-1:]:
            jobs.heartbeat([claimed], lease_seconds=OVER)
        jobs.reconcile(max_attempts=2)
    else:
        for claimed in reversed(claims):
            {
                "succeed": lambda c: succeed(jobs, c),
                "fail": lambda c: jobs.finish_failure(c, {"code": "x"}),
                "lose": lambda c: jobs.lose(c, "died", max_attempts=2),
                "give back": jobs.give_back,
            }[step](claimed)


@pytest.mark.random_law
@settings(
    max_examples=examples(8, 40), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(steps=st.lists(st.sampled_from(STEPS), min_size=1, max_size=8))
def test_whatever_happens_a_job_makes_only_legal_moves(jobs, solutions, steps):
    job = jobs.submit(PROBLEM, new_id())
    # An example before may have left a job waiting; this one must be the next.
    while (other := claim(jobs, "sweeper")) is not None and other.job_id != job.id:
        jobs.finish_failure(other, {"code": "swept"})
    claims = [other]
    state = JobState.RUNNING
    for step in steps:
        take(jobs, job, step, claims)
        now = jobs.get(job.id)
        through_queued = now.state in ALLOWED[JobState.QUEUED] and JobState.QUEUED in ALLOWED[state]
        assert now.state is state or now.state in ALLOWED[state] or through_queued
        assert (now.solution_id is not None) == (now.state is JobState.SUCCEEDED)
        assert now.attempt == len(jobs.attempts(job.id))
        running = [a for a in jobs.attempts(job.id) if a.ended_at is None]
        assert len(running) == (now.state is JobState.RUNNING)
        state = now.state
    if state not in (JobState.QUEUED, JobState.RUNNING):
        assert jobs.get(job.id).finished_at is not None
    else:
        jobs.cancel(job.id)
