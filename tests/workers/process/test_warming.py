"""A worker takes no job before its children may work; what cannot be warmed is told, and stops no job."""

import logging
import os
import signal
import threading
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

from service.jobs.kernels import KERNELS, Kernels
from service.local.wakeup import WARM
from service.local.workers import WorkerProcess
from service.sandbox import Sandbox, SandboxBrokenError
from service.storage.database.database import Database
from service.storage.upkeep.presence import WorkerRegistry
from tests.support.databases import copy_of
from tests.support.waiting import wait_until
from workers.process.start import Compiling, Waker, Warming
from workers.process.tasks import WarmUp
from workers.process.worker import EngineLoop, Presence

HALF = Kernels(20, 40, 12.0)


def sign(folder):
    """Write down which child was warmed, once for each call; called in a child."""
    with Path(folder, "calls").open("a") as file:
        file.write(f"{os.getpid()}\n")


def die_once(folder):
    """Die as if killed from outside; the next child lives."""
    mark = Path(folder, "dead")
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    sign(folder)


def nothing(folder):
    pass


def die(folder):
    os.kill(os.getpid(), signal.SIGKILL)


def refuse(folder):
    raise ValueError("no solver works here")


@pytest.fixture
def warm(tmp_path, caplog):
    """Warm the children of a sandbox; return which were, and the log."""
    sandboxes = []

    def warmed(function, slots, stage=None):
        sandboxes.append(Sandbox(slots, preload=[__name__]))
        woken = threading.Semaphore(0)
        first, rest = ((function, sign) if stage == 1 else (nothing, function)) if stage else (function, None)
        folder = str(tmp_path)
        what = WarmUp(partial(first, folder), rest=None if rest is None else partial(rest, folder))
        warming = Warming(sandboxes[-1], what, slots=slots, wake=woken.release)
        with caplog.at_level(logging.INFO, logger="workers"):
            warming.start()
            assert woken.acquire(timeout=120.0)
            assert warming.may_take_jobs()
            warming.go_on()
            assert woken.acquire(timeout=120.0)
        assert warming.is_over()
        calls = tmp_path / "calls"
        return (
            calls.read_text().split() if calls.exists() else [],
            [(record.levelname, record.getMessage()) for record in caplog.records],
        )

    yield warmed
    for sandbox in sandboxes:
        sandbox.close()


def test_every_child_is_warmed_once(warm, monkeypatch):
    submit = Sandbox.submit

    def submit_late(self, *call, **options):
        if threading.current_thread().name == "warming 1":
            assert wait_until(lambda: self.is_idle)
            time.sleep(0.5)  # the other child has ended its call, and is as free as this one
        return submit(self, *call, **options)

    monkeypatch.setattr(Sandbox, "submit", submit_late)
    calls, [(level, said)] = warm(sign, 2)
    assert len(calls) == len(set(calls)) == 2
    assert level == "INFO"
    assert said.startswith("warm after")


@pytest.mark.parametrize("stage", [None, 2])
def test_a_child_that_was_killed_is_replaced_and_warmed(warm, stage):
    calls, [(level, _)] = warm(die_once, 1, stage)
    assert (len(calls), level) == (1, "INFO")


def test_in_the_second_stage_each_child_is_replaced_by_a_new_one(warm):
    calls, [(level, _)] = warm(sign, 2, 1)
    assert len(calls) == len(set(calls)) == 4
    assert level == "INFO"


@pytest.mark.parametrize(
    ("function", "reason"), [(refuse, "ValueError: no solver works here"), (die, "died of SIGKILL")]
)
@pytest.mark.parametrize("stage", [None, 2])
def test_what_cannot_be_warmed_says_why_and_is_over_all_the_same(warm, function, reason, stage):
    _, [(level, said)] = warm(function, 1, stage)
    assert level == "WARNING"
    assert "taking jobs all the same" in said
    assert reason in said


