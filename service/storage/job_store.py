"""Jobs in SQL. One method is one transaction; its moves are those of :mod:`service.storage.moves`."""

from collections.abc import Mapping, Sequence

from sqlalchemy import func, or_, select, update
from sqlalchemy.orm import Session

from service.jobs.errors import JobFinishedError, JobNotFoundError
from service.jobs.job import Attempt, Claim, Job, JobPage
from service.jobs.states import AttemptOutcome, JobState, sources
from service.storage.clock import DatabaseNow
from service.storage.database import Database
from service.storage.ids import is_id, new_id
from service.storage.moves import all_of, end_attempt, fence, history, lose, move, succeed
from service.storage.records import claim_of, job_of
from service.storage.summary import summary_columns
from service.storage.tables import AttemptRow, DenseOutputRow, JobRow, SamplesRow, SolutionRow


class SqlJobStore:
    """The :class:`~service.jobs.store.JobStore` in SQLite or Postgres."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def submit(self, problem: Mapping[str, object], digest: str) -> Job:
        """Store a job; born succeeded if an equal problem has been solved."""
        with self._database.write() as session:
            now = _now(session)
            solution_id = _solved(session, digest)
            reused = solution_id is not None
            row = JobRow(
                id=new_id(),
                state=(JobState.SUCCEEDED if reused else JobState.QUEUED).value,
                attempt=0,
                progress=1.0 if reused else 0.0,
                reused=reused,
                solution_id=solution_id,
                problem=problem,
                digest=digest,
                created_at=now,
                finished_at=now if reused else None,
            )
            session.add(row)
            return job_of(row)

    def get(self, job_id: str) -> Job:
        """Return a job, or raise :class:`JobNotFoundError`."""
        with self._database.read() as session:
            return job_of(_row(session, job_id))

    def list_jobs(self, *, state: JobState | None = None, limit: int = 50, offset: int = 0) -> JobPage:
        """Return jobs, newest first."""
        condition = [] if state is None else [JobRow.state == state.value]
        statement = select(JobRow).where(*condition).order_by(JobRow.id.desc()).limit(limit).offset(offset)
        with self._database.read() as session:
            total = session.scalar(select(func.count()).select_from(JobRow).where(*condition))
            return JobPage(tuple(job_of(row) for row in session.scalars(statement)), total or 0)

    def attempts(self, job_id: str) -> tuple[Attempt, ...]:
        """Return the history of a job, oldest first."""
        with self._database.read() as session:
            return history(session, _row(session, job_id).id)

    def cancel(self, job_id: str) -> Job:
        """Cancel a live job at once, whoever runs it; its claim is void from now on."""
        with self._database.write() as session:
            row = _row(session, job_id)
            if row.state == JobState.CANCELLED.value:
                return job_of(row)
            if not move(session, JobState.CANCELLED, JobRow.id == row.id):
                raise JobFinishedError(row.id, JobState(row.state))
            end_attempt(session, row.id, row.attempt, AttemptOutcome.CANCELLED)
            session.refresh(row)
            return job_of(row)

    def claim(self, worker: str, *, lease_seconds: float) -> Claim | None:
        """Take the oldest queued job by one compare-and-set."""
        oldest = (
            select(JobRow.id)
            .where(JobRow.state.in_(sources(JobState.RUNNING)))
            .order_by(JobRow.id)
            .limit(1)
            # Postgres: workers step over each other's rows. SQLite has one writer at a time and ignores it.
            .with_for_update(skip_locked=True)
            .scalar_subquery()
        )
        statement = (
            update(JobRow)
            .where(JobRow.id == oldest, JobRow.state.in_(sources(JobState.RUNNING)))
            .values(
                state=JobState.RUNNING.value,
                owner=worker,
                attempt=JobRow.attempt + 1,
                started_at=DatabaseNow(),
                lease_until=DatabaseNow() + lease_seconds,
            )
            .returning(JobRow)
        )
        with self._database.write() as session:
            row = session.scalar(statement)
            if row is None:
                return None
            started_at = row.started_at if row.started_at is not None else _now(session)
            session.add(AttemptRow(job_id=row.id, number=row.attempt, worker=worker, started_at=started_at))
            return claim_of(row)

    def heartbeat(self, claim: Claim, *, lease_seconds: float) -> bool:
        """Prolong the lease, if the claim still holds."""
        statement = update(JobRow).where(*fence(claim)).values(lease_until=DatabaseNow() + lease_seconds)
        with self._database.write() as session:
            return session.scalar(statement.returning(JobRow.id)) is not None

    def held(self, claims: Sequence[Claim]) -> frozenset[str]:
        """Return the ids of those jobs whose claims still hold."""
        if not claims:
            return frozenset()
        fences = [all_of(*fence(claim)) for claim in claims]
        with self._database.read() as session:
            return frozenset(session.scalars(select(JobRow.id).where(or_(*fences))))

    def reuse(self, claim: Claim) -> bool:
        """Finish with the solution of an equal problem, if one was stored since the job was submitted."""
        digest = select(JobRow.digest).where(JobRow.id == claim.job_id).scalar_subquery()
        with self._database.read() as session:
            solution_id = session.scalar(select(SolutionRow.id).where(SolutionRow.digest == digest).limit(1))
        if solution_id is None:
            return False
        with self._database.write() as session:
            return succeed(session, claim, solution_id, reused=True)

    def finish_success(
        self, claim: Claim, summary: Mapping[str, object], *, dense: bytes, samples: bytes
    ) -> bool:
        """Store the solution and the success together, or neither."""
        with self._database.write() as session:
            digest = session.scalar(select(JobRow.digest).where(*fence(claim)))
            if digest is None:
                return False
            solution_id = new_id()
            columns = summary_columns(claim.problem, summary)
            session.add(
                SolutionRow(
                    id=solution_id,
                    job_id=claim.job_id,
                    digest=digest,
                    problem=claim.problem,
                    summary=summary,
                    created_at=_now(session),
                    **columns,
                )
            )
            session.flush()  # the arrays refer to it
            session.add(DenseOutputRow(solution_id=solution_id, data=dense))
            session.add(SamplesRow(solution_id=solution_id, data=samples))
            session.flush()
            if succeed(session, claim, solution_id, reused=False):
                return True
            session.rollback()
            return False

    def finish_failure(self, claim: Claim, error: Mapping[str, object]) -> bool:
        """Mark the job failed for good."""
        with self._database.write() as session:
            if not move(session, JobState.FAILED, *fence(claim), error=dict(error)):
                return False
            end_attempt(
                session, claim.job_id, claim.attempt, AttemptOutcome.FAILED, str(error.get("code", ""))
            )
            return True

    def lose(self, claim: Claim, detail: str, *, max_attempts: int) -> bool:
        """Queue the job again after the loss of its child, or give it up."""
        with self._database.write() as session:
            return lose(session, fence(claim), (claim.job_id, claim.attempt), detail, max_attempts)

    def give_back(self, claim: Claim) -> bool:
        """Queue the job again because its worker stops."""
        with self._database.write() as session:
            if not move(session, JobState.QUEUED, *fence(claim)):
                return False
            end_attempt(session, claim.job_id, claim.attempt, AttemptOutcome.RETURNED, "the worker stopped")
            return True

    def reconcile(self, *, max_attempts: int) -> tuple[str, ...]:
        """Queue again, or give up, every job whose lease has ended."""
        expired = JobRow.state == JobState.RUNNING.value, JobRow.lease_until < DatabaseNow()
        # Look first without the writer's lock: almost always nothing is found.
        with self._database.read() as session:
            found = session.execute(select(JobRow.id, JobRow.attempt).where(*expired)).all()
        changed: list[str] = []
        for job_id, attempt in found:
            # A transaction each; the conditions are judged again inside it.
            still = (JobRow.id == job_id, JobRow.attempt == attempt, *expired)
            with self._database.write() as session:
                if lose(
                    session, still, (job_id, attempt), "the lease ended without a heartbeat", max_attempts
                ):
                    changed.append(job_id)
        return tuple(changed)


def _row(session: Session, job_id: str) -> JobRow:
    row = session.get(JobRow, job_id) if is_id(job_id) else None
    if row is None:
        raise JobNotFoundError(job_id)
    return row


def _now(session: Session) -> float:
    return session.scalars(select(DatabaseNow())).one()


def _solved(session: Session, digest: str) -> str | None:
    """Return the first solution of that digest. One exists only if its job succeeded."""
    statement = select(SolutionRow.id).where(SolutionRow.digest == digest).order_by(SolutionRow.id).limit(1)
    return session.scalar(statement)
