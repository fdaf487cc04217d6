"""The fork server of a worker loads what most planar motions need, and the rest when a child asks."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from workers.process import tasks
from workers.process.tasks import WARM_UP

ROOT = Path(__file__).parents[3]
LATE = ("scipy.integrate", "workers.computation.atlases")
CHILDREN = """
import json, sys
from service.sandbox import Sandbox
from tests.workers.process.test_template import loaded
from workers.process.tasks import PRELOAD, WARM_UP
sandbox = Sandbox(1, preload=PRELOAD)
sandbox.start()
before = sandbox.run(loaded, seconds=None)
sandbox.run(WARM_UP.order, seconds=None)
same = sandbox.run(loaded, seconds=None)
sandbox.replace(0, loaded, seconds=60.0)
print(json.dumps([before, same, sandbox.run(loaded, seconds=None)]))
sandbox.close()
"""


def loaded():
    """Return which late packages this process has; called in a child."""
    return [name for name in LATE if name in sys.modules]


def test_children_forked_after_the_order_have_the_rest_and_older_ones_have_not():
    result = subprocess.run(
        [sys.executable, "-c", CHILDREN],
        env={**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert json.loads(result.stdout) == [[], [], list(LATE)]


@pytest.mark.parametrize("server", [lambda: None, os.getpid])
def test_no_other_process_gets_the_order(monkeypatch, server):
    # The signal would end a process that does not expect it, as the parent of an orphan.
    monkeypatch.setattr(tasks, "_server", server())
    sent = []
    monkeypatch.setattr(os, "kill", lambda *order: sent.append(order))
    WARM_UP.order()
    assert sent == []
