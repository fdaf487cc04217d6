"""Laws of every pool: what has begun and ended, limits, a stop before the next call, a kill."""

import json
from concurrent.futures import CancelledError

import numpy as np
import pytest

from service.jobs.records import JobKind, JobResult, Refused, Solved
from service.sandbox import SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.storage.codecs.packing import decode_points, encode_document
from tests.support.waiting import is_alive, wait_until
from tests.workers.chores import SOURCE

pytestmark = pytest.mark.parametrize("pool", ["local", "dask"], indirect=True)
HOUR = 3600.0


def calls(*problems):
    return [({"job": str(number)}, (json.dumps(problem),)) for number, problem in enumerate(problems)]


def start(pool, *problems, seconds=HOUR):
    # An hour, so that all calls are begun, however busy the machine.
    return pool.start(JobKind.SOLVE, calls(*problems), seconds=seconds, turn_seconds=HOUR)


def ended(batch):
    wait_until(lambda: batch.has_ended)
    return batch


def begun(log):
    return log.read_text().split() if log.exists() else []


def test_outcomes_are_those_of_the_calls_in_their_order(pool):
    assert pool.places() == 1
    batch = ended(start(pool, {}, {"chore": "refuse"}, {"chore": "raise"}, {}))
    first, second, third, fourth = batch.outcomes()
    assert isinstance(first, Solved)
    assert (first.dense, first.samples) == (b"dense", b"samples")
    assert second == Refused({"code": "no_motion", "detail": "there is none"})
    assert third is None
    assert fourth == first
    assert batch.begun == 4
    assert batch.outcomes() == [first, second, third, fourth]  # as during an outage of the database


def test_a_chunk_has_the_bits_that_were_computed(pool):
    document = json.dumps({"first": 7, "count": 3, "sweep": {"seconds": 0.1}})
    (outcome,) = ended(
        pool.start(JobKind.CHUNK, [({}, (document,))], seconds=HOUR, turn_seconds=HOUR)
    ).outcomes()
    assert (outcome.count, outcome.refused, outcome.bounds) == (3, 0, {"period": (7.0, 9.0)})
    assert outcome.seconds == 0.1 * 3
    columns = decode_points(outcome.data)
    assert np.array_equal(columns.numbers["period"], [7.0, 8.0, 9.0])
    assert outcome.source == SOURCE


def test_a_share_that_is_told_never_falls_and_is_less_than_1_to_the_end(pool, tmp_path):
    goes_on = tmp_path / "goes on"
    document = json.dumps({"shares": [0.25, 0.125, 0.5, 7.0], "goes_on": str(goes_on)})
    batch = pool.start(JobKind.STUDY, [({}, (document,))], seconds=HOUR, turn_seconds=HOUR)
    # Shares are written in parts of 256.
    for number, share in enumerate([0.25, 0.25, 0.5, 255 / 256]):
        wait_until(lambda share=share: batch.share == share)
        (tmp_path / f"goes on{number}").touch()
    assert ended(batch).outcomes() == [JobResult(encode_document({}))]
    assert batch.share == 255 / 256


def test_a_single_call_tells_its_own_fault(pool):
    batch = ended(start(pool, {"chore": "raise"}))
    with pytest.raises(Exception, match="a fault of ours"):
        batch.outcomes()


@pytest.mark.parametrize(
    ("chore", "fault"),
    [("spin", SandboxTimeoutError), ("crash", SandboxCrashError), ("hog", SandboxMemoryError)],
)
def test_a_limit_or_a_death_costs_the_call_and_not_its_place(pool, chore, fault):
    # An hour for what ends by itself, however busy the machine.
    batch = ended(start(pool, {"chore": chore}, seconds=0.5 if chore == "spin" else HOUR))
    with pytest.raises(fault):
        batch.outcomes()
    assert isinstance(ended(start(pool, {})).outcomes()[0], Solved)


def test_the_call_that_a_child_died_of_is_the_one_that_was_begun_last(pool):
    batch = ended(start(pool, {}, {}, {"chore": "crash"}, {}))
    with pytest.raises(SandboxCrashError):
        batch.outcomes()
    assert batch.begun == 3


def test_a_stop_lets_no_other_call_begin(pool, tmp_path):
    log = tmp_path / "log"
    batch = start(pool, {}, {"chore": "sleep", "seconds": 1.5, "log": str(log)}, {"log": str(log)}, {})
    wait_until(lambda: begun(log))
    assert wait_until(lambda: batch.stop() < 4 and batch.stop()) == 2
    assert len(ended(batch).outcomes()) == 2
    assert len(begun(log)) == 1


@pytest.mark.parametrize("others", [0, 2])
def test_a_kill_ends_the_child(pool, tmp_path, others):
    log = tmp_path / "log"
    batch = start(pool, {"chore": "spin", "log": str(log)}, *[{}] * others)
    (child,) = wait_until(lambda: begun(log))
    batch.kill()
    with pytest.raises(CancelledError):
        ended(batch).outcomes()
    wait_until(lambda: not is_alive(child))
    assert isinstance(ended(start(pool, {})).outcomes()[0], Solved)
