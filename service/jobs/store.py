"""The protocol of the job store, and receipts of requests that a client may send twice.

Every write of a worker checks its claim (job, worker, attempt): it returns False and changes nothing if the
claim was lost, by an expired lease or a cancellation.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from service.jobs.kernels import Way
from service.jobs.queue import Lane
from service.jobs.records import Attempt, Claim, ClaimedJobs, Job, JobPage, Outcome, SolveOutcome
from service.schemas.query.conditions import ListQuery
from service.schemas.reading.annotation import UNANNOTATED, Annotation
from service.verdicts.cache_rows import CacheRow, Examination

KEPT_SECONDS = 86400.0
"""How long an answer is given again."""

Made = TypeVar("Made")


@dataclass(frozen=True, slots=True)
class GivenKey:
    """The Idempotency-Key of a request."""

    principal: str
    """Id of the API key that sent it, empty if there are no keys: nobody can use another's keys."""
    key: str
    fingerprint: str
    """Hash of method, path, query and body: the same key with another request is a mistake."""


@dataclass(frozen=True, slots=True)
class GivenAnswer:
    """An answer as it was sent."""

    status: int
    headers: Mapping[str, str]
    body: bytes


@dataclass(frozen=True, slots=True)
class Receipt(Generic[Made]):
    """The key and the answer, which a store writes in the transaction that makes something."""

    given: GivenKey
    answer: Callable[[Made], GivenAnswer]


class KeyTakenError(Exception):
    """Another request with the same key was committed first; nothing was stored for this one."""


