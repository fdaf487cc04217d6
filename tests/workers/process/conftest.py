import pytest

from service.sandbox import Sandbox
from tests.workers.chores import CHORES
from tests.workers.process.together import LIMITS
from workers.process import pool as pool_module
from workers.process import runner as runner_module
from workers.process.pool import LocalPool


@pytest.fixture
def sandbox():
    sandbox = Sandbox(1, memory_mb=LIMITS.memory_mb)
    sandbox.start()
    yield sandbox
    sandbox.close()


@pytest.fixture
def pool(sandbox):
    """A pool with one place."""
    return LocalPool(sandbox, CHORES, slots=1)


@pytest.fixture
def take_batch_seconds(monkeypatch):
    """Change how long a call of several jobs may go on beginning others."""

    def change(seconds: float) -> None:
        for module in (pool_module, runner_module):
            monkeypatch.setattr(module, "BATCH_SECONDS", seconds)

    return change
