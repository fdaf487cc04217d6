"""The part of a Dask cluster's workers: a task of bytes to bytes, and the plugin that owns the children.

Nothing of it knows a database, or a secret. The scheduler loads this module too, since it reads the tasks
that it hands out.
"""

import os
from collections.abc import Mapping

from distributed import Worker, WorkerPlugin, get_worker

from service.dynamics.numerics import NUMERICS
from service.versions import version_of
from workers.process.messages import pack_fault
from workers.process.pool import ReturnedError
from workers.process.remote import ChildrenProcess

PLUGIN = TOPIC = "polhode"
"""The name of the plugin, and of the events by which its workers tell how they are."""


def equipment(memory_mb: int) -> dict[str, object]:
    """Return what must be equal for a worker to be used; bits depend on more, which each result tells."""
    return {"version": version_of("polhode"), "numerics": NUMERICS, "memory_mb": memory_mb}


def compute(key: str, incarnation: str, request: bytes) -> bytes:
    """Compute a batch on the worker that it was sent to: the only task that there is.

    A worker that was started anew at the same address refuses it: it would be computed twice.
    """
    plugin = get_worker().plugins.get(PLUGIN)
    if not isinstance(plugin, ChildrenPlugin) or plugin.incarnation != incarnation:
        return pack_fault(
            {"begun": 0, "seconds": 0.0}, ReturnedError("its Dask worker has been started anew")
        )
    return plugin.children.compute(key, request)


def stop_batch(key: str, dask_worker: Worker) -> None:
    """Have no other call of a batch begun; its worker tells how many were."""
    plugin = dask_worker.plugins.get(PLUGIN)
    if isinstance(plugin, ChildrenPlugin):
        plugin.children.stop(key)


class ChildrenPlugin(WorkerPlugin):
    """As many children as its worker has threads, in a process of their own."""

    name = PLUGIN
    idempotent = True
    children: ChildrenProcess
    incarnation: str
    """Differs for each start of a worker."""

    def __init__(self, tasks: str, memory_mb: int) -> None:
        self._tasks, self._memory_mb = tasks, memory_mb

    def setup(self, worker: Worker) -> None:
        """Start the children of a worker."""
        self.incarnation = os.urandom(8).hex()
        self._worker = worker
        slots = worker.state.nthreads
        self._facts = {
            "worker": worker.contact_address or worker.address,
            "incarnation": self.incarnation,
            "threads": slots,
            "equipment": equipment(self._memory_mb),
        }
        self.children = ChildrenProcess(self._tasks, slots, self._memory_mb, self._tell)

    def teardown(self, worker: Worker) -> None:
        """Kill the children; what they had is computed elsewhere, and counts for nothing."""
        worker.log_event(TOPIC, {**self._facts, "is_leaving": True})
        self.children.close()

    def transition(self, key: object, start: str, finish: str, **_: object) -> None:
        """Kill the computation of a task that nobody wants any more: cancelled, or its client is gone."""
        if finish in ("cancelled", "released", "forgotten") and start in ("executing", "long-running"):
            self.children.kill(str(key))

    def _tell(self, state: Mapping[str, object]) -> None:
        self._worker.log_event(TOPIC, {**self._facts, **state})
