"""The tables of solutions and their arrays, of sweeps and of their computed points."""

from collections.abc import Iterator

from sqlalchemy import (
    JSON,
    BigInteger,
    CheckConstraint,
    ForeignKey,
    Index,
    PrimaryKeyConstraint,
    SmallInteger,
    String,
    Text,
    Uuid,
)
from sqlalchemy.orm import Mapped, mapped_column

from service.jobs.records import JobState
from service.schemas.reading.documents import LONGEST_NOTE, Document
from service.schemas.replies.summary import SolutionSummary
from service.storage.tables.base import ASKED_DOCUMENT, Base, DatabaseNow, Word

ASKED = (
    "family", "method", "tier", "stability", "aperiodic",
    "created_at", "A", "B", "C", "lambda_", "period", "energy", "error", "drift", "trace", "seconds",
)  # fmt: skip
"""Columns that lists of solutions are sorted and cut by."""


def _index_by(first: str) -> Index:
    """Return the index in the order of a column and the id, which has all else that is asked for often.

    So a page is found, tested and sorted in it, and no row is read, which is ten times as long.
    """
    others = (name for name in ASKED if name != first)
    return Index(f"ix_solutions_{first}_id", first, "id", *others)


class AskedColumns:
    """Facts that lists are often asked for: the columns above."""

    created_at: Mapped[float]
    family: Mapped[str | None] = mapped_column(String(32))
    method: Mapped[str | None] = mapped_column(String(32))
    tier: Mapped[str | None] = mapped_column(String(32))
    A: Mapped[float | None]
    C: Mapped[float | None]
    period: Mapped[float | None]
    energy: Mapped[float | None]
    error: Mapped[float | None]
    B: Mapped[float | None]
    lambda_: Mapped[float | None]
    drift: Mapped[float | None]
    """The largest departure of any integral."""
    trace: Mapped[float | None]
    seconds: Mapped[float | None]
    """Seconds that computing took."""
    stability: Mapped[str | None] = mapped_column(String(16))
    """The verdict."""
    aperiodic: Mapped[str | None] = mapped_column(String(16))


class SolutionRow(AskedColumns, Base):
    """A solution without its arrays; the numbers that are filtered and sorted by have columns of their own.

    It outlives its job: the problem is kept here too, and ``job_id`` says where
    it came from without being a foreign key.
    """

    __tablename__ = "solutions"
    __table_args__ = (*map(_index_by, ASKED),)

    id: Mapped[str] = mapped_column(Uuid(as_uuid=False), primary_key=True)
    job_id: Mapped[str] = mapped_column(Uuid(as_uuid=False), unique=True)
    digest: Mapped[str] = mapped_column(index=True)
    facts: Mapped[Document | None] = mapped_column(ASKED_DOCUMENT)
    """The numbers of the problem by JSON pointer: see :mod:`service.schemas.query.terms`."""
    note: Mapped[str | None] = mapped_column(String(LONGEST_NOTE))
    # After all that is short: on SQLite what is read of a row costs what stands before it.
    problem: Mapped[Document] = mapped_column(sort_order=1)
    summary: Mapped[SolutionSummary] = mapped_column(JSON(), sort_order=1)


class SolutionNumberRow(AskedColumns, Base):
    """A number of the problem without a column of its own, by which solutions are found and sorted.

    It has all else that is asked for often, as the indexes of solutions have: no row is read. Triggers
    of the database make them of the facts of a new solution, and delete them with it: so there is no foreign
    key, which would need an index by solution.
    """

    __tablename__ = "solution_numbers"
    __table_args__ = (
        PrimaryKeyConstraint("name", "value", "solution_id", postgresql_include=list(ASKED)),
        # On SQLite the table is its index.
        {"sqlite_with_rowid": False},
    )

    key: Mapped[str] = mapped_column("name", Text(), sort_order=-1)
    """As in the facts: see :func:`service.schemas.query.terms.stored_name`."""
    value: Mapped[float] = mapped_column(sort_order=-1)
    owner_id: Mapped[str] = mapped_column("solution_id", Uuid(as_uuid=False), sort_order=-1)


_NUMBERS = {
    "sqlite": "json_each({row}.facts) WHERE type IN ('integer', 'real')",
    "postgresql": "jsonb_each({row}.facts) WHERE jsonb_typeof(value) = 'number'",
}
"""The numbers among the facts of a row."""
_VALUE = {"sqlite": "value", "postgresql": "value::float8"}
_WITH_COLUMNS = " AND key NOT IN ('/body/A', '/body/B', '/body/C', '/motion/lambda')"


