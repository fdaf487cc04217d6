"""The lists that can be asked, and the SQL of every fact that queries may name.

An expression means the same on SQLite and Postgres: numbers are doubles, words compare by
their code points, and what a row does not have is NULL.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Self  # Any: SQL expressions of some type, tables and joins

from sqlalchemy import ColumnElement, Select, select
from sqlalchemy.orm import InstrumentedAttribute, aliased, join

from service.jobs.records import JobKind
from service.schemas.query.terms import (
    OF_JOBS,
    OF_RESULTS,
    OF_SOLUTIONS,
    OF_SWEEPS,
    Kind,
    Subject,
    Vocabulary,
    stored_name,
)
from service.storage.database.database import Database
from service.storage.tables.jobs import LABELS_OF, AnyLabelRow, AuditRow, JobRow
from service.storage.tables.solutions import SolutionNumberRow, SolutionRow, SweepRow

Expression = ColumnElement[Any]

JOBS = Vocabulary(OF_JOBS, has_pointers=True, has_labels=True)
SOLUTIONS = Vocabulary(OF_SOLUTIONS, has_pointers=True, has_labels=True)
SWEEPS = Vocabulary(OF_SWEEPS, has_pointers=True, has_labels=True)


@dataclass(frozen=True, slots=True)
class Source:
    """A table that queries are about."""

    name: str
    row: type[JobRow] | type[SolutionRow] | type[SweepRow]
    vocabulary: Vocabulary
    facts: Mapping[str, Expression]
    """Facts by name; those that are missing are in the document of facts."""
    columns: Mapping[str, Expression]
    """Numbers of the problem that have a column, by JSON pointer."""
    never_null: frozenset[str]
    """Facts that every row has."""
    indexed: frozenset[str]
    """Facts and pointers that have an index of their own, and may be met by few rows."""
    always: tuple[ColumnElement[bool], ...] = ()
    """Conditions that every listed row meets."""
    covering: frozenset[str] = frozenset()
    """Facts and pointers whose index goes on with the id and has all that is asked for often."""
    numbers: type[SolutionNumberRow] | None = None
    """The table of the numbers of the problem that have no column; it has the covering facts, too."""
    table: Any = None
    """Where rows are read, if it is not their own table."""
    lead: tuple[Subject, Expression] | None = None
    """The subject that this table has the values of, and these values."""

    @property
    def id(self) -> Expression:
        """The id of a row."""
        return self.facts["id"]

    def select(self, *selected: Any) -> Select[Any]:  # noqa: ANN401
        """Return a statement on its rows."""
        return select(*selected).select_from(self.row if self.table is None else self.table)

    def expression(self, subject: Subject) -> Expression:
        """Return the SQL of a subject."""
        if self.lead is not None and subject == self.lead[0]:
            return self.lead[1]
        if subject.place == "fact" and subject.name in self.facts:
            return self.facts[subject.name]
        if subject.place == "pointer" and subject.name in self.columns:
            return self.columns[subject.name]
        if subject.place == "label":
            return self.label(subject.name)
        facts: Any = self.row.facts
        stored = facts[stored_name(subject.name)]
        found: Expression = stored.as_float() if subject.kind is Kind.NUMBER else stored.as_string()
        return found

    def label(self, key: str) -> Expression:
        """Return the value that a row has under a key, NULL if it has none."""
        labels = self.labels
        owned = labels.owner_id == self.id, labels.key == key
        return select(labels.value).where(*owned).scalar_subquery()

    def attached(self, subject: Subject) -> type[AnyLabelRow] | type[SolutionNumberRow] | None:
        """Return the table that has the values of a subject alone, with an index; None if there is none."""
        if subject.place == "label":
            return self.labels
        return self.numbers if self.has_number(subject) else None

    def through(self, subject: Subject, asked: Iterable[Subject] = ()) -> Self:
        """Return the list as it is read in the table that has the values of a subject.

        It has the rows with a value. Their own table is joined only if something is asked that this one has
        not.
        """
        model = self.attached(subject)
        assert model is not None
        table = aliased(model)
        carried = frozenset({"created_at"}) if subject.place == "label" else self.covering
        facts = {name: _carried(table, self.facts[name]) for name in carried if name in self.facts}
        columns = {name: _carried(table, self.columns[name]) for name in carried if name in self.columns}
        view = replace(
            self,
            facts={**self.facts, **facts, "id": table.owner_id.expression},
            columns={**self.columns, **columns},
            covering=carried,
            always=(*self.always, table.key == self.key_of(subject)),
            lead=(subject, table.value.expression),
        )
        is_whole = not self.always and all(map(view.is_covered, asked))
        joined = table if is_whole else join(table, self.row, table.owner_id == self.row.id)
        return replace(view, table=joined)

    def has_number(self, subject: Subject) -> bool:
        """Tell whether a subject is a number of the problem that has no column."""
        return self.numbers is not None and subject.place == "pointer" and subject.name not in self.columns

    def is_covered(self, subject: Subject) -> bool:
        """Tell whether the indexes of others have a subject, too."""
        is_fact = subject.place != "label" and (subject.name in self.covering or subject.name == "id")
        return is_fact or self.is_led_by(subject)

    def may_be_null(self, subject: Subject) -> bool:
        """Tell whether there may be rows without a value."""
        is_known = subject.place != "label" and subject.name in self.never_null
        return not is_known and not self.is_led_by(subject)

    def is_led_by(self, subject: Subject) -> bool:
        """Tell whether it is read in the table that has the values of this subject."""
        return self.lead is not None and subject == self.lead[0]

    def has_index_of(self, subject: Subject) -> bool:
        """Tell whether a page in the order of a subject is read in an index that SQLite must be led to."""
        return bool(self.covering) and (subject.place == "pointer" or self.is_covered(subject))

    @staticmethod
    def key_of(subject: Subject) -> str:
        """Return the key of a subject in its table."""
        return subject.name if subject.place == "label" else stored_name(subject.name)

    @property
    def labels(self) -> type[AnyLabelRow]:
        """The table of the labels of its rows."""
        return LABELS_OF[self.row]


def _carried(table: Any, fact: Expression) -> Expression:  # noqa: ANN401
    """Return the column of another table that has a fact, by the same name."""
    found: Expression = getattr(table, str(fact.key)).expression
    return found


def _of_solution(column: InstrumentedAttribute[Any]) -> Expression:
    """Return a fact of a job's solution, NULL if it has none."""
    return select(column).where(SolutionRow.id == JobRow.solution_id).scalar_subquery()


