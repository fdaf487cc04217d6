"""Reads and writes labels and notes, within the caller's transaction."""

from collections.abc import Mapping, Sequence
from typing import TypeVar

from sqlalchemy import Connection, bindparam, delete, insert, select, update
from sqlalchemy.orm import Session

from service.schemas.reading.documents import Annotation
from service.storage.tables.base import table_of
from service.storage.tables.jobs import LABELS_OF, JobLabelRow, JobRow, SolutionLabelRow
from service.storage.tables.solutions import SolutionRow, SweepRow

Annotatable = TypeVar("Annotatable", JobRow, SolutionRow, SweepRow)
"""A row that has labels and a note."""

_OF_JOBS, _OF_SOLUTIONS = table_of(JobLabelRow), table_of(SolutionLabelRow)
_SOLUTIONS = table_of(SolutionRow)

LABELS_OF_JOB = select(_OF_JOBS.c.key, _OF_JOBS.c.value).where(_OF_JOBS.c.job_id == bindparam("job"))
"""The labels that a solution gets: those that its job has in the moment of its success."""
_COPY = insert(_OF_SOLUTIONS).from_select(
    ["solution_id", "created_at", "key", "value"],
    select(_SOLUTIONS.c.id, _SOLUTIONS.c.created_at, _OF_JOBS.c.key, _OF_JOBS.c.value)
    .join_from(_SOLUTIONS, _OF_JOBS, _OF_JOBS.c.job_id == _SOLUTIONS.c.job_id)
    .where(_SOLUTIONS.c.id == bindparam("solution")),
)


def copy_labels(connection: Connection, *solution_ids: str) -> None:
    """Give stored solutions the labels of their jobs."""
    connection.execute(_COPY, [{"solution": solution_id} for solution_id in solution_ids])


def annotations_of(session: Session, rows: Sequence[Annotatable]) -> list[Annotation]:
    """Return the annotation of each row."""
    if not rows:
        return []
    table = LABELS_OF[type(rows[0])]
    statement = select(table.owner_id, table.key, table.value).where(table.owner_id.in_([r.id for r in rows]))
    found: dict[str, dict[str, str]] = {}
    for owner_id, key, value in session.execute(statement):
        found.setdefault(owner_id, {})[key] = value
    return [Annotation(dict(sorted(found.get(row.id, {}).items())), row.note) for row in rows]


def insert_labels(
    session: Session, row: type[Annotatable], given: Sequence[tuple[str, float, Annotation]]
) -> None:
    """Insert the labels of new rows, each with its id and the instant at which it is stored."""
    labels = [
        {"owner_id": owner_id, "created_at": created_at, "key": key, "value": value}
        for owner_id, created_at, annotation in given
        for key, value in annotation.labels.items()
    ]
    if labels:
        session.execute(insert(LABELS_OF[row]), labels)


def rewrite(session: Session, row: Annotatable, annotation: Annotation, before: Mapping[str, str]) -> None:
    """Replace the annotation of a row that this transaction has locked; ``before`` are its labels so far."""
    table = LABELS_OF[type(row)]
    changed = {key: value for key, value in annotation.labels.items() if before.get(key) != value}
    gone = [key for key in before if annotation.labels.get(key) != before[key]]
    if gone:
        session.execute(delete(table).where(table.owner_id == row.id, table.key.in_(gone)))
    insert_labels(session, type(row), [(row.id, row.created_at, Annotation(changed))])
    # With a change of labels alone too: the row then says that it has changed.
    if annotation.note != row.note or gone or changed:
        session.execute(update(type(row)).where(type(row).id == row.id).values(note=annotation.note))