def insertion(dialect: str, row: str, table: str = "") -> str:
    """Return the statement that makes the numbers of a row, or of those of a table, which a comma follows."""
    columns = ", ".join(["name", "value", "solution_id", *(f'"{name}"' for name in ASKED)])
    asked = "".join(f', {row}."{name}"' for name in ASKED)
    numbers = _NUMBERS[dialect].format(row=row) + _WITH_COLUMNS
    return (
        f"INSERT INTO solution_numbers ({columns})"
        f" SELECT key, {_VALUE[dialect]}, {row}.id{asked} FROM {table}{numbers}"
    )


def triggers(dialect: str) -> Iterator[str]:
    """Yield the statements that make the triggers of solutions: no model says such a thing."""
    made = insertion(dialect, "NEW")
    gone = (
        "DELETE FROM solution_numbers WHERE (name, value, solution_id) IN"
        f" (SELECT key, {_VALUE[dialect]}, OLD.id FROM {_NUMBERS[dialect].format(row='OLD')}{_WITH_COLUMNS})"
    )
    for name, when, statement in (("made", "INSERT", made), ("gone", "DELETE", gone)):
        trigger = f"CREATE TRIGGER solution_numbers_{name} AFTER {when} ON solutions"
        if dialect == "sqlite":
            yield f"{trigger} BEGIN {statement}; END"
        else:
            yield (
                f"CREATE OR REPLACE FUNCTION solution_numbers_{name}() RETURNS trigger LANGUAGE plpgsql"
                f" AS $$ BEGIN {statement}; RETURN NULL; END $$"
            )
            yield f"{trigger} FOR EACH ROW EXECUTE FUNCTION solution_numbers_{name}()"


class DenseOutputRow(Base):
    """The solution as a function of time, encoded; a table of its own, so that lists never read it."""

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


class SweepRow(Base):
    """One sweep: the document that defines its points, and its progress; the points are in chunks."""

    __tablename__ = "sweeps"
    __table_args__ = (
        CheckConstraint("done <= next_index AND next_index <= points", name="progress"),
        CheckConstraint("refused <= done", name="refused"),
        Index("ix_sweeps_state_id", "state", "id"),
        Index("ix_sweeps_changed", "changed_at", "id"),
    )

    id: Mapped[str] = mapped_column(Uuid(as_uuid=False), primary_key=True)
    state: Mapped[str] = mapped_column(Word(JobState))
    document: Mapped[Document]
    facts: Mapped[Document | None] = mapped_column(ASKED_DOCUMENT)
    """Family and numbers of the base, for conditions."""
    points: Mapped[int] = mapped_column(BigInteger)
    next_index: Mapped[int] = mapped_column(BigInteger, default=0)
    """Index of the first point that is in no chunk yet."""
    done: Mapped[int] = mapped_column(BigInteger, default=0)
    """Points in stored chunks, the refused ones among them."""
    refused: Mapped[int] = mapped_column(BigInteger, default=0)
    chunk_points: Mapped[int] = mapped_column(default=0)
    """Size of the last chunk that was made."""
    point_seconds: Mapped[float | None]
    """Seconds a point took, as last measured."""
    priority: Mapped[int] = mapped_column(default=0)
    key_id: Mapped[str | None] = mapped_column(Uuid(as_uuid=False), index=True)
    error: Mapped[Document | None] = mapped_column(JSON(none_as_null=True))
    created_at: Mapped[float]
    started_at: Mapped[float | None]
    finished_at: Mapped[float | None]
    way: Mapped[str | None] = mapped_column(String(16))
    """The way in which all its points are computed; chosen when its first chunk is claimed."""
    note: Mapped[str | None] = mapped_column(String(LONGEST_NOTE))
    changed_at: Mapped[float] = mapped_column(
        default=DatabaseNow(), onupdate=DatabaseNow(), server_default="0"
    )
    """When anything of it was last written: see :mod:`..jobs.rows`."""
    provenances: Mapped[list[Document] | None] = mapped_column(JSON(none_as_null=True))
    """Origins of its chunks: each provenance of a solution once, with the names of its ``hosts``."""


class SweepChunkRow(Base):
    """Some neighbouring computed points, in columns."""

    __tablename__ = "sweep_chunks"
    __table_args__ = (CheckConstraint("count > 0 AND refused <= count", name="count"),)

    sweep_id: Mapped[str] = mapped_column(
        Uuid(as_uuid=False), ForeignKey("sweeps.id", ondelete="CASCADE"), primary_key=True
    )
    first: Mapped[int] = mapped_column(BigInteger, primary_key=True, autoincrement=False)
    count: Mapped[int]
    refused: Mapped[int]
    bounds: Mapped[Document]
    """{number: [smallest, largest]} of the kept numbers: a filter skips chunks without reading them."""
    data: Mapped[bytes]
    host: Mapped[str | None] = mapped_column(String(255))
    provenance: Mapped[int | None] = mapped_column(SmallInteger)
    """Its place among the provenances of its sweep; null where that is not known, as of older ones."""
