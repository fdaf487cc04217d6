"""How workers learn that there is a job for them.

The jobs table is the truth; a dispatcher only says which of its jobs to look
at next. What it is told, and what it hands out, belongs to the transaction of
the caller: it happens with the commit, or never.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from service.jobs.lanes import Lane

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
    """Delivers ids of jobs to workers: within the transaction that makes them claimable, and in order.

    The order is: one job of each lane that is owed one; then the larger
    priority, the earlier lane, the smaller turn, the older job of a key.
    """

    def dispatch(self, transaction: Transaction, deliveries: Sequence[Delivery]) -> None:
        """Deliver jobs that this transaction has queued."""
        ...

    def take(self, transaction: Transaction, count: int, owed: Sequence[Lane] = ()) -> Sequence[str] | None:
        """Return the ids of at most ``count`` jobs, to be claimed in this transaction, in that order.

        None if there are none.
        """
        ...

    def repair(self, transaction: Transaction) -> int:
        """Deliver anew the jobs that are due and whose delivery was lost; return their number."""
        ...
