"""How workers learn that there is a job for them.

The jobs table is the truth; a dispatcher only says which of its jobs to look
at next. What it is told, and what it hands out, belongs to the transaction of
the caller: it happens with the commit, or never.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

Transaction = TypeVar("Transaction", contravariant=True)


@dataclass(frozen=True, slots=True)
class Delivery:
    """A job that may be claimed."""

    job_id: str
    attempt: int
    """How often it was claimed before: a job is delivered once after each."""
    priority: int
    ready_at: float
    """Not claimed before, in seconds since 1970 by the database's clock."""


class Dispatcher(Protocol[Transaction]):
    """Delivers ids of jobs to workers: within the transaction that makes them claimable, and in order."""

    def dispatch(self, transaction: Transaction, deliveries: Sequence[Delivery]) -> None:
        """Deliver jobs that this transaction has queued."""
        ...

    def take(self, transaction: Transaction, count: int) -> Sequence[str] | None:
        """Return the ids of at most ``count`` delivered jobs, to be claimed in this transaction.

        None if nothing is delivered; what is need not be claimable any more.
        """
        ...

    def repair(self, transaction: Transaction) -> int:
        """Deliver anew the jobs that are due and whose delivery was lost; return their number."""
        ...
