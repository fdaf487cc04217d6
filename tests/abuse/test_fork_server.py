"""Whatever of the processes around a call is killed, the call is made anew and nobody is told a fault."""

import math
import os
import signal
import time
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import forkserver, resource_tracker

import pytest

from service.sandbox import Sandbox, SandboxBrokenError
from tests.support.waiting import PATIENCE, is_alive, wait_until


@pytest.fixture
def sandbox():
    sandbox = Sandbox(1, memory_mb=200)
    sandbox.start()
    yield sandbox
    sandbox.close()


def stop_pools(sandbox: Sandbox) -> None:
    """Leave the sandbox open, and without a pool."""
    sandbox.close()
    sandbox.is_closed = False


def kill_fork_server() -> None:
    os.kill(forkserver._forkserver._forkserver_pid, signal.SIGKILL)


def test_a_fork_server_that_was_killed_is_replaced(sandbox):
    child = sandbox.run(os.getpid, seconds=PATIENCE)
    kill_fork_server()
    assert sandbox.run(math.hypot, 3.0, 4.0, seconds=PATIENCE) == 5.0
    # A child that nobody can watch must not take the calls of its successor.
    wait_until(lambda: not is_alive(child))


def test_a_call_under_way_is_made_anew_when_the_fork_server_is_killed(sandbox):
    tries = []

    def submitted(future):
        tries.append(future)
        if len(tries) == 1:
            wait_until(future.running)
            kill_fork_server()

    sandbox.run(time.sleep, 0.3, seconds=PATIENCE, submitted=submitted)
    assert len(tries) > 1


def test_the_fork_server_and_the_child_may_die_together(sandbox):
    child = sandbox.run(os.getpid, seconds=PATIENCE)
    kill_fork_server()
    os.kill(child, signal.SIGKILL)
    assert sandbox.run(os.getpid, seconds=PATIENCE) != child


@pytest.mark.filterwarnings("ignore:resource_tracker")
def test_the_resource_tracker_may_die(sandbox):
    os.kill(resource_tracker._resource_tracker._pid, signal.SIGKILL)
    kill_fork_server()
    assert sandbox.run(math.hypot, 3.0, 4.0, seconds=PATIENCE) == 5.0


@pytest.mark.parametrize(
    "fault", [EOFError(), OSError("broken pipe"), RuntimeError("the pool is not active")]
)
@pytest.mark.parametrize("place", ["_start_pool", "schedule"])
def test_a_pool_that_cannot_start_or_take_a_call_is_made_anew(sandbox, monkeypatch, place, fault):
    pool_class = type(sandbox._seats[0].pool)
    stop_pools(sandbox)
    right, failures = getattr(pool_class, place), [fault]

    def fail_once(self, *arguments, **options):
        if failures:
            raise failures.pop()
        return right(self, *arguments, **options)

    monkeypatch.setattr(pool_class, place, fail_once)
    assert sandbox.run(math.hypot, 3.0, 4.0, seconds=PATIENCE) == 5.0
    assert not failures


def test_a_call_that_nobody_will_make_any_more_does_not_wait_for_ever(sandbox, monkeypatch):
    """A pool that breaks before its scheduler has seen a call forgets the call."""
    pool = sandbox._seats[0].pool
    monkeypatch.setattr(pool._pool_manager, "schedule", lambda _: break_pool(pool))
    assert sandbox.run(math.hypot, 3.0, 4.0, seconds=PATIENCE) == 5.0


def break_pool(pool):
    raise BrokenProcessPool


def test_processes_that_can_never_be_started_end_in_an_error(sandbox, monkeypatch):
    def fail(*_):
        raise EOFError

    stop_pools(sandbox)
    monkeypatch.setattr(type(sandbox._seats[0].pool), "_start_pool", fail)
    with pytest.raises(SandboxBrokenError, match="no child process can be started"):
        sandbox.run(abs, -1, seconds=PATIENCE)
