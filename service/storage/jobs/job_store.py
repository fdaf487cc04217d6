"""The store of jobs in SQL; one method is one transaction."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from sqlalchemy import Connection, bindparam, select, update
from sqlalchemy.orm import Session

from service.jobs.kernels import Way
from service.jobs.queue import Lane
from service.jobs.records import (
    SUBMITTED,
    Attempt,
    AttemptOutcome,
    ChunkOutcome,
    Claim,
    Drawn,
    Job,
    JobFinishedError,
    JobKind,
    JobNotFoundError,
    JobPage,
    JobState,
    Outcome,
    Refused,
    Solved,
    SolveOutcome,
    Taken,
)
from service.jobs.store import Dispatcher, Receipt
from service.schemas.query.conditions import ListQuery
from service.schemas.reading.marks import UNMARKED, Marks
from service.storage.database.database import Database
from service.storage.database.rows import database_now, is_id
from service.storage.examinations import store_rows
from service.storage.jobs import chunks
from service.storage.jobs.claiming import take_jobs
from service.storage.jobs.finishing import store_and_charge, store_and_charge_all, store_atlas
from service.storage.jobs.moves import end_attempt, fence, history, lose, move
from service.storage.jobs.records import delivery_of, job_of, page_of_jobs
from service.storage.jobs.submitting import insert_jobs
from service.storage.jobs.table_dispatcher import TableDispatcher
from service.storage.keys.idempotency_store import write_key
from service.storage.marks import marks_of, rewrite
from service.storage.searching.sources import OF_JOB_ROWS, chunks_of
from service.storage.tables.base import DatabaseNow, table_of
from service.storage.tables.jobs import JobRow
from service.storage.tables.sweeps import SweepRow
from service.verdicts.cache_rows import Entry, Examination

_JOBS = table_of(JobRow)
_HOLDERS = select(_JOBS.c.id, _JOBS.c.owner, _JOBS.c.attempt).where(
    _JOBS.c.id.in_(bindparam("ids", expanding=True)), _JOBS.c.state == JobState.RUNNING.value
)


class SqlJobStore:
    """The :class:`~service.jobs.store.JobStore` in SQLite or Postgres."""

    def __init__(self, database: Database, dispatcher: Dispatcher[Connection] | None = None) -> None:
        """Without a dispatcher, workers poll the table."""
        self._database = database
        self._dispatcher = TableDispatcher() if dispatcher is None else dispatcher

    def submit(
        self,
        problem: Mapping[str, object],
        digest: str,
        *,
        priority: int = 0,
        key_id: str | None = None,
        examination: Examination | None = None,
        found: Sequence[Entry] = (),
        receipt: Receipt[tuple[Job, ...]] | None = None,
        marks: Marks = UNMARKED,
    ) -> Job:
        """Store a job; it has succeeded already if an equal problem has been solved."""
        (job,) = self.submit_many(
            [(problem, digest)],
            priority=priority,
            key_id=key_id,
            examinations=[examination],
            found=found,
            receipt=receipt,
            marks=[marks],
        )
        return job

    def submit_many(
        self,
        problems: Sequence[tuple[Mapping[str, object], str]],
        *,
        priority: int = 0,
        key_id: str | None = None,
        lane: Lane = Lane.SINGLE,
        examinations: Sequence[Examination | None] = (),
        found: Sequence[Entry] = (),
        receipt: Receipt[tuple[Job, ...]] | None = None,
        marks: Sequence[Marks] = (),
    ) -> tuple[Job, ...]:
        """Store a job for each problem and its digest, all of them or none, and the answer of a receipt."""
        with self._database.write() as session:
            store_rows(session.connection(), found)
            rows = insert_jobs(
                session,
                problems,
                lane=lane,
                priority=priority,
                key_id=key_id,
                examinations=examinations,
                marks=marks,
            )
            self._deliver(session, [row for row in rows if row.state == JobState.QUEUED.value])
            jobs = tuple(map(job_of, rows, marks or [UNMARKED] * len(rows)))
            if receipt is not None:
                write_key(session.connection(), receipt.given, receipt.answer(jobs))
            return jobs

    def get(self, job_id: str) -> Job:
        """Return a job, or raise :class:`JobNotFoundError`."""
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

    def mark(self, job_id: str, change: Callable[[Job], Marks]) -> Job:
        """Give a job the labels and the note that ``change`` makes of its present state."""
        with self._database.write() as session:
            row = _row(session, job_id, is_locked=True)
            job = _job(session, row)
            marks = change(job)
            rewrite(session, row, marks, job.marks.labels)
            return replace(job, marks=marks)

    def cancel(self, job_id: str) -> Job:
        """Cancel an unfinished job at once, even while it runs; its claim no longer holds."""
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
        while (taken := self.take(worker, 1, lease_seconds=lease_seconds)) != Taken():
            for claim in taken.claims:
                return claim
        return None

    def take(
        self,
        worker: str,
        count: int,
        *,
        lease_seconds: float,
        owed: Sequence[Lane] = (),
        together: int = 1,
    ) -> Taken:
        """Take the first jobs of the queue, in its order."""
        while True:
            with self._database.write_rows() as connection:
                taken = take_jobs(connection, self._dispatcher, worker, count, lease_seconds, owed, together)
            if taken is None:
                return Taken()
            if taken != Taken():
                return taken

    def heartbeat(self, claim: Claim, *, lease_seconds: float) -> bool:
        """Prolong the lease, if the claim still holds."""
        # A lease is nothing that clients see: nobody is told of a change.
        values = {"lease_until": DatabaseNow() + lease_seconds, "changed_at": JobRow.changed_at}
        statement = update(JobRow).where(*fence(claim)).values(**values)
        with self._database.write() as session:
            return session.scalar(statement.returning(JobRow.id)) is not None

    def held(self, claims: Sequence[Claim]) -> frozenset[str]:
        """Return the ids of those jobs whose claims still hold."""
        if not claims:
            return frozenset()
        with self._database.read() as session:
            rows = session.execute(_HOLDERS, {"ids": [claim.job_id for claim in claims]})
            holders = {(row.id, row.owner, row.attempt) for row in rows}
        return frozenset(
            claim.job_id for claim in claims if (claim.job_id, claim.worker, claim.attempt) in holders
        )

    def finish(
        self,
        claim: Claim,
        outcome: Outcome,
        *,
        then_take: int = 0,
        lease_seconds: float = 0.0,
        owed: Sequence[Lane] = (),
        together: int = 1,
    ) -> tuple[bool, Taken]:
        """Finish a job and take others by one commit."""

        def take(connection: Connection) -> Taken:
            taken = take_jobs(
                connection, self._dispatcher, claim.worker, then_take, lease_seconds, owed, together
            )
            return taken or Taken()

        if isinstance(outcome, ChunkOutcome):
            with self._database.write() as session:
                return self._finish_chunk(session, claim, outcome), take(session.connection())
        if isinstance(outcome, Refused):
            with self._database.write() as session:
                return self._fail(session, claim, outcome.error), take(session.connection())
        if isinstance(outcome, Drawn):
            with self._database.write() as session:
                return store_atlas(session, claim, outcome), take(session.connection())
        with self._database.write_rows() as connection:
            return store_and_charge(connection, claim, outcome), take(connection)

    def finish_problems(
        self,
        ended: Sequence[tuple[Claim, SolveOutcome]],
        *,
        then_take: int = 0,
        lease_seconds: float = 0.0,
        owed: Sequence[Lane] = (),
        together: int = 1,
    ) -> tuple[frozenset[str], Taken]:
        """Finish several problems and take others by one commit."""
        worker = ended[0][0].worker
        solved = [(claim, outcome) for claim, outcome in ended if isinstance(outcome, Solved)]
        refused = [(claim, outcome) for claim, outcome in ended if isinstance(outcome, Refused)]
        with self._database.write() as session:
            held = {claim.job_id for claim, outcome in refused if self._fail(session, claim, outcome.error)}
            connection = session.connection()
            held |= store_and_charge_all(connection, solved)
            taken = take_jobs(connection, self._dispatcher, worker, then_take, lease_seconds, owed, together)
            return frozenset(held), taken or Taken()

    def finish_failure(self, claim: Claim, error: Mapping[str, object]) -> bool:
        """Mark the job failed for good; a chunk is split into smaller ones."""
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
        """Queue the job again after the loss of its child, or give it up."""
        with self._database.write() as session:
            sweep = chunks.hold(session, claim.sweep_id)
            attempt = claim.job_id, claim.attempt
            terms = detail, max_attempts, retry_seconds
            if not lose(session, fence(claim), attempt, *terms, has_begun=has_begun):
                return False
            self._deliver_after_loss(session, sweep, claim.job_id)
            return True

    def give_back(self, claim: Claim, why: str = "the worker stopped", *, pause_seconds: float = 0.0) -> bool:
        """Queue the job again because its worker does not compute it, or not yet."""
        with self._database.write() as session:
            return self._give_back(session, claim, why, pause_seconds)

    def change_way(self, claim: Claim, way: Way, why: str, *, pause_seconds: float = 0.0) -> bool:
        """Queue a chunk again, and have all points of its sweep computed anew, on another way."""
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
        """Queue several jobs again by one commit."""
        if claims:
            with self._database.write() as session:
                for claim in claims:
                    self._give_back(session, claim, why)

    def repair(self) -> int:
        """Deliver again the due jobs whose delivery was lost."""
        with self._database.write_rows() as connection:
            return self._dispatcher.repair(connection)

    def reconcile(self, *, max_attempts: int, retry_seconds: float = 0.0) -> tuple[str, ...]:
        """Requeue, or fail, every job whose lease has ended."""
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
                    self._deliver_after_loss(session, sweep, job_id)
                    changed.append(job_id)
        return tuple(changed)

    def _finish_chunk(self, session: Session, claim: Claim, outcome: ChunkOutcome) -> bool:
        queued = chunks.finish(session, claim, outcome)
        self._deliver(session, queued or ())
        return queued is not None

    def _fail(self, session: Session, claim: Claim, error: Mapping[str, object]) -> bool:
        sweep = chunks.hold(session, claim.sweep_id)
        if not move(session, JobState.FAILED, *fence(claim), error=dict(error)):
            return False
        code = str(error.get("code", ""))
        end_attempt(session, claim.job_id, claim.attempt, AttemptOutcome.FAILED, code)
        self._deliver(session, chunks.replace_failed(session, sweep, claim.job_id))
        return True

    def _give_back(
        self, session: Session, claim: Claim, why: str, pause_seconds: float = 0.0, **values: object
    ) -> bool:
        if pause_seconds:
            values["ready_at"] = database_now(session) + pause_seconds
        if not move(session, JobState.QUEUED, *fence(claim), **values):
            return False
        end_attempt(session, claim.job_id, claim.attempt, AttemptOutcome.RETURNED, why)
        self._deliver(session, [session.get_one(JobRow, claim.job_id)])
        return True

    def _deliver(self, session: Session, queued: Sequence[JobRow]) -> None:
        session.flush()
        self._dispatcher.dispatch(session.connection(), [delivery_of(row) for row in queued])

    def _deliver_after_loss(self, session: Session, sweep: SweepRow | None, job_id: str) -> None:
        """Deliver the requeued job, or the jobs that replace a failed chunk."""
        further = chunks.replace_failed(session, sweep, job_id)
        job = session.get_one(JobRow, job_id, populate_existing=True)
        self._deliver(session, [job, *further] if job.state == JobState.QUEUED.value else further)


def _job(session: Session, row: JobRow) -> Job:
    (marks,) = marks_of(session, [row])
    return job_of(row, marks)


def _row(session: Session, job_id: str, *, is_locked: bool = False) -> JobRow:
    row = session.get(JobRow, job_id, with_for_update=is_locked) if is_id(job_id) else None
    # A chunk is cancelled only with its sweep: alone, it would leave a gap.
    if row is None or JobKind(row.kind) not in SUBMITTED:
        raise JobNotFoundError(job_id)
    return row
