"""The tables of jobs, their attempts, solutions and their arrays."""

from sqlalchemy import JSON, CheckConstraint, ForeignKey, Index, SmallInteger, String, Uuid, desc, text
from sqlalchemy.orm import Mapped, mapped_column

from service.jobs.lanes import Lane
from service.jobs.states import AttemptOutcome, JobKind, JobState
from service.storage.base import Base, Document, one_of
from service.storage.sweep_tables import SweepRow

SORTED_NUMBERS = ("created_at", "A", "C", "period", "energy", "error")
"""Columns that lists of solutions are sorted by."""


class JobRow(Base):
    """One job. ``owner`` and ``lease_until`` are set while it is running, and only then."""

    __tablename__ = "jobs"
    __table_args__ = (
        CheckConstraint(one_of("state", JobState), name="state"),
        CheckConstraint(one_of("kind", JobKind), name="kind"),
        CheckConstraint(
            "(state = 'succeeded' AND kind = 'solve') = (solution_id IS NOT NULL)", name="solution"
        ),
        CheckConstraint("(kind = 'chunk') = (sweep_id IS NOT NULL)", name="sweep"),
        CheckConstraint("(state = 'running') = (owner IS NOT NULL)", name="owner"),
        CheckConstraint("(state = 'running') = (lease_until IS NOT NULL)", name="lease"),
        # Lists of jobs, with and without a state, newest first; with it the oldest one that waits.
        Index("ix_jobs_kind_id", "kind", "id"),
        Index("ix_jobs_state_id_kind", "state", "id", "kind"),
        CheckConstraint("lane IN (0, 1, 2)", name="lane"),
        # In the order of claims; of what has ended it holds nothing. By its first column SQLite prefers it.
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
        # In the order of claims from one lane; its ends are the turns that were given and taken last.
        Index("ix_jobs_lanes", "state", "lane", desc("priority"), "turn", "key_id", "id"),
        Index("ix_jobs_leases", "state", "lease_until"),
        Index("ix_jobs_of_key", "key_id", "state", "lane", "priority", "turn"),
    )

    id: Mapped[str] = mapped_column(Uuid(as_uuid=False), primary_key=True)
    kind: Mapped[str] = mapped_column(String(16), default=JobKind.SOLVE.value, server_default="solve")
    state: Mapped[str] = mapped_column(String(16))
    priority: Mapped[int] = mapped_column(default=0, server_default="0")
    lane: Mapped[int] = mapped_column(SmallInteger, default=Lane.SINGLE.value, server_default="0")
    turn: Mapped[float] = mapped_column(default=0.0, server_default="0")
    """Of equal priority and lane the smaller is claimed first: see :mod:`service.jobs.turns`."""
    ready_at: Mapped[float] = mapped_column(default=0.0, server_default="0")
    """Not claimed before: a lost worker's job waits a little longer each time."""
    attempt: Mapped[int] = mapped_column(default=0)
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
    """Whose key submitted it; no foreign key, so that keys can be removed."""
    problem: Mapped[Document]
    """Of a chunk: {"first": index, "count": points}."""
    digest: Mapped[str]
    owner: Mapped[str | None] = mapped_column(String(128))
    lease_until: Mapped[float | None]
    created_at: Mapped[float]
    started_at: Mapped[float | None]
    finished_at: Mapped[float | None]


class AttemptRow(Base):
    """One try at a job; without ``ended_at`` while it runs."""

    __tablename__ = "attempts"
    __table_args__ = (
        CheckConstraint(one_of("outcome", AttemptOutcome), name="outcome"),
        # What has ended since the last look is counted, not all that ever ended.
        Index("ix_attempts_ended_at", "ended_at"),
    )

    job_id: Mapped[str] = mapped_column(
        Uuid(as_uuid=False), ForeignKey("jobs.id", ondelete="CASCADE"), primary_key=True
    )
    number: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    worker: Mapped[str] = mapped_column(String(128))
    started_at: Mapped[float]
    ended_at: Mapped[float | None]
    outcome: Mapped[str | None] = mapped_column(String(16))
    detail: Mapped[str | None] = mapped_column(String(512))


class SolutionRow(Base):
    """A solution without its arrays; the numbers that are filtered and sorted by have columns of their own.

    It outlives its job: the problem is kept here too, and ``job_id`` says where
    it came from without being a foreign key.
    """

    __tablename__ = "solutions"
    __table_args__ = (
        # Every order of the list, in both directions.
        *(Index(f"ix_solutions_{name}_id", name, "id") for name in SORTED_NUMBERS),
        # Whatever is filtered by, without reading the documents.
        Index("ix_solutions_filters", "family", "method", "tier", *SORTED_NUMBERS, "id"),
    )

    id: Mapped[str] = mapped_column(Uuid(as_uuid=False), primary_key=True)
    job_id: Mapped[str] = mapped_column(Uuid(as_uuid=False), unique=True)
    digest: Mapped[str] = mapped_column(index=True)
    problem: Mapped[Document]
    summary: Mapped[Document]
    created_at: Mapped[float]
    family: Mapped[str | None] = mapped_column(String(32))
    method: Mapped[str | None] = mapped_column(String(32))
    tier: Mapped[str | None] = mapped_column(String(32))
    A: Mapped[float | None]
    C: Mapped[float | None]
    period: Mapped[float | None]
    energy: Mapped[float | None]
    error: Mapped[float | None]


class DenseOutputRow(Base):
    """The solution as a function of time, encoded. Apart, so that lists of solutions never read it."""

    __tablename__ = "dense_outputs"

    solution_id: Mapped[str] = mapped_column(
        Uuid(as_uuid=False), ForeignKey("solutions.id", ondelete="CASCADE"), primary_key=True
    )
    data: Mapped[bytes]


class SamplesRow(Base):
    """The samples that were asked for with the problem, encoded."""

    __tablename__ = "samples"

    solution_id: Mapped[str] = mapped_column(
        Uuid(as_uuid=False), ForeignKey("solutions.id", ondelete="CASCADE"), primary_key=True
    )
    data: Mapped[bytes]
