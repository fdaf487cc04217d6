"""The tables of jobs, their attempts, what they make beside solutions, and of the labels of each resource."""

from collections.abc import Mapping

from sqlalchemy import JSON, CheckConstraint, ForeignKey, Index, SmallInteger, String, Uuid, desc, false, text
from sqlalchemy.orm import Mapped, mapped_column

from service.jobs.queue import Lane
from service.jobs.records import AttemptOutcome, JobKind, JobState
from service.schemas.reading.documents import LONGEST_KEY, LONGEST_NOTE, LONGEST_VALUE, Document
from service.storage.tables.base import ASKED_DOCUMENT, Base, DatabaseNow, Word
from service.storage.tables.solutions import SolutionRow, SweepRow


class JobRow(Base):
    """One job. ``owner`` and ``lease_until`` are set while it is running, and only then."""

    __tablename__ = "jobs"
    __table_args__ = (
        CheckConstraint(
            "(state = 'succeeded' AND kind = 'solve') = (solution_id IS NOT NULL)", name="solution"
        ),
        CheckConstraint("(kind = 'chunk') = (sweep_id IS NOT NULL)", name="sweep"),
        CheckConstraint("(state = 'running') = (owner IS NOT NULL)", name="owner"),
        CheckConstraint("(state = 'running') = (lease_until IS NOT NULL)", name="lease"),
        # For lists of jobs, with and without a state, newest first, and for the oldest waiting job.
        Index("ix_jobs_kind_id", "kind", "id"),
        Index("ix_jobs_state_id_kind", "state", "id", "kind"),
        CheckConstraint("lane IN (0, 1, 2)", name="lane"),
        # In the order of claims, queued jobs only. Its first column makes SQLite prefer it.
        Index(
            "ix_jobs_queue",
            "state",
            desc("priority"),
            "lane",
            "turn",
            "key_id",
            "id",
            sqlite_where=text("state = 'queued'"),
            postgresql_where=text("state = 'queued'"),
        ),
        # In the order of claims from one lane; its ends are the last turns that were assigned and taken.
        Index("ix_jobs_lanes", "state", "lane", desc("priority"), "turn", "key_id", "id"),
        Index("ix_jobs_leases", "state", "lease_until"),
        Index("ix_jobs_of_key", "key_id", "state", "lane", "priority", "turn"),
        # For the events of the installation, which tell of no chunks.
        Index(
            "ix_jobs_changed",
            "changed_at",
            "id",
            sqlite_where=text("kind = 'solve'"),
            postgresql_where=text("kind = 'solve'"),
        ),
    )

    id: Mapped[str] = mapped_column(Uuid(as_uuid=False), primary_key=True)
    kind: Mapped[str] = mapped_column(Word(JobKind), default=JobKind.SOLVE.value, server_default="solve")
    state: Mapped[str] = mapped_column(Word(JobState))
    priority: Mapped[int] = mapped_column(default=0, server_default="0")
    lane: Mapped[int] = mapped_column(SmallInteger, default=Lane.SINGLE.value, server_default="0")
    turn: Mapped[float] = mapped_column(default=0.0, server_default="0")
    """Among jobs of equal priority and lane the smallest is claimed first: see :mod:`service.jobs.queue`."""
    ready_at: Mapped[float] = mapped_column(default=0.0, server_default="0")
    """Not claimed before this instant: a job that has lost several workers waits, each time longer."""
    attempt: Mapped[int] = mapped_column(default=0)
    alone: Mapped[bool] = mapped_column(default=False, server_default=false())
    """It is claimed for a child that computes nothing else: then the loss of its worker counts."""
    progress: Mapped[float] = mapped_column(default=0.0)
    error: Mapped[Document | None] = mapped_column(JSON(none_as_null=True))
    reused: Mapped[bool] = mapped_column(default=False)
    solution_id: Mapped[str | None] = mapped_column(
        Uuid(as_uuid=False), ForeignKey("solutions.id"), index=True
    )
    sweep_id: Mapped[str | None] = mapped_column(
        Uuid(as_uuid=False), ForeignKey(SweepRow.id, ondelete="CASCADE"), index=True
    )
    key_id: Mapped[str | None] = mapped_column(Uuid(as_uuid=False))
    """The API key that submitted it; not a foreign key, so that API keys can be removed."""
    problem: Mapped[Document]
    """The problem document; for a chunk {"first": index, "count": points}."""
    examination: Mapped[str | None]
    """Key of the cached windows of its curve; not a foreign key, so that these can be trimmed."""
    examined_seconds: Mapped[float | None]
    """Seconds that its examination took; null without one."""
    facts: Mapped[Document | None] = mapped_column(ASKED_DOCUMENT)
    """Family and numbers of the problem, for conditions; a chunk has none."""
    digest: Mapped[str]
    owner: Mapped[str | None] = mapped_column(String(128))
    lease_until: Mapped[float | None]
    created_at: Mapped[float]
    started_at: Mapped[float | None]
    finished_at: Mapped[float | None]
    note: Mapped[str | None] = mapped_column(String(LONGEST_NOTE))
    changed_at: Mapped[float] = mapped_column(
        default=DatabaseNow(), onupdate=DatabaseNow(), server_default="0"
    )
    """When anything of it was last written but a lease that was prolonged: see :mod:`..jobs.rows`."""


