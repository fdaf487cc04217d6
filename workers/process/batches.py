"""Several short jobs that one call of a child computes, one after the other; what waits for such a call.

What a call costs around its computation (a message to the child and one back, three threads of the pool, and
a commit) is shared by all of them. Each job keeps limits of its own: parent and child share a file of two
bytes, by which the parent knows which job is being computed, and takes back those that are not.
"""

import contextlib
import logging
import os
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any, TypedDict  # Any: an outcome, or those of a batch

from service.jobs.queue import BatchSize, Lane
from service.jobs.records import Claim, JobKind, Outcome
from service.logs import about

logger = logging.getLogger(__name__)


Call = tuple[Mapping[str, object], Sequence[object]]
"""Fields for the log, and the arguments of the computation."""

_BEGUN, _STOP = 0, 1
"""Places of the two bytes: the number of jobs that were begun, and whether no other one may be."""
LEAST_SIZE_AHEAD = 8
"""Least batch size with which next batches are claimed before there are free children for them."""


class Ledger:
    """The parent's side of the file that tells how far a child is."""

    def __init__(self) -> None:
        descriptor, self.path = tempfile.mkstemp(prefix="polhode-batch-")
        self._descriptor = descriptor
        os.pwrite(descriptor, bytes(2), 0)

    def begun(self) -> int:
        """Return how many jobs the child has begun: the last of them is being computed, or is done."""
        return os.pread(self._descriptor, 1, _BEGUN)[0]

    def stop(self) -> int:
        """Have the child begin no other job; return how many it has begun at most."""
        # In this order, and the child's writes in the other: one of the two sees what the other has written.
        os.pwrite(self._descriptor, b"\1", _STOP)
        return self.begun()

    def close(self) -> None:
        """Remove the file."""
        os.close(self._descriptor)
        with contextlib.suppress(OSError):
            os.unlink(self.path)  # noqa: PTH108  # a path object for each batch costs more than this


def compute_in_turn(
    path: str, seconds: float, compute: Callable[..., Outcome], calls: Sequence[Call]
) -> list[Outcome | None]:
    """Compute jobs until all are done, ``seconds`` are over, or the parent says so; runs in the child.

    The answer has the outcomes of the first jobs: None for one that raised, which is computed again alone,
    where its fault is told.
    """
    outcomes: list[Outcome | None] = []
    end = time.monotonic() + seconds
    descriptor = os.open(path, os.O_RDWR)
    try:
        for number, (fields, arguments) in enumerate(calls, start=1):
            if outcomes and time.monotonic() > end:
                break
            os.pwrite(descriptor, bytes([number]), _BEGUN)
            if os.pread(descriptor, 1, _STOP) != b"\0":
                break
            with about(**fields):
                try:
                    outcomes.append(compute(*arguments))
                except Exception as fault:
                    logger.debug("not computed in a batch: %r", fault)
                    outcomes.append(None)
    finally:
        os.close(descriptor)
    return outcomes


class TakingTerms(TypedDict):
    """The terms on which further jobs are claimed."""

    lease_seconds: float
    starved: Sequence[Lane]
    together: int