_RESULTS: Mapping[str, InstrumentedAttribute[Any]] = {
    "method": SolutionRow.method,
    "tier": SolutionRow.tier,
    "period": SolutionRow.period,
    "energy": SolutionRow.energy,
    "error": SolutionRow.error,
    "drift": SolutionRow.drift,
    "trace": SolutionRow.trace,
    "stability.verdict": SolutionRow.stability,
    "aperiodic": SolutionRow.aperiodic,
}
assert set(_RESULTS) == set(OF_RESULTS)

_COVERING = frozenset(
    {"family", "method", "tier", "stability.verdict", "aperiodic"}
    | {"created_at", "A", "B", "C", "period", "energy", "error", "drift", "trace", "seconds"}
    | {"/body/A", "/body/B", "/body/C", "/motion/lambda"}
)
"""Facts and pointers of solutions that have such an index."""

OF_SOLUTION_ROWS = Source(
    "solutions",
    SolutionRow,
    SOLUTIONS,
    {
        **{name: _RESULTS[name].expression for name in _RESULTS},
        "id": SolutionRow.id.expression,
        "job": SolutionRow.job_id.expression,
        "digest": SolutionRow.digest.expression,
        "created_at": SolutionRow.created_at.expression,
        "family": SolutionRow.family.expression,
        "A": SolutionRow.A.expression,
        "B": SolutionRow.B.expression,
        "C": SolutionRow.C.expression,
        "seconds": SolutionRow.seconds.expression,
        "attempt": select(JobRow.attempt).where(JobRow.id == SolutionRow.job_id).scalar_subquery(),
    },
    {
        "/body/A": SolutionRow.A.expression,
        "/body/B": SolutionRow.B.expression,
        "/body/C": SolutionRow.C.expression,
        "/motion/lambda": SolutionRow.lambda_.expression,
    },
    frozenset({"id", "job", "digest", "created_at"}),
    _COVERING | {"id", "job", "digest"},
    covering=_COVERING,
    numbers=SolutionNumberRow,
)
OF_JOB_ROWS = Source(
    "jobs",
    JobRow,
    JOBS,
    {
        **{name: _of_solution(column) for name, column in _RESULTS.items()},
        "id": JobRow.id.expression,
        "solution": JobRow.solution_id.expression,
        "digest": JobRow.digest.expression,
        "state": JobRow.state.expression,
        "created_at": JobRow.created_at.expression,
        "started_at": JobRow.started_at.expression,
        "finished_at": JobRow.finished_at.expression,
        "seconds": JobRow.finished_at - JobRow.started_at,
        "attempt": JobRow.attempt.expression,
        "priority": JobRow.priority.expression,
        "reused": JobRow.reused.expression,
        "error.code": JobRow.error["code"].as_string(),
    },
    {},
    frozenset({"id", "digest", "state", "created_at", "attempt", "priority", "reused"}),
    frozenset({"id", "solution"}),
    (JobRow.kind == JobKind.SOLVE.value,),
)


