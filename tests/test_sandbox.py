"""A sandbox bears what a computation may do, and says what happened."""

import math
import os
import signal
from concurrent.futures import CancelledError

import pytest

from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError, result_of
from tests.support.waiting import PATIENCE, wait_until


@pytest.fixture(scope="module")
def sandbox():
    sandbox = Sandbox(1, memory_mb=200)
    yield sandbox
    sandbox.close()


def test_a_value_comes_back(sandbox):
    assert sandbox.run(math.hypot, 3.0, 4.0, seconds=PATIENCE) == 5.0


def test_it_runs_in_another_process(sandbox):
    assert sandbox.run(os.getpid, seconds=PATIENCE) != os.getpid()


def test_what_the_function_raises_is_raised(sandbox):
    with pytest.raises(ValueError, match="math domain error"):
        sandbox.run(math.sqrt, -1.0, seconds=PATIENCE)


def test_time_is_limited(sandbox):
    with pytest.raises(SandboxTimeoutError):
        sandbox.run(sum, range(10**12), seconds=0.2)
    assert sandbox.run(abs, -1, seconds=PATIENCE) == 1


def test_memory_is_limited(sandbox):
    assert len(sandbox.run(bytes, 50 * 1024**2, seconds=PATIENCE)) == 50 * 1024**2
    with pytest.raises(SandboxMemoryError):
        sandbox.run(bytes, 300 * 1024**2, seconds=PATIENCE)
    assert sandbox.run(abs, -1, seconds=PATIENCE) == 1


@pytest.mark.parametrize(
    ("crash", "argument", "told"), [(signal.raise_signal, signal.SIGABRT, "SIGABRT"), (os._exit, 3, "code 3")]
)
def test_a_crash_is_told(sandbox, crash, argument, told):
    with pytest.raises(SandboxCrashError, match=told):
        sandbox.run(crash, argument, seconds=PATIENCE)
    assert sandbox.run(abs, -1, seconds=PATIENCE) == 1


def test_cancelling_kills_the_child(sandbox):
    child = sandbox.run(os.getpid, seconds=PATIENCE)
    future = sandbox.submit(sum, range(10**12), seconds=None)
    wait_until(future.running)
    future.cancel()
    with pytest.raises(CancelledError):
        result_of(future)
    assert sandbox.run(os.getpid, seconds=PATIENCE) != child


def test_a_killed_idle_child_is_replaced(sandbox):
    child = sandbox.run(os.getpid, seconds=PATIENCE)
    os.kill(child, signal.SIGKILL)
    # The pool notices within 0.1 s; a call that comes before finds no child, and is made once more.
    assert sandbox.run(os.getpid, seconds=PATIENCE) != child