class BatchSizes:
    """Numbers of jobs: those that a worker claims at a time, and those of them that one child gets."""

    def __init__(self, size: BatchSize, slots: int, lease_seconds: float) -> None:
        self.size = size
        self._slots, self._lease_seconds = slots, lease_seconds
        self._is_last = False
        """The queue had fewer jobs than were asked for, the last time."""

    def terms(self, starved: Sequence[Lane], children: int = 1, waiting: int = 0) -> TakingTerms:
        """Return the terms of taking jobs for some free children, beside those that wait already.

        Of short ones also a batch for each child is taken, which waits until one has done its own.
        """
        batches = children + (self._slots if self.size.most >= LEAST_SIZE_AHEAD else 0)
        return {
            "lease_seconds": self._lease_seconds,
            "starved": starved,
            "together": max(1, self.size.most * batches // children - waiting),
        }

    def note(self, claimed: int, terms: TakingTerms) -> None:
        """Note how many problems were taken on some terms."""
        self._is_last = claimed < terms["together"]

    def share(self, number: int) -> int:
        """Return how many of so many problems a child gets: the last ones of a queue are shared out."""
        most = self.size.most
        return min(most, max(LEAST_SIZE_AHEAD, -(-number // self._slots))) if self._is_last else most


class Waiting:
    """Claimed jobs that no child computes at the moment, in the order in which children get them.

    Those that made trouble in a batch are computed alone.
    """

    def __init__(self) -> None:
        self._claims: deque[Claim] = deque()
        self._suspects: set[str] = set()
        """Ids of jobs that made trouble."""

    def __len__(self) -> int:
        return len(self._claims)

    def __iter__(self) -> Iterator[Claim]:
        return iter(self._claims)

    def add(self, claims: Sequence[Claim]) -> None:
        """Add jobs, behind the others."""
        self._claims.extend(claims)

    def suspect(self, claims: Sequence[Claim]) -> None:
        """Note that each of these is to be computed alone."""
        self._suspects |= {claim.job_id for claim in claims}

    def forget(self, job_id: str) -> None:
        """Forget that a job made trouble."""
        self._suspects.discard(job_id)

    def next(self, most: int) -> tuple[Claim, ...]:
        """Remove and return what the next child computes: one that made trouble alone, or others together."""
        first = self._claims.popleft()
        claims = [first]
        if first.job_id not in self._suspects:
            while self._claims and len(claims) < most and self._claims[0].job_id not in self._suspects:
                claims.append(self._claims.popleft())
        return tuple(claims)

    def keep(self, holds: Callable[[Claim], bool]) -> None:
        """Keep those for which this is true."""
        self._claims = deque([claim for claim in self._claims if holds(claim)])

    def unsuspected(self) -> list[Claim]:
        """Return those that made no trouble."""
        return [claim for claim in self._claims if claim.job_id not in self._suspects]


@dataclass(slots=True, eq=False)
class ChildRun:
    """Claimed jobs that one call of a child computes."""

    claims: tuple[Claim, ...]
    """In the order in which they are computed."""
    starved: tuple[Lane, ...]
    """Lanes whose jobs were taken out of order, since they were starved one."""
    future: Future[Any]
    ledger: Ledger | None
    """The ledger of a batch; None for a job that is alone."""
    began_at: float
    started_by: float
    """Latest time for a child to take it."""
    ended_at: float | None = None
    lost: set[str] = field(default_factory=set)
    """Ids of jobs whose claims do not hold any more."""
    is_noted: bool = False
    """The store knows that its child has begun."""
    is_followed: bool = False
    """Its child has been given another call, before these results are stored."""

    @property
    def held(self) -> list[Claim]:
        """The claims that hold, as far as is known."""
        return [claim for claim in self.claims if claim.job_id not in self.lost]

    @property
    def begun(self) -> int:
        """Number of jobs that were begun: one for a job that is alone, since nothing else could be."""
        return 1 if self.ledger is None else self.ledger.begun()

    @property
    def current(self) -> Claim | None:
        """The job that is computed now, or was when the child died."""
        return self.claims[self.begun - 1] if 0 < self.begun <= len(self.claims) else None

    @property
    def is_untaken(self) -> bool:
        """No child has taken the call."""
        return not self.future.running() and not self.future.done()

    @property
    def is_to_be_noted(self) -> bool:
        """A child has begun with a job that is to be alone, since an earlier worker was lost with it."""
        return self.claims[0].alone and self.future.running() and not self.is_noted

    @property
    def is_in_vain(self) -> bool:
        """Nobody waits for what is computed now."""
        return not self.held or (self.current is not None and self.current.job_id in self.lost)

    def is_slow(self, begun_by: float) -> bool:
        """Whether jobs wait behind one of a batch that has taken long."""
        return self.ledger is not None and self.began_at < begun_by and 0 < self.begun < len(self.claims)

    def close(self) -> None:
        """Remove the file of a batch."""
        if self.ledger is not None:
            self.ledger.close()


def shared_out(claims: Sequence[Claim], children: int) -> Iterator[tuple[Claim, ...]]:
    """Return what each child gets: a chunk or an atlas has one to itself, problems share the rest.

    A problem that is to be computed alone has one to itself too.
    """
    problems, others = may_share(claims)
    yield from ((claim,) for claim in others)
    left = max(1, children - len(others))
    yield from (tuple(problems[start::left]) for start in range(min(left, len(problems))))


def may_share(claims: Sequence[Claim]) -> tuple[list[Claim], list[Claim]]:
    """Return the problems that one call may compute with others, and all else."""
    shares = [claim.kind is JobKind.SOLVE and not claim.alone for claim in claims]
    problems = [claim for claim, together in zip(claims, shares, strict=True) if together]
    return problems, [claim for claim, together in zip(claims, shares, strict=True) if not together]