class AttemptRow(Base):
    """One try at a job; without ``ended_at`` while it runs."""

    __tablename__ = "attempts"
    __table_args__ = (
        # For counting the attempts that ended since the last look.
        Index("ix_attempts_ended_at", "ended_at"),
    )

    job_id: Mapped[str] = mapped_column(
        Uuid(as_uuid=False), ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True
    )
    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    worker: Mapped[str] = mapped_column(String(128))
    started_at: Mapped[float]
    ended_at: Mapped[float | None]
    outcome: Mapped[str | None] = mapped_column(Word(AttemptOutcome))
    detail: Mapped[str | None] = mapped_column(String(512))


class ResultRow(Base):
    """An atlas, or the answer of a study; it has the id of its job, and goes with it."""

    __tablename__ = "atlases"

    job_id: Mapped[str] = mapped_column(
        Uuid(as_uuid=False), ForeignKey(JobRow.id, ondelete="CASCADE"), primary_key=True
    )
    data: Mapped[bytes]
    """Encoded by :mod:`service.storage.codecs.packing`."""


class AuditRow(Base):
    """The fact that a job is an audit; it goes with the job, and so with either of the two solutions."""

    __tablename__ = "audits"

    job_id: Mapped[str] = mapped_column(
        Uuid(as_uuid=False), ForeignKey(JobRow.id, ondelete="CASCADE"), primary_key=True
    )
    solution_id: Mapped[str] = mapped_column(
        Uuid(as_uuid=False), ForeignKey(SolutionRow.id, ondelete="CASCADE"), index=True
    )
    """The audited solution, not the one that the job makes."""
    comparison: Mapped[Document | None] = mapped_column(JSON(none_as_null=True))
    """The comparison of the two solutions; null as long as there is no second one."""


class JobLabelRow(Base):
    """A label of a job."""

    __tablename__ = "job_labels"
    __table_args__ = (
        # To find by a label; a page in the order of time or of ids is read from these indexes as it is.
        Index("ix_job_labels_key_value", "key", "value", "created_at", "job_id"),
        Index("ix_job_labels_key_value_id", "key", "value", "job_id"),
    )

    owner_id: Mapped[str] = mapped_column(
        "job_id", Uuid(as_uuid=False), ForeignKey(JobRow.id, ondelete="CASCADE"), primary_key=True
    )
    key: Mapped[str] = mapped_column(String(LONGEST_KEY), primary_key=True)
    value: Mapped[str] = mapped_column(String(LONGEST_VALUE))
    created_at: Mapped[float]
    """When the job was stored, not the label."""


class SolutionLabelRow(Base):
    """A label of a solution."""

    __tablename__ = "solution_labels"
    __table_args__ = (
        Index("ix_solution_labels_key_value", "key", "value", "created_at", "solution_id"),
        Index("ix_solution_labels_key_value_id", "key", "value", "solution_id"),
    )

    owner_id: Mapped[str] = mapped_column(
        "solution_id", Uuid(as_uuid=False), ForeignKey(SolutionRow.id, ondelete="CASCADE"), primary_key=True
    )
    key: Mapped[str] = mapped_column(String(LONGEST_KEY), primary_key=True)
    value: Mapped[str] = mapped_column(String(LONGEST_VALUE))
    created_at: Mapped[float]
    """When the solution was stored."""


class SweepLabelRow(Base):
    """A label of a sweep."""

    __tablename__ = "sweep_labels"
    __table_args__ = (
        Index("ix_sweep_labels_key_value", "key", "value", "created_at", "sweep_id"),
        Index("ix_sweep_labels_key_value_id", "key", "value", "sweep_id"),
    )

    owner_id: Mapped[str] = mapped_column(
        "sweep_id", Uuid(as_uuid=False), ForeignKey(SweepRow.id, ondelete="CASCADE"), primary_key=True
    )
    key: Mapped[str] = mapped_column(String(LONGEST_KEY), primary_key=True)
    value: Mapped[str] = mapped_column(String(LONGEST_VALUE))
    created_at: Mapped[float]
    """When the sweep was stored."""


AnyLabelRow = JobLabelRow | SolutionLabelRow | SweepLabelRow

LABELS_OF: Mapping[type[JobRow | SolutionRow | SweepRow], type[AnyLabelRow]] = {
    JobRow: JobLabelRow,
    SolutionRow: SolutionLabelRow,
    SweepRow: SweepLabelRow,
}
