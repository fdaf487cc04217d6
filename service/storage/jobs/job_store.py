"""The store of jobs in SQL; one method is one transaction.

Every write of a worker checks its claim (job, worker, attempt): it returns False and changes nothing if the
claim was lost, by an expired lease or a cancellation.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

from sqlalchemy import Connection, bindparam, select, tuple_, update
from sqlalchemy.orm import Session

from service.jobs.kernels import Way
from service.jobs.queue import Lane
from service.jobs.records import (
    SUBMITTED,
    Attempt,
    AttemptOutcome,
    ChunkOutcome,
    Claim,
    ClaimedJobs,
    Job,
    JobFinishedError,
    JobKind,
    JobNotFoundError,
    JobPage,
    JobResult,
    JobState,
    Outcome,
    Refused,
    Solved,
    SolveOutcome,
)
from service.schemas.query.terms import ListQuery
from service.schemas.reading.documents import UNANNOTATED, Annotation, Part
from service.storage.annotations import rewrite
from service.storage.database.database import Database
from service.storage.database.rows import database_now, is_id
from service.storage.examinations import CacheRow, Examination, store_rows
from service.storage.jobs import chunks
from service.storage.jobs.claiming import take_jobs
from service.storage.jobs.finishing import store_and_charge, store_result
from service.storage.jobs.queue import announce, insert_jobs
from service.storage.jobs.rows import (
    BEGUN,
    end_attempt,
    fence,
    history,
    job_of,
    jobs_of,
    lose,
    move,
    page_of_jobs,
)
from service.storage.keys import Receipt, write_key
from service.storage.searching.sources import OF_JOB_ROWS, chunks_of
from service.storage.tables.base import DatabaseNow, table_of
from service.storage.tables.jobs import AttemptRow, JobRow

_JOBS = table_of(JobRow)
_HOLDS = (
    tuple_(_JOBS.c.id, _JOBS.c.owner, _JOBS.c.attempt).in_(bindparam("claimed", expanding=True)),
    _JOBS.c.state == JobState.RUNNING.value,
)
_HELD = select(_JOBS.c.id).where(*_HOLDS)
_RENEWAL = update(JobRow).where(*_HOLDS).returning(JobRow.id).execution_options(synchronize_session=False)


def _claimed(claims: Sequence[Claim]) -> dict[str, object]:
    """Return the parameters of a statement about claims."""
    return {"claimed": [(claim.job_id, claim.worker, claim.attempt) for claim in claims]}


class JobStore:
    """Jobs and their results, in SQLite or Postgres. Instants and leases are by the database's clock."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def submit(
        self,
        problem: Part,
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
        receipt its answer is stored too, or :class:`.KeyTakenError` is raised and
        nothing is.
        """
        (job,) = self.submit_many(
            [(problem, digest)],
            priority=priority,
            key_id=key_id,
            examinations=[examination],
            found=found,
            receipt=receipt,
            annotations=[annotation],
        )
        return job

    def submit_many(
        self,
        problems: Sequence[tuple[Part, str]],
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
        with self._database.write() as session:
            store_rows(session.connection(), found)
            rows = insert_jobs(
                session,
                problems,
                lane=lane,
                priority=priority,
                key_id=key_id,
                examinations=examinations,
                annotations=annotations,
            )
            self._announce(session, any(row.state == JobState.QUEUED.value for row in rows))
            jobs = tuple(map(job_of, rows, annotations or [UNANNOTATED] * len(rows)))
            if receipt is not None:
                write_key(session.connection(), receipt.given, receipt.answer(jobs))
            return jobs

    def get(self, job_id: str) -> Job:
        """Return a job, or raise :class:`.JobNotFoundError`."""
        with self._database.read() as session:
            return _job(session, _row(session, job_id))

    def find(self, query: ListQuery) -> JobPage:
        """Return one page of the jobs that match; only the wanted columns of them, if there are any."""
        return page_of_jobs(self._database, OF_JOB_ROWS, query)

    def find_of_sweep(self, sweep_id: str, query: ListQuery) -> JobPage:
        """Do the same for the jobs that compute the points of a sweep."""
        return page_of_jobs(self._database, chunks_of(sweep_id), query)

    def attempts(self, job_id: str) -> tuple[Attempt, ...]:
        """Return the history of a job, oldest first."""
        with self._database.read() as session:
            return history(session, _row(session, job_id).id)

    def annotate(self, job_id: str, change: Callable[[Job], Annotation]) -> Job:
        """Give a job the labels and the note that ``change`` makes of its present state.

        Nothing is changed if it raises. Raises :class:`.JobNotFoundError`.
        """
        with self._database.write() as session:
            row = _row(session, job_id, is_locked=True)
            job = _job(session, row)
            annotation = change(job)
            rewrite(session, row, annotation, job.annotation.labels)
            return replace(job, annotation=annotation)

    def cancel(self, job_id: str) -> Job:
        """Cancel an unfinished job at once; cancelling again changes nothing.

        Raises :class:`.JobFinishedError` if it has
        succeeded or failed, :class:`.JobNotFoundError`.
        """
        with self._database.write() as session:
            row = _row(session, job_id)
            if row.state == JobState.CANCELLED.value:
                return _job(session, row)
            if not move(session, JobState.CANCELLED, JobRow.id == row.id):
                raise JobFinishedError(row.id, JobState(row.state))
            end_attempt(session, row.id, row.attempt, AttemptOutcome.CANCELLED)
            session.refresh(row)
            return _job(session, row)

    def claim(self, worker: str, *, lease_seconds: float) -> Claim | None:
        """Take the first job of the queue that has to be computed."""
        while (taken := self.take(worker, 1, lease_seconds=lease_seconds)) != ClaimedJobs():
            for claim in taken.claims:
                return claim
        return None

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
        while True:
            with self._database.write_rows() as connection:
                taken = take_jobs(connection, worker, count, lease_seconds, starved, together)
            if taken is None:
                return ClaimedJobs()
            if taken != ClaimedJobs():
                return taken

    def heartbeat(self, claims: Sequence[Claim], *, lease_seconds: float) -> frozenset[str]:
        """Prolong the leases of claims to ``lease_seconds`` from now, by one statement.

        Return the ids of those jobs whose claims still hold.
        """
        if not claims:
            return frozenset()
        # A lease is nothing that clients see: nobody is told of a change.
        values = {"lease_until": DatabaseNow() + lease_seconds, "changed_at": JobRow.changed_at}
        with self._database.write() as session:
            return frozenset(session.scalars(_RENEWAL.values(**values), _claimed(claims)))

    def note_begun(self, claim: Claim) -> None:
        """Note that a child has begun with a job that is computed alone: the loss of its worker counts."""
        attempt = AttemptRow.job_id == claim.job_id, AttemptRow.number == claim.attempt
        with self._database.write() as session:
            session.execute(
                update(AttemptRow).where(*attempt, AttemptRow.ended_at.is_(None)).values(detail=BEGUN)
            )

    def note_progress(self, shares: Sequence[tuple[Claim, float]]) -> None:
        """Note how much of jobs is done, less than all: never less than before, and if claims hold."""
        with self._database.write() as session:
            for claim, share in shares:
                session.execute(
                    update(JobRow).where(*fence(claim), JobRow.progress < share).values(progress=share)
                )

    def held(self, claims: Sequence[Claim]) -> frozenset[str]:
        """Return the ids of those jobs whose claims still hold; writes nothing."""
        if not claims:
            return frozenset()
        with self._database.read() as session:
            return frozenset(session.scalars(_HELD, _claimed(claims)))

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

        def take(connection: Connection) -> ClaimedJobs:
            taken = take_jobs(connection, claim.worker, then_take, lease_seconds, starved, together)
            return taken or ClaimedJobs()

        if isinstance(outcome, ChunkOutcome):
            with self._database.write() as session:
                return self._finish_chunk(session, claim, outcome), take(session.connection())
        if isinstance(outcome, Refused):
            with self._database.write() as session:
                return self._fail(session, claim, outcome.error), take(session.connection())
        if isinstance(outcome, JobResult):
            with self._database.write() as session:
                return store_result(session, claim, outcome), take(session.connection())
        with self._database.write_rows() as connection:
            return bool(store_and_charge(connection, [(claim, outcome)])), take(connection)

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
        worker = ended[0][0].worker
        solved = [(claim, outcome) for claim, outcome in ended if isinstance(outcome, Solved)]
        refused = [(claim, outcome) for claim, outcome in ended if isinstance(outcome, Refused)]
        with self._database.write() as session:
            held = {claim.job_id for claim, outcome in refused if self._fail(session, claim, outcome.error)}
            connection = session.connection()
            held |= store_and_charge(connection, solved)
            taken = take_jobs(connection, worker, then_take, lease_seconds, starved, together)
            return frozenset(held), taken or ClaimedJobs()

    def finish_failure(self, claim: Claim, error: Part) -> bool:
        """Mark the job failed for good.

        A chunk is split into smaller ones, which are queued; if it is a single
        point, that point is stored as refused with the error's code.
        """
        with self._database.write() as session:
            return self._fail(session, claim, error)

    def lose(
        self,
        claim: Claim,
        detail: str,
        *,
        max_attempts: int,
        retry_seconds: float = 0.0,
        has_begun: bool = True,
    ) -> bool:
        """Record that the child died: requeue the job, or fail it as ``lost_worker``.

        From the second time on it is not claimed for ``retry_seconds``, then twice as long each time. If it
        may not ``has_begun``, that is counted only if its worker had nothing else; it is computed alone from
        then on.
        """
        with self._database.write() as session:
            sweep = chunks.hold(session, claim.sweep_id)
            attempt = claim.job_id, claim.attempt
            terms = detail, max_attempts, retry_seconds
            if not lose(session, fence(claim), attempt, *terms, has_begun=has_begun):
                return False
            chunks.replace_failed(session, sweep, claim.job_id)
            self._announce(session)
            return True

    def give_back(self, claim: Claim, why: str = "the worker stopped", *, pause_seconds: float = 0.0) -> bool:
        """Queue the job again because its worker does not compute it; this is not counted as a loss."""
        with self._database.write() as session:
            return self._give_back(session, claim, why, pause_seconds)

    def change_way(self, claim: Claim, way: Way, why: str, *, pause_seconds: float = 0.0) -> bool:
        """Queue a chunk again, and have all points of its sweep computed anew, on another ``way``.

        None that is there is kept: they have one provenance. Where the sweep goes that way already, what the
        chunk refuses is final from now on.
        """
        with self._database.write() as session:
            sweep = chunks.hold(session, claim.sweep_id)
            if sweep is None:
                return False
            begins_again = sweep.way != way
            problem = (
                chunks.first_problem(sweep, claim) if begins_again else {**claim.problem, "waits": False}
            )
            changed = self._give_back(session, claim, why, pause_seconds, problem=problem)
            if changed and begins_again:
                chunks.begin_again(session, sweep, claim, way)
            return changed

    def give_back_all(self, claims: Sequence[Claim], why: str) -> None:
        """Queue several jobs again in one transaction, those whose claims still hold."""
        if claims:
            with self._database.write() as session:
                for claim in claims:
                    self._give_back(session, claim, why)

    def reconcile(self, *, max_attempts: int, retry_seconds: float = 0.0) -> tuple[str, ...]:
        """Do the same as :meth:`lose` to every job whose lease has ended; return their ids.

        Nobody knows which of them had begun.
        """
        expired = JobRow.state == JobState.RUNNING.value, JobRow.lease_until < DatabaseNow()
        # Look first without the write lock: almost always nothing is found.
        with self._database.read() as session:
            columns = JobRow.id, JobRow.attempt, JobRow.sweep_id
            found = session.execute(select(*columns).where(*expired)).all()
        changed: list[str] = []
        for job_id, attempt, sweep_id in found:
            # One transaction for each; the conditions are checked again inside it.
            still = (JobRow.id == job_id, JobRow.attempt == attempt, *expired)
            with self._database.write() as session:
                sweep = chunks.hold(session, sweep_id)
                terms = "the lease ended without a heartbeat", max_attempts, retry_seconds
                if lose(session, still, (job_id, attempt), *terms, has_begun=False):
                    chunks.replace_failed(session, sweep, job_id)
                    self._announce(session)
                    changed.append(job_id)
        return tuple(changed)

    def _finish_chunk(self, session: Session, claim: Claim, outcome: ChunkOutcome) -> bool:
        queued = chunks.finish(session, claim, outcome)
        self._announce(session, bool(queued))
        return queued is not None

    def _fail(self, session: Session, claim: Claim, error: Part) -> bool:
        sweep = chunks.hold(session, claim.sweep_id)
        if not move(session, JobState.FAILED, *fence(claim), error=dict(error)):
            return False
        code = str(error.get("code", ""))
        end_attempt(session, claim.job_id, claim.attempt, AttemptOutcome.FAILED, code)
        self._announce(session, bool(chunks.replace_failed(session, sweep, claim.job_id)))
        return True

    def _give_back(
        self, session: Session, claim: Claim, why: str, pause_seconds: float = 0.0, **values: object
    ) -> bool:
        if pause_seconds:
            values["ready_at"] = database_now(session) + pause_seconds
        if not move(session, JobState.QUEUED, *fence(claim), **values):
            return False
        end_attempt(session, claim.job_id, claim.attempt, AttemptOutcome.RETURNED, why)
        self._announce(session)
        return True

    def _announce(self, session: Session, has_queued: bool = True) -> None:
        session.flush()  # for a claim of the same transaction
        if has_queued:
            announce(self._database, session.connection())


def _job(session: Session, row: JobRow) -> Job:
    (job,) = jobs_of(session, [row])
    return job


def _row(session: Session, job_id: str, *, is_locked: bool = False) -> JobRow:
    row = session.get(JobRow, job_id, with_for_update=is_locked) if is_id(job_id) else None
    # A chunk is cancelled only with its sweep: alone, it would leave a gap.
    if row is None or JobKind(row.kind) not in SUBMITTED:
        raise JobNotFoundError(job_id)
    return row
