"""Jobs that one call of a child computes end as each would alone: each has limits, attempts and a claim."""

import json
import os
import signal
from dataclasses import replace
from pathlib import Path

import pytest

from service.jobs.queue import BatchSize
from service.jobs.records import AttemptOutcome, Claim, JobKind, JobState
from service.storage.solutions.result_store import ResultStore
from tests.support.waiting import PATIENCE, is_alive, wait_until
from tests.workers import chores
from tests.workers.process.together import LIMITS, Together
from workers.process import runner as runner_module
from workers.process.pool import Ledger, compute_in_turn
from workers.process.results import JobLimits, shared_out

pytestmark = pytest.mark.any_database
TOGETHER = 5


class FiveAtOnce(BatchSize):
    """However long jobs take, until there is trouble."""

    def __init__(self):
        self.most = TOGETHER

    def learn(self, number, seconds):
        """Learn nothing."""


@pytest.fixture
def together(jobs, pool, monkeypatch):
    monkeypatch.setattr(runner_module, "BatchSize", FiveAtOnce)
    # Of a batch everything is begun, however busy the machine.
    monkeypatch.setattr(runner_module, "BATCH_SECONDS", 60.0)
    made = []

    def start(**limits) -> Together:
        chosen = {name: getattr(LIMITS, name) for name in JobLimits.__slots__}
        made.append(Together(jobs, pool, JobLimits(**{**chosen, **limits})))
        counted, start_batch = made[-1].batches, pool.start

        def start_counted(kind, calls, **terms):
            if len(calls) > 1:
                counted.append(len(calls))
            return start_batch(kind, calls, **terms)

        monkeypatch.setattr(pool, "start", start_counted)
        return made[-1]

    yield start
    for each in made:
        each.runner.give_back()


def test_what_a_job_tells_of_its_progress_is_seen_by_whoever_asks(together, database, jobs, tmp_path):
    shares = [0.0, 0.5, 0.75]
    document = {"shares": shares, "goes_on": str(tmp_path / "goes on")}
    job = ResultStore(database).submit(JobKind.STUDY, document, "digest")
    worker = together()
    for number, share in enumerate(shares):

        def has_told(share: float = share) -> bool:
            worker.turn()
            now = jobs.get(job.id)
            return now.state is JobState.RUNNING and now.progress == share

        wait_until(has_told)
        (tmp_path / f"goes on{number}").touch()
    assert worker.finish([job.id]) == [JobState.SUCCEEDED]
    assert jobs.get(job.id).progress == 1.0


def test_problems_share_a_call_and_each_has_its_attempt_and_its_solution(together, solutions, tmp_path):
    crew, log = together(), tmp_path / "log"
    ids = crew.submit(*({"number": k, "log": str(log)} for k in range(2 * TOGETHER)))
    assert crew.finish(ids) == [JobState.SUCCEEDED] * len(ids)
    assert len(crew.batches) == 2
    assert sorted(crew.told) == sorted(ids)
    assert len(log.read_text().split()) == len(ids)  # each was computed once
    for number, job_id in enumerate(ids):
        job = crew.jobs.get(job_id)
        assert crew.outcomes(job_id) == [AttemptOutcome.SUCCEEDED]
        assert solutions.get(job.solution_id).problem["number"] == number


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("chore", "state", "code", "attempts"),
    [
        ("refuse", JobState.FAILED, "no_motion", [AttemptOutcome.FAILED]),
        ("raise", JobState.FAILED, "internal_error", [AttemptOutcome.FAILED]),
        ("nan", JobState.FAILED, "internal_error", [AttemptOutcome.FAILED]),
        ("hog", JobState.FAILED, "memory_limit", [AttemptOutcome.FAILED]),
        ("crash", JobState.FAILED, "lost_worker", [AttemptOutcome.LOST] * 3),
    ],
)
def test_one_that_fails_fails_alone(together, chore, state, code, attempts):
    crew = together()
    problems = [{} for _ in range(TOGETHER)]
    problems[2] = {"chore": chore}
    ids = crew.submit(*problems)
    states = crew.finish(ids)
    assert crew.batches
    assert states[2] is state
    assert crew.jobs.get(ids[2]).error["code"] == code
    assert crew.outcomes(ids[2]) == attempts
    others = [*ids[:2], *ids[3:]]
    assert {crew.jobs.get(job_id).state for job_id in others} == {JobState.SUCCEEDED}
    assert [crew.outcomes(job_id) for job_id in others] == [[AttemptOutcome.SUCCEEDED]] * len(others)


def test_the_time_limit_of_one_is_not_that_of_the_others(together, monkeypatch):
    monkeypatch.setattr(runner_module, "BATCH_SECONDS", 0.0)
    crew = together(job_seconds=1.0)
    ids = crew.submit({}, {"chore": "spin"}, {}, {}, {})
    states = crew.finish(ids)
    assert states == [JobState.SUCCEEDED, JobState.FAILED, *[JobState.SUCCEEDED] * 3]
    assert crew.jobs.get(ids[1]).error["code"] == "time_limit"
    assert crew.outcomes(ids[1])[-1] is AttemptOutcome.FAILED


def begun(log: Path) -> list[str]:
    return log.read_text().split() if log.exists() else []


