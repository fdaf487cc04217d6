"""What the service and the workers need from a store of jobs.

The store is the source of truth; an engine only delivers ids. Every write of a
worker is fenced by its claim (job, worker, attempt): it returns False and
changes nothing if the claim was lost, whether by an expired lease or by a
cancellation.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol

from service.jobs.job import Attempt, Claim, Job, JobPage
from service.jobs.states import JobState


class JobStore(Protocol):
    """Jobs and their results. Instants and leases are by the database's clock."""

    def submit(self, problem: Mapping[str, object], digest: str) -> Job:
        """Store a job for a canonical problem document.

        If a solution of the same digest is stored, the job is born succeeded
        with that solution and ``reused``.
        """
        ...

    def get(self, job_id: str) -> Job:
        """Return a job, or raise :class:`~service.jobs.errors.JobNotFoundError`."""
        ...

    def list_jobs(self, *, state: JobState | None = None, limit: int = 50, offset: int = 0) -> JobPage:
        """Return jobs, newest first."""
        ...

    def attempts(self, job_id: str) -> tuple[Attempt, ...]:
        """Return the history of a job, oldest first."""
        ...

    def cancel(self, job_id: str) -> Job:
        """Cancel a live job at once; cancelling again changes nothing.

        Raises :class:`~service.jobs.errors.JobFinishedError` if it has
        succeeded or failed, :class:`~service.jobs.errors.JobNotFoundError`.
        """
        ...

    def claim(self, worker: str, *, lease_seconds: float) -> Claim | None:
        """Take the oldest queued job, or None. No two workers get the same one."""
        ...

    def heartbeat(self, claim: Claim, *, lease_seconds: float) -> bool:
        """Prolong the lease to ``lease_seconds`` from now."""
        ...

    def held(self, claims: Sequence[Claim]) -> frozenset[str]:
        """Return the ids of those jobs whose claims still hold; writes nothing."""
        ...

    def reuse(self, claim: Claim) -> bool:
        """Finish with an equal problem's solution, if one has been stored meanwhile."""
        ...

    def finish_success(
        self, claim: Claim, summary: Mapping[str, object], *, dense: bytes, samples: bytes
    ) -> bool:
        """Store the solution and mark the job succeeded, in one transaction."""
        ...

    def finish_failure(self, claim: Claim, error: Mapping[str, object]) -> bool:
        """Mark the job failed for good."""
        ...

    def lose(self, claim: Claim, detail: str, *, max_attempts: int) -> bool:
        """Record that the child died: queue the job again, or give it up as ``lost_worker``."""
        ...

    def give_back(self, claim: Claim) -> bool:
        """Queue the job again because its worker stops; this is not counted as a loss."""
        ...

    def reconcile(self, *, max_attempts: int) -> tuple[str, ...]:
        """Do the same as :meth:`lose` to every job whose lease has ended; return their ids."""
        ...
