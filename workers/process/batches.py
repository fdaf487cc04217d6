"""Claims that a pool computes by one call, one after the other; those that wait for such a call."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypedDict

from service.jobs.queue import BatchSize, Lane
from service.jobs.records import Claim, JobKind
from workers.process.pool import PoolBatch

LEAST_SIZE_AHEAD = 8
"""Least batch size with which next batches are claimed before there are free children for them."""


class TakingTerms(TypedDict):
    """The terms on which further jobs are claimed."""

    lease_seconds: float
    starved: Sequence[Lane]
    together: int


class BatchSizes:
    """Numbers of jobs: those that a worker claims at a time, and those of them that one child gets.

    ``places`` tells how many jobs are computed at a time now.
    """

    def __init__(self, size: BatchSize, places: Callable[[], int], lease_seconds: float) -> None:
        self.size = size
        self._places, self._lease_seconds = places, lease_seconds
        self._is_last = False
        """The queue had fewer jobs than were asked for, the last time."""

    def terms(self, starved: Sequence[Lane], children: int = 1, waiting: int = 0) -> TakingTerms:
        """Return the terms of taking jobs for some free children, beside those that wait already.

        Of short ones also a batch for each child is taken, which waits until one has done its own.
        """
        batches = children + (self._places() if self.size.most >= LEAST_SIZE_AHEAD else 0)
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
        if self._is_last:
            most = min(most, max(LEAST_SIZE_AHEAD, -(-number // max(1, self._places()))))
        return most


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
class PoolRun:
    """Claimed jobs that a pool computes by one call."""

    claims: tuple[Claim, ...]
    """In the order in which they are computed."""
    starved: tuple[Lane, ...]
    """Lanes whose jobs were taken out of order, since they were starved one."""
    batch: PoolBatch
    is_alone: bool
    """It has one claim, and had no other."""
    lost: set[str] = field(default_factory=set)
    """Ids of jobs whose claims do not hold any more."""
    is_noted: bool = False
    """The store knows that its child has begun."""
    noted_share: float = 0.0
    """Share of its only job that is done, as the store knows."""
    is_followed: bool = False
    """Its place has been given another call, before these results are stored."""

    @property
    def held(self) -> list[Claim]:
        """The claims that hold, as far as is known."""
        return [claim for claim in self.claims if claim.job_id not in self.lost]

    @property
    def current(self) -> Claim | None:
        """The job that is computed now, or was when the child died."""
        begun = self.batch.begun
        return self.claims[begun - 1] if 0 < begun <= len(self.claims) else None

    @property
    def is_to_be_noted(self) -> bool:
        """A child has begun with a job that is to be alone, since an earlier worker was lost with it."""
        return self.claims[0].alone and self.batch.is_taken and not self.is_noted

    @property
    def is_in_vain(self) -> bool:
        """Nobody waits for what is computed now."""
        return not self.held or ((current := self.current) is not None and current.job_id in self.lost)

    def is_slow(self, begun_by: float) -> bool:
        """Whether jobs wait behind one of a batch that has taken long."""
        return self.batch.began_at < begun_by and 0 < self.batch.begun < len(self.claims)


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
