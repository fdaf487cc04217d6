"""Runs of a child: one job, or a batch of problems; and how claimed jobs are shared out."""

from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any  # an outcome, or those of a batch

from service.jobs.queue import Lane
from service.jobs.records import Claim, JobKind
from workers.process.batches import Ledger


@dataclass(slots=True, eq=False)
class ChildRun:
    """Claimed jobs that one call of a child computes."""

    claims: tuple[Claim, ...]
    """In the order in which they are computed."""
    owed: tuple[Lane, ...]
    """Lanes whose jobs were taken out of order, since they were owed one."""
    future: Future[Any]
    ledger: Ledger | None
    """The ledger of a batch; None for a job that is alone."""
    began_at: float
    started_by: float
    """Latest time for a child to take it."""
    ended_at: float | None = None
    lost: set[str] = field(default_factory=set)
    """Ids of jobs whose claims do not hold any more."""
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


def shared_out(claims: Sequence[Claim], places: int) -> Iterator[tuple[Claim, ...]]:
    """Return what each place gets: a chunk or an atlas has one to itself, problems share the rest.

    A problem that is to be computed alone has one to itself too.
    """
    problems, others = may_share(claims)
    yield from ((claim,) for claim in others)
    left = max(1, places - len(others))
    yield from (tuple(problems[place::left]) for place in range(min(left, len(problems))))


def may_share(claims: Sequence[Claim]) -> tuple[list[Claim], list[Claim]]:
    """Return the problems that one call may compute with others, and all else."""
    shares = [claim.kind is JobKind.SOLVE and not claim.alone for claim in claims]
    problems = [claim for claim, together in zip(claims, shares, strict=True) if together]
    return problems, [claim for claim, together in zip(claims, shares, strict=True) if not together]
