"""Claimed jobs that no child computes at the moment: the next batch, and what is left of those before."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence

from service.jobs.records import Claim


class Waiting:
    """Claimed jobs in the order in which children get them.

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
