"""A Dask cluster as a pool: batches go to its workers as tasks, and come back as bytes.

A task is sent to one worker, and to no other: Dask would run it again elsewhere after a death, up to three
times and outside of the count of attempts. Its key names job, attempt and bridge. Workers tell by events how
far they are, once a second at least; one that is silent for a lease is given up, and what it sends later is
refused by the claim. A scheduler has no memory: when the connection to it ends, all batches are given back.

Whoever reaches the scheduler may send anything to a bridge, which holds the password of the database. Hence
:func:`~workers.process.messages.refuse_pickles`: results are bytes, and are parsed.
"""

import asyncio
import itertools
import logging
import re
import threading
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any  # Any: what workers say, and what Dask returns

from distributed import Client, Future

from service.jobs.kernels import ClusterState, Kernels, LeftOut
from service.jobs.records import JobKind
from service.sandbox import SandboxCrashError
from workers.process.dask_worker import TOPIC, ChildrenPlugin, compute, equipment, stop_batch
from workers.process.messages import RemoteBatch, pack_calls
from workers.process.pool import Call, ReturnedError

logger = logging.getLogger(__name__)

AHEAD_SECONDS = 0.3
"""While batches are shorter, each place is given another one ahead: a message takes some milliseconds."""
_LOOK_SECONDS = 0.25
"""How often the bridge looks whether the scheduler and the workers are there."""
_SURVEY_SECONDS = 5.0
"""How often it asks the scheduler for workers that say nothing."""
_CONNECT_SECONDS = 5.0
_PAUSE_SECONDS = 1.0
_HOST = re.compile(r"[a-z]+://([\w.-]+|\[[0-9a-f:]+\]):\d+")
_LOST = "the connection to the scheduler was lost"
_UNREADY = "it is not ready yet"
_SILENT = "it says nothing: perhaps polhode[cluster] is not installed there"


def log_as_others() -> None:
    """Have Dask's warnings go through the log of this process; when it is imported, it sets up its own."""
    for name in [each for each in logging.root.manager.loggerDict if each.startswith("distributed")]:
        logger = logging.getLogger(name)
        logger.handlers.clear()
        logger.propagate = True
    # It tells every connection that ends, some of them with a traceback.
    logging.getLogger("distributed").setLevel(logging.ERROR)
    for name in ("distributed.client", "distributed.batched"):
        logging.getLogger(name).setLevel(logging.CRITICAL)


@dataclass(slots=True)
class _Worker:
    """A worker of the cluster, as it was last heard."""

    address: str
    incarnation: str
    threads: int
    why_not: str | None = None
    """Why it gets no batches; None if it does."""
    heard_at: float = 0.0
    batches: dict[str, RemoteBatch] = field(default_factory=dict)


