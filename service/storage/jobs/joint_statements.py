"""Joins several state changes into one statement: on Postgres each statement costs a round trip.

SQLite has no INSERT or UPDATE inside a WITH, and no round trips: there
:mod:`.finishing` and :mod:`.claiming` run one statement after the other.
"""

from collections.abc import Iterable

from sqlalchemy import (
    Column,
    FromClause,
    Insert,
    Select,
    Update,
    bindparam,
    insert,
    literal_column,
    select,
    true,
)
from sqlalchemy.sql import ColumnElement

from service.storage.database.clock import DatabaseNow
from service.storage.marks.mark_rows import LABELS_OF_JOB
from service.storage.tables.base import table_of
from service.storage.tables.jobs import AttemptRow, JobRow
from service.storage.tables.labels import SolutionLabelRow
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionRow

_ATTEMPTS, _SOLUTIONS = table_of(AttemptRow), table_of(SolutionRow)
_JOBS, _LABELS = table_of(JobRow), table_of(SolutionLabelRow)
_DENSE, _SAMPLES = table_of(DenseOutputRow), table_of(SamplesRow)

OF_JOB = "problem", "digest", "facts"
"""Columns that a solution has from its job."""
NEW = "new_"
"""Prefix of parameter names: without it SQLAlchemy would set the columns of that name in every table."""


def insert_solution(source: FromClause, *conditions: ColumnElement[bool]) -> Insert:
    """Return the statement that inserts a solution if ``source``, which has columns of jobs, has a row.

    What the job has too is copied: its note of this moment, which may have been changed since it was taken,
    and :data:`OF_JOB`, which need not be written as JSON once more. The parameters are the other columns of a
    solution with NEW before their names.
    """
    made_here = "created_at", "note", *OF_JOB
    given = [column for column in _SOLUTIONS.c if column.name not in made_here]
    note = select(_JOBS.c.note).where(_JOBS.c.id == _bound(_SOLUTIONS.c.job_id)).scalar_subquery()
    copied = [source.c[name] for name in OF_JOB]
    values = select(*map(_bound, given), DatabaseNow(), note, *copied).select_from(source).where(*conditions)
    return insert(_SOLUTIONS).from_select([*(column.name for column in given), *made_here], values)


def store_and_succeed(succeed: Update, end_attempt: Update) -> Select[str]:
    """Return the statement that stores a solution with arrays and labels, if ``succeed`` changes its job.

    Its parameters are those of both updates and of :func:`insert_solution`,
    ``dense`` and ``samples``; its row is the job's id.
    """
    moved = succeed.returning(*(_JOBS.c[name] for name in OF_JOB)).cte("moved")
    arrays = [
        insert(table).from_select(
            ["solution_id", "data"],
            select(_bound(_SOLUTIONS.c.id), _bound(table.c.data, name)).select_from(moved),
        )
        for table, name in ((_DENSE, "dense"), (_SAMPLES, "samples"))
    ]
    ended = end_attempt.where(_ATTEMPTS.c.job_id.in_(select(moved.c.id)))
    stored = insert_solution(moved).returning(_SOLUTIONS.c.id, _SOLUTIONS.c.created_at).cte("stored")
    labels = LABELS_OF_JOB.subquery()
    labelled = insert(_LABELS).from_select(
        ["solution_id", "created_at", "key", "value"],
        select(stored.c.id, stored.c.created_at, labels.c.key, labels.c.value).join_from(
            stored, labels, true()
        ),
    )
    parts = [*arrays, ended, labelled]
    return select(moved.c.id).add_cte(*(part.cte(f"part_{k}") for k, part in enumerate(parts)))


def claim_and_begin(claim: Update) -> Select[*tuple[object, ...]]:
    """Return the statement that begins the attempts of the jobs that ``claim`` returns.

    Its rows have in ``solved`` the first solution of an equal problem, if there is one.
    """
    claimed = claim.cte("claimed")
    begun = insert(_ATTEMPTS).from_select(
        ["job_id", "number", "worker", "started_at"],
        select(claimed.c.id, claimed.c.attempt, bindparam("claimant"), claimed.c.started_at),
    )
    solved = (
        select(_SOLUTIONS.c.id)
        .where(_SOLUTIONS.c.digest == claimed.c.digest)
        .order_by(_SOLUTIONS.c.id)
        .limit(literal_column("1"))
        .scalar_subquery()
    )
    columns: Iterable[ColumnElement[object]] = (*claimed.c, solved.label("solved"))
    return select(*columns).add_cte(begun.cte("begun"))


def _bound(column: Column[object], name: str | None = None) -> ColumnElement[object]:
    return bindparam(name or NEW + column.name, type_=column.type)