def fingerprint(*parts: bytes) -> str:
    """Return the fingerprint of a request by its parts."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "big") + part)
    return digest.hexdigest()


class JobStore(Protocol):
    """Jobs and their results. Instants and leases are by the database's clock."""

    def submit(
        self,
        problem: Mapping[str, object],
        digest: str,
        *,
        priority: int = 0,
        key_id: str | None = None,
        examination: Examination | None = None,
        found: Sequence[CacheRow] = (),
        receipt: Receipt[tuple[Job, ...]] | None = None,
        annotation: Annotation = UNANNOTATED,
    ) -> Job:
        """Store a job for a canonical problem document, on the account of a key.

        If a solution of the same digest is stored, the job has succeeded already,
        with that solution and ``reused``. ``examination`` names the windows of
        its curve; ``found`` is what its examination found, and is kept. With a
        receipt its answer is stored too, or :class:`~service.jobs.store.KeyTakenError` is raised and
        nothing is.
        """
        ...

    def submit_many(
        self,
        problems: Sequence[tuple[Mapping[str, object], str]],
        *,
        priority: int = 0,
        key_id: str | None = None,
        lane: Lane = Lane.SINGLE,
        examinations: Sequence[Examination | None] = (),
        found: Sequence[CacheRow] = (),
        receipt: Receipt[tuple[Job, ...]] | None = None,
        annotations: Sequence[Annotation] = (),
    ) -> tuple[Job, ...]:
        """Do the same for several problems with their digests: all of them are stored, or none.

        They wait in ``lane``. ``examinations`` has one, or None, for each of them, or is empty; so has
        ``annotations`` their labels and notes.
        """
        ...

    def get(self, job_id: str) -> Job:
        """Return a job, or raise :class:`~service.jobs.records.JobNotFoundError`."""
        ...

    def find(self, query: ListQuery) -> JobPage:
        """Return one page of the jobs that match; only the wanted columns of them, if there are any."""
        ...

    def find_of_sweep(self, sweep_id: str, query: ListQuery) -> JobPage:
        """Do the same for the jobs that compute the points of a sweep."""
        ...

    def attempts(self, job_id: str) -> tuple[Attempt, ...]:
        """Return the history of a job, oldest first."""
        ...

    def annotate(self, job_id: str, change: Callable[[Job], Annotation]) -> Job:
        """Give a job the labels and the note that ``change`` makes of its present state.

        Nothing is changed if it raises. Raises :class:`~service.jobs.records.JobNotFoundError`.
        """
        ...

    def cancel(self, job_id: str) -> Job:
        """Cancel an unfinished job at once; cancelling again changes nothing.

        Raises :class:`~service.jobs.records.JobFinishedError` if it has
        succeeded or failed, :class:`~service.jobs.records.JobNotFoundError`.
        """
        ...

    def take(
        self,
        worker: str,
        count: int,
        *,
        lease_seconds: float,
        starved: Sequence[Lane] = (),
        together: int = 1,
    ) -> ClaimedJobs:
        """Take up to ``count`` queued jobs, in the order of the queue.

        In place of one problem there may be up to ``together``. No two workers get the same job.
        """
        ...

    def heartbeat(self, claims: Sequence[Claim], *, lease_seconds: float) -> frozenset[str]:
        """Prolong the leases of claims to ``lease_seconds`` from now, by one statement.

        Return the ids of those jobs whose claims still hold.
        """
        ...

    def note_begun(self, claim: Claim) -> None:
        """Note that a child has begun with a job that is computed alone: the loss of its worker counts."""
        ...

    def note_progress(self, shares: Sequence[tuple[Claim, float]]) -> None:
        """Note how much of jobs is done, less than all: never less than before, and if claims hold."""
        ...

    def held(self, claims: Sequence[Claim]) -> frozenset[str]:
        """Return the ids of those jobs whose claims still hold; writes nothing."""
        ...

    def finish(
        self,
        claim: Claim,
        outcome: Outcome,
        *,
        then_take: int = 0,
        lease_seconds: float = 0.0,
        starved: Sequence[Lane] = (),
        together: int = 1,
    ) -> tuple[bool, ClaimedJobs]:
        """Store the result of a job, mark it finished and take ``count`` others, in one transaction.

        The points that a chunk did not compute are queued again. Returns whether
        the claim held, and the taken jobs.
        """
        ...

    def finish_problems(
        self,
        ended: Sequence[tuple[Claim, SolveOutcome]],
        *,
        then_take: int = 0,
        lease_seconds: float = 0.0,
        starved: Sequence[Lane] = (),
        together: int = 1,
    ) -> tuple[frozenset[str], ClaimedJobs]:
        """Do the same for several problems of one worker, in one transaction.

        Returns the ids of those whose claims held; the others change nothing.
        """
        ...

    def finish_failure(self, claim: Claim, error: Mapping[str, object]) -> bool:
        """Mark the job failed for good.

        A chunk is split into smaller ones, which are queued; if it is a single
        point, that point is stored as refused with the error's code.
        """
        ...

    def lose(
        self, claim: Claim, detail: str, *, max_attempts: int, retry_seconds: float, has_begun: bool = True
    ) -> bool:
        """Record that the child died: requeue the job, or fail it as ``lost_worker``.

        From the second time on it is not claimed for ``retry_seconds``, then twice as long each time. If it
        may not ``has_begun``, that is counted only if its worker had nothing else; it is computed alone from
        then on.
        """
        ...

    def give_back(self, claim: Claim, why: str = "the worker stopped", *, pause_seconds: float = 0.0) -> bool:
        """Queue the job again because its worker does not compute it; this is not counted as a loss."""
        ...

    def change_way(self, claim: Claim, way: Way, why: str, *, pause_seconds: float = 0.0) -> bool:
        """Queue a chunk again, and have all points of its sweep computed anew, on another ``way``.

        None that is there is kept: they have one provenance. Where the sweep goes that way already, what the
        chunk refuses is final from now on.
        """
        ...

    def give_back_all(self, claims: Sequence[Claim], why: str) -> None:
        """Queue several jobs again in one transaction, those whose claims still hold."""
        ...

    def reconcile(self, *, max_attempts: int, retry_seconds: float) -> tuple[str, ...]:
        """Do the same as :meth:`lose` to every job whose lease has ended; return their ids.

        Nobody knows which of them had begun.
        """
        ...