OF_ATLAS_ROWS, OF_STUDY_ROWS = (
    replace(OF_JOB_ROWS, name=name, always=(JobRow.kind == kind.value,))
    for name, kind in (("atlases", JobKind.ATLAS), ("studies", JobKind.STUDY))
)
"""The jobs that draw atlases, and those that study."""


def chunks_of(sweep_id: str) -> Source:
    """Return the jobs that compute the points of a sweep."""
    return replace(
        OF_JOB_ROWS,
        name=f"chunks of {sweep_id}",
        always=(JobRow.kind == JobKind.CHUNK.value, JobRow.sweep_id == sweep_id),
    )


def audits_of(solution_id: str) -> Source:
    """Return the jobs that audit a solution."""
    audits = select(AuditRow.job_id).where(AuditRow.solution_id == solution_id)
    return replace(OF_JOB_ROWS, name=f"audits of {solution_id}", always=(JobRow.id.in_(audits),))


OF_SWEEP_ROWS = Source(
    "sweeps",
    SweepRow,
    SWEEPS,
    {
        "id": SweepRow.id.expression,
        "state": SweepRow.state.expression,
        "created_at": SweepRow.created_at.expression,
        "started_at": SweepRow.started_at.expression,
        "finished_at": SweepRow.finished_at.expression,
        "seconds": SweepRow.finished_at - SweepRow.started_at,
        "points": SweepRow.points.expression,
        "done": SweepRow.done.expression,
        "refused": SweepRow.refused.expression,
        "priority": SweepRow.priority.expression,
    },
    {},
    frozenset({"id", "state", "created_at", "points", "done", "refused", "priority"}),
    frozenset({"id"}),
)

SEEN_ROWS = 1000
"""Rows that are looked at for a name, the newest, where no table has the numbers of all."""


def with_names(database: Database, source: Source) -> Source:
    """Return a list whose vocabulary knows which pointers its rows have, so that names can stand for them."""
    return replace(
        source, vocabulary=replace(source.vocabulary, stored=partial(_pointers_in, database, source))
    )


def _pointers_in(database: Database, source: Source, pointers: Sequence[str]) -> list[str]:
    names = {stored_name(each): each for each in pointers}
    with database.search() as session:
        if (numbers := source.numbers) is not None:
            return [
                each
                for name, each in names.items()
                if session.scalar(select(numbers.key).where(numbers.key == name).limit(1)) is not None
            ]
        newest = source.select(source.row.facts).where(*source.always).order_by(source.id.desc())
        rows = session.scalars(newest.limit(SEEN_ROWS)).all()
    found = {name for facts in rows for name in facts or ()}
    return [each for name, each in names.items() if name in found]
