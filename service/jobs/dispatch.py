"""The protocol of dispatchers, which tell workers which jobs to claim.

The jobs table is the source of truth; a dispatcher only says which of its jobs to
look at next. It delivers and takes jobs within the caller's transaction: both take
effect with the commit, or not at all.
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
    """How often it was claimed before; each attempt has its own delivery."""
    priority: int
    ready_at: float
    """Not claimed before, in seconds since 1970 by the database's clock."""


class Dispatcher(Protocol[Transaction]):
    """Delivers ids of jobs to workers in order, within the transaction that makes them claimable.

    The order is: first one job of each lane that is owed one; then by larger
    priority, earlier lane, smaller turn, older job of a key.
    """

    def dispatch(self, transaction: Transaction, deliveries: Sequence[Delivery]) -> None:
        """Deliver jobs that this transaction has queued."""
        ...

    def take(
        self, transaction: Transaction, count: int, owed: Sequence[Lane] = (), together: int = 1
    ) -> Sequence[str] | None:
        """Return the ids of at most ``count`` jobs, to be claimed in this transaction, in that order.

        Where these are problems, ``together`` of them may take the place of one: the next ones of the same
        priority (and of the same lane, if that is owed one). None if there are none.
        """
        ...

    def repair(self, transaction: Transaction) -> int:
        """Deliver again the due jobs whose delivery was lost; return their number."""
        ...