def test_cancelling_the_one_that_runs_kills_its_child_and_no_other_job(together, tmp_path):
    crew, log = together(), tmp_path / "log"
    ids = crew.submit({}, {"chore": "spin", "log": str(log)}, {}, {}, {})
    wait_until(lambda: crew.turn() or begun(log))
    crew.jobs.cancel(ids[1])
    assert crew.finish(ids) == [JobState.SUCCEEDED, JobState.CANCELLED, *[JobState.SUCCEEDED] * 3]
    assert crew.outcomes(ids[1]) == [AttemptOutcome.CANCELLED]
    wait_until(lambda: not is_alive(begun(log)[0]))


def test_jobs_behind_a_long_one_go_back_to_the_queue_for_others(together, jobs, tmp_path, monkeypatch):
    monkeypatch.setattr(runner_module, "BATCH_SECONDS", 0.0)
    crew, log = together(), tmp_path / "log"
    ids = crew.submit({"chore": "sleep", "seconds": 3.0, "log": str(log)}, {}, {}, {}, {})
    wait_until(lambda: crew.turn() or begun(log))

    def another_has_them() -> bool:
        crew.turn()
        return all(jobs.get(job_id).state is JobState.QUEUED for job_id in ids[1:])

    wait_until(another_has_them)
    claims = jobs.take("another", 4, lease_seconds=60.0).claims
    assert [claim.job_id for claim in claims] == ids[1:]
    assert crew.finish(ids[:1]) == [JobState.SUCCEEDED]
    assert crew.outcomes(ids[0]) == [AttemptOutcome.SUCCEEDED]
    assert crew.outcomes(ids[1]) == [AttemptOutcome.RETURNED, None]


def test_a_child_that_is_killed_from_outside_costs_an_attempt_of_the_one_that_it_computed(together, tmp_path):
    crew, log = together(), tmp_path / "log"
    ids = crew.submit({}, {"chore": "sleep", "seconds": 1.0, "log": str(log)}, {}, {}, {})
    wait_until(lambda: crew.turn() or begun(log))
    os.kill(int(begun(log)[0]), signal.SIGKILL)
    assert crew.finish(ids) == [JobState.SUCCEEDED] * TOGETHER
    assert crew.outcomes(ids[1]) == [AttemptOutcome.LOST, AttemptOutcome.SUCCEEDED]
    assert {tuple(crew.outcomes(job_id)) for job_id in (ids[0], *ids[2:])} == {(AttemptOutcome.SUCCEEDED,)}


@pytest.mark.parametrize("pool", ["local"], indirect=True)  # its child is stopped
def test_a_child_that_dies_before_it_begins_costs_nobody_an_attempt(together, sandbox, caplog):
    crew = together(max_attempts=1)
    child = sandbox.run(os.getpid, seconds=PATIENCE)
    os.kill(child, signal.SIGSTOP)  # it takes the call, and begins nothing
    ids = crew.submit(*({} for _ in range(TOGETHER)))
    crew.turn()
    os.kill(child, signal.SIGKILL)
    assert crew.finish(ids) == [JobState.SUCCEEDED] * TOGETHER
    returned = [AttemptOutcome.RETURNED, AttemptOutcome.SUCCEEDED]
    assert [crew.outcomes(job_id) for job_id in ids] == [returned] * TOGETHER
    # Afterwards each was computed alone, unless the child held the lock of its pipe when it was stopped, or
    # the machine started no other in time: then all went back to the queue.
    assert len(crew.batches) == 1 or "no child has taken it" in caplog.text


def test_a_worker_that_stops_gives_back_all_that_it_has_not_done(together, tmp_path):
    crew, log = together(), tmp_path / "log"
    ids = crew.submit({"chore": "spin", "log": str(log)}, {}, {}, {}, {})
    wait_until(lambda: crew.turn() or begun(log))
    crew.runner.give_back()
    assert not crew.runner.is_busy
    assert {crew.jobs.get(job_id).state for job_id in ids} == {JobState.QUEUED}
    assert {tuple(crew.outcomes(job_id)) for job_id in ids} == {(AttemptOutcome.RETURNED,)}


def test_a_child_begins_nothing_more_when_it_is_told_or_its_time_is_over():
    ledger = Ledger()
    calls = [({}, (json.dumps({"number": k}),)) for k in range(4)]

    def stop_at_second(document):
        if json.loads(document)["number"] == 1:
            assert ledger.stop() == 2
        return chores.do_chore(document)

    assert len(compute_in_turn(ledger.path, 60.0, stop_at_second, calls)) == 2
    ledger.close()
    assert not Path(ledger.path).exists()
    ledger = Ledger()
    assert len(compute_in_turn(ledger.path, -1.0, chores.do_chore, calls)) == 1
    assert ledger.begun() == 1
    ledger.close()


def claim_of(number: int, kind: JobKind) -> Claim:
    return Claim(str(number), 1, "worker", {}, "digest", None, kind=kind)


def test_places_are_shared_by_problems_and_never_by_what_takes_long():
    solves = [claim_of(k, JobKind.SOLVE) for k in range(7)]
    chunk, atlas = claim_of(8, JobKind.CHUNK), claim_of(9, JobKind.ATLAS)
    alone = replace(claim_of(10, JobKind.SOLVE), alone=True)
    shares = list(shared_out([*solves[:2], chunk, *solves[2:], atlas, alone], 5))
    assert shares[:3] == [(chunk,), (atlas,), (alone,)]
    assert sorted(len(share) for share in shares[3:]) == [3, 4]
    assert sorted(int(claim.job_id) for share in shares[3:] for claim in share) == list(range(7))
    assert list(shared_out([], 3)) == []
    assert list(shared_out(solves[:2], 3)) == [(solves[0],), (solves[1],)]
