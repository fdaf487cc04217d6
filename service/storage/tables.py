"""The tables. Instants are seconds since 1970, UTC, as doubles by the database's clock.

A double keeps microseconds, is the same type in SQLite and Postgres, and leases
can be compared and prolonged with plain arithmetic in either.
"""

from collections.abc import Mapping
from typing import ClassVar

from sqlalchemy import JSON, CheckConstraint, Double, ForeignKey, Index, LargeBinary, MetaData, String, Uuid
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

from service.jobs.states import AttemptOutcome, JobState

Document = Mapping[str, object]


class Base(DeclarativeBase):
    """Constraints are named by rule, so that every migration can address them."""

    metadata = MetaData(
        naming_convention={
            "pk": "pk_%(table_name)s",
            "fk": "fk_%(table_name)s_%(column_0_name)s",
            "uq": "uq_%(table_name)s_%(column_0_name)s",
            "ix": "ix_%(table_name)s_%(column_0_name)s",
            "ck": "ck_%(table_name)s_%(constraint_name)s",
        }
    )
    type_annotation_map: ClassVar[dict[object, object]] = {
        str: String(64),
        float: Double(),
        bytes: LargeBinary(),
        Document: JSON(),
    }


def one_of(column: str, values: type[JobState] | type[AttemptOutcome]) -> str:
    """Return the SQL condition that ``column`` holds one of the words."""
    return f"{column} IN ({', '.join(repr(word.value) for word in values)})"


class JobRow(Base):
    """One job. ``owner`` and ``lease_until`` are set while it is running, and only then."""

    __tablename__ = "jobs"
    __table_args__ = (
        CheckConstraint(one_of("state", JobState), name="state"),
        CheckConstraint("(state = 'succeeded') = (solution_id IS NOT NULL)", name="solution"),
        CheckConstraint("(state = 'running') = (owner IS NOT NULL)", name="owner"),
        CheckConstraint("(state = 'running') = (lease_until IS NOT NULL)", name="lease"),
        Index("ix_jobs_state_id", "state", "id"),
    )

    id: Mapped[str] = mapped_column(Uuid(as_uuid=False), primary_key=True)
    state: Mapped[str] = mapped_column(String(16))
    attempt: Mapped[int] = mapped_column(default=0)
    progress: Mapped[float] = mapped_column(default=0.0)
    error: Mapped[Document | None] = mapped_column(JSON(none_as_null=True))
    reused: Mapped[bool] = mapped_column(default=False)
    solution_id: Mapped[str | None] = mapped_column(
        Uuid(as_uuid=False), ForeignKey("solutions.id"), index=True
    )
    problem: Mapped[Document]
    digest: Mapped[str]
    owner: Mapped[str | None] = mapped_column(String(128))
    lease_until: Mapped[float | None]
    created_at: Mapped[float]
    started_at: Mapped[float | None]
    finished_at: Mapped[float | None]


class AttemptRow(Base):
    """One try at a job; without ``ended_at`` while it runs."""

    __tablename__ = "attempts"
    __table_args__ = (CheckConstraint(one_of("outcome", AttemptOutcome), name="outcome"),)

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

    id: Mapped[str] = mapped_column(Uuid(as_uuid=False), primary_key=True)
    job_id: Mapped[str] = mapped_column(Uuid(as_uuid=False), unique=True)
    digest: Mapped[str] = mapped_column(index=True)
    problem: Mapped[Document]
    summary: Mapped[Document]
    created_at: Mapped[float] = mapped_column(index=True)
    family: Mapped[str | None] = mapped_column(String(32), index=True)
    method: Mapped[str | None] = mapped_column(String(32))
    tier: Mapped[str | None] = mapped_column(String(32))
    A: Mapped[float | None]
    C: Mapped[float | None]
    period: Mapped[float | None] = mapped_column(index=True)
    energy: Mapped[float | None] = mapped_column(index=True)
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


class CalibrationRow(Base):
    """A measured table of accuracy and speed; the latest one counts, the older ones are kept."""

    __tablename__ = "calibrations"

    id: Mapped[str] = mapped_column(Uuid(as_uuid=False), primary_key=True)
    created_at: Mapped[float] = mapped_column(index=True)
    document: Mapped[Document]