class DaskPool:
    """The workers of a Dask cluster.

    Parameters
    ----------
    scheduler
        The address of a scheduler, or the path of its file.
    tasks
        ``module:attribute`` of the :class:`~workers.process.tasks.WorkerTasks` that its workers have.
    memory_mb
        Limit of the memory of one child.
    silent_seconds
        A worker that says nothing for so long is given up.
    wake
        Called from another thread when something has happened.
    """

    def __init__(
        self,
        scheduler: str,
        tasks: str,
        *,
        memory_mb: int,
        silent_seconds: float,
        wake: Callable[[], None] = lambda: None,
    ) -> None:
        self.scheduler = scheduler
        self._plugin = ChildrenPlugin(tasks, memory_mb)
        self._ours = equipment(memory_mb)
        self._silent_seconds = silent_seconds
        self._wake = wake
        self._numbers = itertools.count()
        self._lock = threading.RLock()
        self._workers: dict[str, _Worker] = {}
        self._unheard: dict[str, str] = {}
        """Why there is no use of workers that say nothing, by address."""
        self._at_work: dict[str, _Worker] = {}
        """The worker of each batch, by key."""
        self._batch_seconds = 1.0
        self._dashboard: str | None = None
        self._is_closed = False
        self._loop: asyncio.AbstractEventLoop | None = None
        self._client: Client | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._futures: dict[str, Future[bytes]] = {}
        """The future of each batch, by key."""
        self._thread = threading.Thread(target=self._run, name="cluster", daemon=True)
        self._thread.start()

    def places(self) -> int:
        """Return how many children are ready now, twice while batches are short."""
        return self._threads() * (2 if self._batch_seconds < AHEAD_SECONDS else 1)

    def start(
        self, kind: JobKind, calls: Sequence[Call], *, seconds: float, turn_seconds: float
    ) -> RemoteBatch:
        """Send calls to the worker that has the fewest for its threads."""
        told = calls[0][0]
        named = "-".join(str(told[name]) for name in ("job", "attempt", "worker") if name in told)
        # Dask counts keys by what is before the first number.
        key = f"polhode-{kind.value}-{next(self._numbers)}-{named}"
        batch = RemoteBatch(key, kind, len(calls), self._stop, self._release)
        request = pack_calls({"seconds": seconds, "turn_seconds": turn_seconds}, kind, calls)
        with self._lock:
            usable = [worker for worker in self._workers.values() if worker.why_not is None]
            if not usable or self._loop is None:
                batch.end(ReturnedError("the cluster has no worker at the moment"))
                return batch
            worker = min(usable, key=lambda each: len(each.batches) / each.threads)
            worker.batches[key] = batch
            self._at_work[key] = worker
            sent = self._carry(batch, worker.address, worker.incarnation, request)
            self._on_loop(lambda: self._begin(sent))
        return batch

    def cluster(self) -> ClusterState:
        """Return what is there, and what is left out."""
        with self._lock:
            left = {each.address: each.why_not for each in self._workers.values() if each.why_not}
            ready = [each for each in self._workers.values() if each.why_not is None]
            left_out = tuple(LeftOut(*each) for each in sorted({**self._unheard, **left}.items()))
            threads = sum(each.threads for each in ready)
            is_there = self._client is not None
            return ClusterState(
                self.scheduler, is_there, len(ready), threads, left_out, self._dashboard if is_there else None
            )

    def go_on(self) -> None:
        """Nothing is prepared here."""

    def may_take_jobs(self) -> bool:
        """Jobs are taken as soon as there is a place for them."""
        return True

    def is_over(self) -> bool:
        """Whether some worker is ready."""
        return self._threads() > 0

    def kernels(self) -> Kernels | None:
        """Nothing is compiled here; a worker without kernels is left out."""
        return None

    def close(self) -> None:
        """Release all batches, and end the connection."""
        self._is_closed = True
        self._thread.join(_CONNECT_SECONDS)

    def _threads(self) -> int:
        with self._lock:
            return sum(each.threads for each in self._workers.values() if each.why_not is None)

    def _on_loop(self, call: Callable[[], object]) -> None:
        with suppress(RuntimeError):  # it has just been closed
            if self._loop is not None:
                self._loop.call_soon_threadsafe(call)

    def _begin(self, work: Coroutine[object, object, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _stop(self, batch: RemoteBatch) -> None:
        self._on_loop(lambda: self._begin(self._carry_stop(batch)))

    async def _carry_stop(self, batch: RemoteBatch) -> None:
        with self._lock:
            worker, client = self._at_work.get(batch.key), self._client
        if worker is None or client is None:
            return
        try:
            await client.run(stop_batch, batch.key, workers=[worker.address])
        except Exception as fault:  # then all calls may have begun, which is what the batch says
            logger.debug("no stop of %s: %s", batch.key, fault)

    def _release(self, batch: RemoteBatch) -> None:
        """Take a batch that has ended from its worker."""
        with self._lock:
            worker = self._at_work.pop(batch.key, None)
            if worker is not None:
                worker.batches.pop(batch.key, None)
            if batch.fault is None:
                self._batch_seconds = batch.ended_at - batch.began_at
        self._on_loop(lambda: self._forget(batch.key))
        self._wake()

    def _forget(self, key: str) -> None:
        """Have Dask forget a task; a worker that computes it stops."""
        if (future := self._futures.pop(key, None)) is not None:
            future.release()

    async def _carry(self, batch: RemoteBatch, address: str, *arguments: object) -> None:
        """Send a batch, and wait for its reply."""
        client = self._client
        if client is None or batch.has_ended:
            batch.end(ReturnedError(_LOST))
            return
        try:
            future = client.submit(
                compute,
                batch.key,
                *arguments,
                key=batch.key,
                workers=[address],
                allow_other_workers=False,
                retries=0,
                pure=False,
            )
            self._futures[batch.key] = future
            batch.reply(await future)
        except CancelledError:
            batch.end(ReturnedError(_LOST))
        except Exception as fault:
            batch.end(ReturnedError(f"its Dask task ended without a reply: {type(fault).__name__}"))

    def _run(self) -> None:
        asyncio.run(self._keep_connected())

    async def _keep_connected(self) -> None:
        self._loop = asyncio.get_running_loop()
        is_told = False
        while not self._is_closed:
            try:
                async with self._connected() as client:
                    logger.info("connected to the scheduler %s", self.scheduler)
                    is_told = False
                    await self._look_after(client)
                if not self._is_closed:
                    logger.warning("the connection to the scheduler %s was lost", self.scheduler)
            except Exception as fault:
                if not is_told:
                    logger.warning("no connection to the scheduler %s: %r", self.scheduler, fault)
                is_told = True
            if not self._is_closed:
                await asyncio.sleep(_PAUSE_SECONDS)
        self._loop = None

    @asynccontextmanager
    async def _connected(self) -> AsyncIterator[Client]:
        where = {"address": self.scheduler} if "://" in self.scheduler else {"scheduler_file": self.scheduler}
        if "scheduler_file" in where and not Path(self.scheduler).exists():
            raise FileNotFoundError(f"there is no file {self.scheduler}")  # Dask would wait for ever
        client = Client(
            **where, asynchronous=True, set_as_default=False, timeout=_CONNECT_SECONDS, name="polhode"
        )
        try:
            await client
            self._client = client
            client.subscribe_topic(TOPIC, partial(self._hear, client))
            client.subscribe_topic("all", self._hear_scheduler)
            self._begin(self._register(client))  # it waits for all workers, and one may be stopped
            yield client
        finally:
            self._client = None
            self._lose_all(_LOST)
            with suppress(Exception):
                await client.close(_PAUSE_SECONDS)

    async def _register(self, client: Client) -> None:
        """Have all workers own children, those that come later too."""
        try:
            await client.register_plugin(self._plugin)
        except Exception as fault:
            # A worker without this package cannot load it; the others have it all the same.
            if client is self._client:
                logger.warning("some worker of the cluster has no children: %r", fault)

    async def _look_after(self, client: Client) -> None:
        """Give up silent workers, until the connection is lost.

        Raises
        ------
        TimeoutError
            The scheduler is silent itself: then none of its workers is to blame.
        """
        connection, survey_at = client.scheduler_comm, 0.0
        # Dask connects again by itself, perhaps to a new scheduler, which knows nothing of all this.
        while not self._is_closed and client.status == "running" and client.scheduler_comm is connection:
            silent = self._silent()
            if silent or time.monotonic() >= survey_at:
                survey_at = time.monotonic() + _SURVEY_SECONDS
                async with asyncio.timeout(_CONNECT_SECONDS if silent else self._silent_seconds):
                    await self._survey(client)
                for worker in self._silent() if silent else ():
                    self._lose(worker, f"was silent for {self._silent_seconds:g} s")
            await asyncio.sleep(_LOOK_SECONDS)

    def _silent(self) -> list[_Worker]:
        since = time.monotonic() - self._silent_seconds
        with self._lock:
            return [each for each in self._workers.values() if each.heard_at < since]

    async def _survey(self, client: Client) -> None:
        """Learn of workers that say nothing, and of Dask's own page."""
        assert client.scheduler is not None
        info = await client.scheduler.identity(n_workers=-1)
        port = info.get("services", {}).get("dashboard")
        host = _HOST.fullmatch(str(info["address"]))
        with self._lock:
            self._unheard = {str(each): _SILENT for each in info["workers"] if each not in self._workers}
            self._dashboard = None
            if host is not None and isinstance(port, int):
                self._dashboard = f"http://{host[1]}:{port}/status"

    def _hear(self, client: Client, event: tuple[float, Mapping[str, Any]]) -> None:
        """Note what a worker says of itself and of its batches, but nothing that comes late."""
        try:
            if client is self._client:
                self._note(event[1])
        except (KeyError, TypeError, AttributeError, ValueError) as fault:
            logger.debug("a worker of the cluster says what is not understood: %r", fault)

    def _note(self, said: Mapping[str, Any]) -> None:
        address, incarnation = str(said["worker"]), str(said["incarnation"])
        with self._lock:
            worker = self._workers.get(address)
        if worker is not None and worker.incarnation != incarnation:
            self._lose(worker, "was started anew")
            worker = None
        if said.get("is_leaving"):
            if worker is not None:
                self._lose(worker, "leaves", is_expected=True)
            return
        why_not = self._why_not(said)
        with self._lock:
            if worker is None:
                worker = _Worker(address, incarnation, int(said["threads"]), _UNREADY)
                self._workers[address] = worker
                self._unheard.pop(address, None)
            worker.heard_at = time.monotonic()
            is_news, worker.why_not = worker.why_not != why_not, why_not
            begun, stopped, shares = said["begun"], said["stopped"], said["shares"]
            for key, batch in worker.batches.items():
                batch.hear(begun.get(key), stopped.get(key), shares.get(key, 0.0))
        if is_news and why_not is None:
            logger.info("the Dask worker %s with %d threads is ready", address, worker.threads)
        elif is_news:
            logger.warning("the Dask worker %s is left out: %s", address, why_not)
        self._wake()

    def _why_not(self, said: Mapping[str, Any]) -> str | None:
        """Return why a worker gets no batches; None if it is ready for them."""
        theirs = said["equipment"]
        unlike = [f"its {name} is {theirs.get(name)}, and here it is {own}"
                  for name, own in self._ours.items() if theirs.get(name) != own]  # fmt: skip
        return "; ".join(unlike) or said["fault"] or (None if said["is_ready"] else _UNREADY)

    def _hear_scheduler(self, event: tuple[float, object]) -> None:
        """Note that the scheduler has removed a worker."""
        said = event[1]
        if isinstance(said, dict) and said.get("action") == "remove-worker":
            with self._lock:
                worker = self._workers.get(str(said.get("worker")))
            if worker is not None:
                self._lose(worker, "is gone", is_expected=bool(said.get("expected")))

    def _lose(self, worker: _Worker, why: str, *, is_expected: bool = False) -> None:
        """Give up a worker, and what it had; an ``expected`` end is no loss of its jobs."""
        with self._lock:
            if self._workers.get(worker.address) is worker:
                del self._workers[worker.address]
            batches = list(worker.batches.values())
        said = f"the Dask worker {worker.address} {why}"
        logger.log(logging.INFO if is_expected else logging.WARNING, "%s", said)
        for batch in batches:
            batch.end(ReturnedError(said) if is_expected else SandboxCrashError(said))
        self._wake()

    def _lose_all(self, why: str) -> None:
        """Give everything back: a scheduler that is gone says nothing of what has become of it."""
        with self._lock:
            self._workers.clear()
            self._unheard.clear()
            batches = [batch for worker in self._at_work.values() for batch in list(worker.batches.values())]
        for batch in batches:
            batch.end(ReturnedError(why))
        self._wake()
