"""A batch of short jobs is claimed before there is a place for it: none is lost, none done twice."""

import pytest
from sqlalchemy.exc import OperationalError

from service.jobs.queue import BatchSize
from service.jobs.records import AttemptOutcome, JobState
from tests.support.waiting import wait_until
from tests.workers.process.together import LIMITS, Together
from workers.process import runner as runner_module

pytestmark = pytest.mark.any_database
BATCH = 8
"""The least at which a worker claims ahead."""


class EightAtOnce(BatchSize):
    """However long jobs take, and whatever trouble there was."""

    def __init__(self):
        self.most = BATCH

    def learn(self, number, seconds):
        """Learn nothing."""

    def reset(self):
        """Forget nothing."""


@pytest.fixture
def crew(jobs, pool, monkeypatch):
    monkeypatch.setattr(runner_module, "BatchSize", EightAtOnce)
    # Of a batch everything is begun, however busy the machine.
    monkeypatch.setattr(runner_module, "BATCH_SECONDS", 60.0)
    crew = Together(jobs, pool, LIMITS)
    yield crew
    crew.runner.give_back()


def states(crew, ids) -> list[JobState]:
    return [crew.jobs.get(job_id).state for job_id in ids]


def test_the_next_batch_is_claimed_beside_the_first_and_each_job_is_done_once(crew, tmp_path):
    log = tmp_path / "log"
    ids = crew.submit(*({"number": k, "log": str(log)} for k in range(5 * BATCH)))
    crew.turn()
    assert states(crew, ids) == [JobState.RUNNING] * 2 * BATCH + [JobState.QUEUED] * 3 * BATCH
    assert crew.finish(ids) == [JobState.SUCCEEDED] * len(ids)
    assert len(log.read_text().split()) == len(ids)
    assert {tuple(crew.outcomes(job_id)) for job_id in ids} == {(AttemptOutcome.SUCCEEDED,)}
    assert sorted(crew.told) == sorted(ids)


def test_what_waits_while_nothing_is_begun_goes_back_to_the_queue_for_others(
    crew, jobs, tmp_path, monkeypatch
):
    monkeypatch.setattr(runner_module, "BATCH_SECONDS", 0.0)
    log = tmp_path / "log"
    ids = crew.submit(
        {"chore": "sleep", "seconds": 3.0, "log": str(log)}, *({} for _ in range(2 * BATCH - 1))
    )
    crew.turn()
    assert states(crew, ids) == [JobState.RUNNING] * 2 * BATCH
    wait_until(lambda: crew.turn() or states(crew, ids[1:]) == [JobState.QUEUED] * (2 * BATCH - 1))
    claims = jobs.take("another", 1, lease_seconds=60.0, together=2 * BATCH).claims
    assert sorted(claim.job_id for claim in claims) == sorted(ids[1:])
    assert crew.finish(ids[:1]) == [JobState.SUCCEEDED]
    assert {tuple(crew.outcomes(job_id)) for job_id in ids[1:]} == {(AttemptOutcome.RETURNED, None)}


def test_results_of_an_outage_are_stored_after_it_and_those_of_the_next_batch_too(
    crew, tmp_path, monkeypatch
):
    log, store_all = tmp_path / "log", crew.runner._results.store_all
    refusals = iter(range(3))

    def refuse(*arguments):
        if next(refusals, None) is not None:
            raise OperationalError("COMMIT", {}, Exception("the database is away"))
        return store_all(*arguments)

    monkeypatch.setattr(crew.runner._results, "store_all", refuse)
    ids = crew.submit(*({"number": k, "log": str(log)} for k in range(3 * BATCH)))
    crew.turn()

    def meets_an_outage() -> bool:
        try:
            crew.turn()
        except OperationalError:
            return True
        return False

    for _ in range(3):
        wait_until(meets_an_outage)
    # The child was given what had been claimed ahead and nothing else: its results are kept, too.
    wait_until(lambda: len(log.read_text().split()) == 2 * BATCH)
    assert len(crew.runner._runs) == 2
    assert states(crew, ids) == [JobState.RUNNING] * 2 * BATCH + [JobState.QUEUED] * BATCH
    assert crew.finish(ids) == [JobState.SUCCEEDED] * len(ids)
    assert len(log.read_text().split()) == len(ids)
    assert {tuple(crew.outcomes(job_id)) for job_id in ids} == {(AttemptOutcome.SUCCEEDED,)}


def test_a_worker_that_stops_gives_back_what_waits(crew, tmp_path):
    log = tmp_path / "log"
    ids = crew.submit({"chore": "spin", "log": str(log)}, *({} for _ in range(2 * BATCH - 1)))
    wait_until(lambda: crew.turn() or log.exists())
    crew.runner.give_back()
    assert not crew.runner.is_busy
    assert states(crew, ids) == [JobState.QUEUED] * len(ids)
    assert {tuple(crew.outcomes(job_id)) for job_id in ids} == {(AttemptOutcome.RETURNED,)}


def test_cancelled_jobs_that_wait_are_computed_by_nobody(crew, tmp_path):
    log, first = tmp_path / "log", tmp_path / "first"
    slow = {"chore": "sleep", "seconds": 0.5, "log": str(first)}
    ids = crew.submit(slow, *({"log": str(log)} for _ in range(2 * BATCH - 1)))
    wait_until(lambda: crew.turn() or first.exists())
    cancelled = ids[-3:]
    for job_id in cancelled:
        crew.jobs.cancel(job_id)
    assert crew.finish(ids) == [JobState.SUCCEEDED] * (len(ids) - 3) + [JobState.CANCELLED] * 3
    assert len(log.read_text().split()) == len(ids) - 1 - 3
