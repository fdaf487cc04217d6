"""Numbers of jobs: how many a worker claims at a time, and how many of them one child gets."""

from collections.abc import Sequence

from service.jobs.queue import BatchSize, Lane
from workers.process.results import TakingTerms

AHEAD = 8
"""Least batch size with which next batches are claimed before there are places for them."""


class Portions:
    """Counts the jobs of a worker with some children."""

    def __init__(self, size: BatchSize, slots: int, lease_seconds: float) -> None:
        self.size = size
        self._slots, self._lease_seconds = slots, lease_seconds
        self._is_last = False
        """The queue had fewer jobs than were asked for, the last time."""

    def terms(self, owed: Sequence[Lane], places: int = 1, waiting: int = 0) -> TakingTerms:
        """Return the terms of taking jobs for some places, beside those that wait already.

        Of short ones also a batch for each child is taken, which waits until one has done its own.
        """
        batches = places + (self._slots if self.size.most >= AHEAD else 0)
        return {
            "lease_seconds": self._lease_seconds,
            "owed": owed,
            "together": max(1, self.size.most * batches // places - waiting),
        }

    def note(self, taken: int, asked: TakingTerms) -> None:
        """Note how many problems were taken on some terms."""
        self._is_last = taken < asked["together"]

    def share(self, number: int) -> int:
        """Return how many of so many problems a child gets: the last ones of a queue are shared out."""
        most = self.size.most
        return min(most, max(AHEAD, -(-number // self._slots))) if self._is_last else most
