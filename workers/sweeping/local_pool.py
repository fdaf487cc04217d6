"""Computes a sweep in local child processes, and yields its points in the order of their index."""

import heapq
import json
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait

import numpy as np

from service.jobs.kernels import Way
from service.jobs.queue import CHUNK_SECONDS, PARTS, PILOT_POINTS, Range, cut, largest_chunk, next_size
from service.jobs.records import ChunkOutcome
from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError, result_of
from service.schemas.sweep.sweep import Sweep
from service.storage.codecs.packing import ChunkPoints, decode_points
from workers.sweeping.chunk import compute_chunk

STOP_CHECK_SECONDS = 0.1
"""How often to check whether to stop."""
WAITING_CHUNKS_PER_CHILD = 16
"""Chunks for each child that may wait for an earlier one."""
QUEUED_CHUNKS_PER_CHILD = 2
"""Submitted chunks for each child, so that no child is ever idle."""


class LocalPool:
    """Computes a sweep chunk by chunk.

    Parameters
    ----------
    document
        The sweep document, which the children read.
    way
        Of all points.
    seconds
        Time limit of one chunk. A chunk that exceeds it, or kills its child, is
        split; for a single point this is the outcome.
    """

    def __init__(
        self, sweep: Sweep, document: object, sandbox: Sandbox, *, way: Way, workers: int, seconds: float
    ) -> None:
        self.done: list[Range] = []
        """The points yielded so far."""
        self._sweep = sweep
        self._document = document
        self._sandbox = sandbox
        self._way = way
        self._workers = workers
        self._seconds = seconds
        self._most = largest_chunk(sweep.samples, len(sweep.series_columns))
        self._next = 0
        self._expected = 0
        self._point_seconds: float | None = None
        self._rests: list[tuple[int, int]] = []
        self._ready: list[tuple[int, ChunkPoints]] = []
        self._under_way: dict[Future[ChunkOutcome], Range] = {}

    @property
    def computed(self) -> int:
        """Number of computed points, including those that wait for earlier ones."""
        waiting = sum(len(points.outcomes) for _, points in self._ready)
        return waiting + sum(each.count for each in self.done)

    def points(self, should_stop: Callable[[], bool]) -> Iterator[tuple[int, ChunkPoints] | None]:
        """Yield points with the index of the first of them, and None at intervals while there are none.

        After a stop it yields all computed points, also those behind a gap, and ends.
        """
        while len(self._ready) or self._under_way or self._rests or self._next < self._sweep.points:
            if should_stop():
                yield from self._handed_out(in_order=False)
                return
            self._send()
            wait(self._under_way, timeout=STOP_CHECK_SECONDS, return_when=FIRST_COMPLETED)
            self._collect()
            yield None
            yield from self._handed_out(in_order=True)

    def missing(self) -> list[Range]:
        """Return the points that were not yielded."""
        gaps, index = list[Range](), 0
        for each in [*sorted(self.done, key=lambda done: done.first), Range(self._sweep.points, 0)]:
            if each.first > index:
                gaps.append(Range(index, each.first - index))
            index = max(index, each.first + each.count)
        return gaps

    def _handed_out(self, *, in_order: bool) -> Iterator[tuple[int, ChunkPoints]]:
        while self._ready and (self._ready[0][0] == self._expected or not in_order):
            first, points = heapq.heappop(self._ready)
            self._expected = first + len(points.outcomes)
            self.done.append(Range(first, len(points.outcomes)))
            yield first, points

    def _send(self) -> None:
        most = QUEUED_CHUNKS_PER_CHILD * self._workers
        while len(self._under_way) < most and (chunk := self._next_chunk()):
            part = {"first": chunk.first, "count": chunk.count}
            request = {"sweep": self._document, "way": self._way, **part}
            future = self._sandbox.submit(compute_chunk, json.dumps(request), seconds=self._seconds)
            self._under_way[future] = chunk

    def _next_chunk(self) -> Range | None:
        """Return the next points to compute; returned ones come first."""
        if self._rests:
            return Range(*heapq.heappop(self._rests))
        left = self._sweep.points - self._next
        if not left or len(self._ready) > WAITING_CHUNKS_PER_CHILD * self._workers:
            return None
        if self._point_seconds is None:
            size = min(PILOT_POINTS, self._most, left)
        else:
            size = next_size(self._point_seconds, left, self._most)
        chunk = Range(self._next, size)
        self._next += size
        return chunk

    def _collect(self) -> None:
        for future in [future for future in self._under_way if future.done()]:
            chunk = self._under_way.pop(future)
            try:
                outcome = result_of(future)
            except SandboxTimeoutError:
                self._give_up(chunk, "time_limit")
            except SandboxMemoryError:
                self._give_up(chunk, "memory_limit")
            except SandboxCrashError:
                self._give_up(chunk, "lost_worker")
            else:
                self._point_seconds = max(outcome.seconds / outcome.count, 1e-9 * CHUNK_SECONDS)
                heapq.heappush(self._ready, (chunk.first, decode_points(outcome.data)))
                if outcome.count < chunk.count:
                    rest = (chunk.first + outcome.count, chunk.count - outcome.count)
                    heapq.heappush(self._rests, rest)

    def _give_up(self, chunk: Range, code: str) -> None:
        """Split a failed chunk; for a single point the reason is its outcome."""
        if chunk.count > 1:
            for part in cut(chunk, PARTS):
                heapq.heappush(self._rests, (part.first, part.count))
            return
        numbers = {name: np.full(1, np.nan) for name in self._sweep.keep}
        shape = (1, self._sweep.samples)
        series = {name: np.full(shape, np.nan) for name in self._sweep.series_columns}
        heapq.heappush(self._ready, (chunk.first, ChunkPoints([code], numbers, series)))