@pytest.mark.parametrize("fault", [None, "no disk"])
def test_kernels_are_compiled_between_the_stages_and_told_before_the_first_job(tmp_path, monkeypatch, fault):
    woken, sandbox, told = threading.Semaphore(0), Sandbox(1, preload=[__name__]), []
    first, rest = partial(nothing, str(tmp_path)), partial(sign, str(tmp_path))
    warming = Warming(sandbox, WarmUp(first, None, rest, is_not_compiled), slots=1, wake=woken.release)

    def compile_once(compiling, should_stop):
        assert not should_stop()
        told.append(compiling.kernels)
        return (0, "") if fault is None else (1, fault)

    monkeypatch.setattr(Compiling, "_try", compile_once)
    try:
        warming.start()
        assert woken.acquire(timeout=120.0)
        assert warming.may_take_jobs()
        assert warming.kernels() == Kernels(0, KERNELS, None)
        warming.go_on()
        while not warming.is_over():
            assert woken.acquire(timeout=120.0)
    finally:
        sandbox.close()
    assert told == [Kernels(0, KERNELS, None)]
    assert warming.kernels() == (None if fault is None else Kernels(0, KERNELS, None, fault))


def is_not_compiled():
    return False


def test_a_closed_sandbox_starts_no_child_again():
    sandbox = Sandbox(1)
    sandbox.close()
    sandbox.start()
    with pytest.raises(SandboxBrokenError):
        sandbox.submit(os.getpid, seconds=None)


class Recorder:
    """A runner, a presence and a line that note what the loop asks of them."""

    is_busy = False

    def __init__(self, turns_cold, turns_half_warm):
        self.turns_cold = turns_cold
        self.turns_half_warm = turns_half_warm
        self.asked = []
        self.loop = None

    def takes_jobs(self):
        self.turns_cold -= 1
        return self.turns_cold < 0

    def is_warm(self):
        if self.turns_cold > 0:
            return False
        self.turns_half_warm -= 1
        return self.turns_half_warm < 0

    def collect(self, *, refill):
        return []

    def keep(self, *, is_warm, kernels):
        self.asked.append(("keep", is_warm, kernels))

    def fill(self):
        self.asked.append("fill")
        if self.asked.count("fill") == 3:
            self.loop.stop()
        return []

    def reconcile(self):
        self.asked.append("reconcile")

    def keep_leases(self):
        pass

    give_back = close = keep_leases

    def seconds_left(self):
        return 0.0

    def fileno(self):
        return -1

    def tell(self, word):
        self.asked.append(word)


def test_jobs_are_taken_after_the_first_stage_and_the_row_says_warm_after_the_second():
    recorder, waker = Recorder(turns_cold=2, turns_half_warm=1), Waker()
    recorder.loop = EngineLoop(
        recorder,
        recorder,
        waker,
        service=recorder,
        announcements=None,
        readiness=SimpleNamespace(
            may_take_jobs=recorder.takes_jobs, is_over=recorder.is_warm, kernels=lambda: HALF
        ),
        poll_seconds=0.0,
        grace_seconds=0.0,
    )
    recorder.loop.run()
    waker.close()
    cold = [("keep", False, HALF), "reconcile"]
    assert recorder.asked == [
        *cold,
        *cold,
        *[("keep", False, HALF), "reconcile", "fill"],
        *[("keep", True, HALF), WARM, "reconcile", "fill"],
        *[("keep", True, HALF), "reconcile", "fill"],
    ]


def test_the_row_says_at_once_that_it_is_warm_and_how_far_kernels_are(tmp_path, sqlite_template):
    database = Database(copy_of(sqlite_template, tmp_path))
    registry = WorkerRegistry(database, lease_seconds=3600.0)
    assert registry.state() == "none"
    workers = [WorkerProcess(name, "here", "local", 1) for name in "ab"]
    rows = [Presence(registry, worker, seconds=3600.0, alone=True) for worker in workers]
    for row in rows:
        row.keep(is_warm=False, kernels=None)
    assert registry.state() == "starting"
    assert registry.kernels() == []
    # Long before the row is to be renewed.
    rows[0].keep(is_warm=False, kernels=HALF)
    assert registry.kernels() == [HALF]
    rows[0].keep(is_warm=True, kernels=None)
    assert registry.state() == "warm"
    assert registry.kernels() == []
    rows[0].end()
    assert registry.state() == "starting"
    database.close()
