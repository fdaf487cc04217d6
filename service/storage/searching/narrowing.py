"""Translates conditions to SQL, and chooses the one index in which the rows of a query are found.

The SQL means the same on SQLite and Postgres. The other conditions of a query test the rows found.

A database that reads an index in the order of a page, and finds hardly any row that meets the conditions,
reads all of it; one that finds what meets a condition, and sorts it, may sort nearly all rows. SQLite has
no statistics to know that before, and Postgres none of labels and of numbers without a column. So the rows
that meet a condition are counted first in its index, up to a bound.
"""

import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any  # SQL expressions of some type

from sqlalchemy import (
    ColumnClause,
    ColumnElement,
    Double,
    Select,
    UnaryExpression,
    bindparam,
    false,
    func,
    select,
)
from sqlalchemy.orm import Session
from sqlalchemy.sql.operators import custom_op

from service.schemas.query.terms import Condition, Kind, OrderKey, Subject, Value
from service.storage.database.database import is_postgres
from service.storage.searching.sources import Expression, Source

_COMPARE: Mapping[str, Callable[[Any, Any], ColumnElement[bool]]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def conditions_of(
    source: Source, conditions: Sequence[Condition], *, is_test: bool = False
) -> list[ColumnElement[bool]]:
    """Return the SQL of conditions, each of which must hold.

    ``is_test`` if rows that have been found otherwise are tested: SQLite then takes no index for them.
    """
    return [_condition(source, each, is_test) for each in conditions]


def found_in_index(source: Source, about: Sequence[Condition]) -> Select[str]:
    """Return the statement that finds, in one index, the ids of the rows that meet conditions on one subject.

    The subject may have a table of its own, such as a label: a row without a value is not among them.
    """
    subject = about[0].subject
    table = source.attached(subject)
    if table is None:
        return select(source.id).where(*source.always, *conditions_of(source, about))
    meet = values_meet(table.value.expression, about)
    return select(table.owner_id).where(table.key == source.key_of(subject), *meet)


def values_meet(value: Expression, about: Sequence[Condition]) -> list[ColumnElement[bool]]:
    """Return the SQL of conditions on one subject whose value is an expression."""
    return [_compared(value, condition) for condition in about]


def untouched(expression: Expression) -> Expression:
    """Return a column as SQLite reads it without choosing an index for it."""
    if not isinstance(expression, ColumnClause):
        return expression
    plain: Expression = UnaryExpression(expression, operator=custom_op("+"), type_=expression.type)
    return plain


def _condition(source: Source, condition: Condition, is_test: bool) -> ColumnElement[bool]:
    subject = condition.subject
    if is_test:
        return _compared(untouched(source.expression(subject)), condition)
    if subject.place == "label" and condition.operator != "is null" and not source.is_led_by(subject):
        # Read from the index of labels, which has few rows where few meet it.
        return source.id.in_(found_in_index(source, [condition]))
    return _compared(source.expression(subject), condition)


def _compared(expression: Expression, condition: Condition) -> ColumnElement[bool]:
    kind = condition.subject.kind
    match condition.operator:
        case "is null":
            return expression.is_(None)
        case "is not null":
            return expression.is_not(None)
        case "in":
            values = list(dict.fromkeys(condition.values))
            return expression.in_([bound(kind, value) for value in values]) if values else false()
    return _COMPARE[condition.operator](expression, bound(kind, condition.values[0]))


def bound(kind: Kind, value: Value | None) -> Any:  # noqa: ANN401
    """Return a value as the parameter that an expression of its kind is compared with."""
    # A double is never rounded to the type of an integer column: attempt<1.5 is true for 1.
    return bindparam(None, value, type_=Double()) if kind.has_order else value


MANY = 10_000
"""Entries of an index that are read in some milliseconds."""
MOST = 10_000_000
"""Entries that are read, in a second or two, before an index is without a bound."""
ROW = 40
"""Entries that are read in the time in which a row is looked up; more if the system has forgotten it."""

_IN_AN_INDEX = ("=", "<", "<=", ">", ">=", "in", "is not null")
_IN_LABELS = ("id", "created_at")
"""Columns that the index of labels has, too."""


@dataclass(frozen=True, slots=True)
class Narrowed:
    """Ways to find the rows of a query."""

    source: Source
    """Where they are read."""
    given: list[ColumnElement[bool]]
    """The SQL of the conditions there."""
    cost: int | None
    """How many entries of indexes can be read in that time, at most; None if it is not known."""


def met_by_few(
    session: Session, source: Source, conditions: Sequence[Condition], asked: Sequence[Subject], bound: int
) -> Narrowed | None:
    """Return how to find the rows that meet the conditions by what an index tells of one of them.

    Parameters
    ----------
    asked
        What is read of the rows, beside the conditions.
    bound
        The largest cost; None is returned if there is no such way.
    """
    about = _by_subject(source, conditions)
    counted = {subject: entries(session, source, each, bound) for subject, each in about.items()}
    counts = {subject: n for subject, n in counted.items() if n <= bound}
    best: tuple[int, Subject, Source, list[Subject]] | None = None
    for subject, count in counts.items():
        is_attached = source.attached(subject) is not None
        view = source.through(subject) if is_attached else source
        has_all = is_attached or subject.name in source.covering
        # What meets another condition is collected from its own table, if that is less than to look up rows.
        others = [
            each
            for each, n in counts.items()
            if each != subject and source.attached(each) and not view.is_covered(each) and n <= ROW * count
        ]
        settled = [condition for each in (subject, *others) for condition in about[each]]
        read = {*asked, *(each.subject for each in conditions if each not in settled)}
        is_whole = has_all and all(map(view.is_covered, read))
        looked_up = [
            n for each, n in counts.items() if each == subject or (has_all and view.is_covered(each))
        ]
        cost = count + sum(counts[each] for each in others) + (0 if is_whole else ROW * min(looked_up))
        if cost <= bound and (best is None or cost < best[0]):
            best = cost, subject, view if is_whole else source, others
    if best is None:
        return None
    cost, subject, view, others = best
    found = conditions_of(view, about[subject])
    if view is source and source.attached(subject) is not None:
        # With a limit, since Postgres knows nothing of how many these are; they may become more meanwhile.
        few = found_in_index(source, about[subject]).limit(2 * counts[subject] + MANY)
        found = [source.id.in_(few)]
    rest = tests(session, view, conditions, about[subject], [about[each] for each in others])
    return Narrowed(view, [*view.always, *found, *rest], cost)


def met(
    session: Session, source: Source, conditions: Sequence[Condition], asked: Sequence[Subject] = ()
) -> Narrowed:
    """Return how to find all rows that meet the conditions."""
    # Postgres knows by itself how many rows meet a condition on a column.
    is_told = is_postgres(session.connection()) and not members(source, conditions)
    for bound in (MANY,) if is_told else (MANY, MOST):
        found = met_by_few(session, source, conditions, asked, bound)
        if found is not None:
            return found
    return Narrowed(source, [*source.always, *conditions_of(source, conditions)], None)


def tests(
    session: Session,
    source: Source,
    conditions: Sequence[Condition],
    given: Sequence[Condition],
    others: Sequence[Sequence[Condition]],
) -> list[ColumnElement[bool]]:
    """Return the SQL that tests rows by conditions other than those that they were found by.

    For each of ``others``, which have a table of their own, what meets it is collected from there once.
    """
    is_test = not is_postgres(session.connection())
    known = [*given, *(each for about in others for each in about)]
    rest = [each for each in conditions if each not in known]
    row = untouched(source.id) if is_test else source.id
    return [
        *conditions_of(source, rest, is_test=is_test),
        *(row.in_(found_in_index(source, about)) for about in others),
    ]


def members(source: Source, conditions: Sequence[Condition]) -> list[list[Condition]]:
    """Return the conditions that rows can be tested by in another table, those on one subject together."""
    found = _by_subject(source, conditions).values()
    return [about for about in found if source.attached(about[0].subject) is not None]


def label_of_order(conditions: Sequence[Condition], keys: Sequence[OrderKey]) -> list[Condition]:
    """Return the condition on a label, if there is one, whose index has the rows in the order of the keys.

    So a page in the order of ids or instants costs the same however many have the label.
    """
    if any(key.subject.name not in _IN_LABELS for key in keys):
        return []
    return [each for each in conditions if each.subject.place == "label" and each.operator == "="][:1]


def slow_parts(
    source: Source,
    conditions: Sequence[Condition],
    keys: Sequence[OrderKey] = (),
    read: Mapping[str, Sequence[Subject]] = {},
) -> Iterator[tuple[str, str]]:
    """Yield the parts of a query that take long over many rows, each by its parameter with the reason.

    ``read`` are the subjects that all rows that match are read for, by parameter.
    """
    for condition in conditions:
        subject = condition.subject
        has_index = source.attached(subject) is not None or subject.name in source.indexed
        if not has_index or condition.operator not in _IN_AN_INDEX:
            why = "no index finds what meets" if has_index else "no index has"
            yield "?where", f"{why} {subject.text} {condition.operator}: rows are tried one by one"
    asked = {each.subject.text for each in conditions if source.has_number(each.subject)}
    read_too = [*(key.subject for key in keys), *read.get("?of", ())]
    both = asked.union(each.text for each in read_too if source.has_number(each))
    if asked and len(both) > 1:
        yield (
            "?where",
            f"no index has {' and '.join(sorted(both))} together: rows are looked up if many have each",
        )
    for key in keys[:1]:
        if not (source.has_index_of(key.subject) or key.subject.name in _IN_LABELS):
            yield "?order", f"no index has {key.subject.text}: all rows that match are sorted"
    for parameter, subjects in read.items():
        for subject in subjects:
            has_table = parameter == "?of" and source.has_number(subject)
            if not source.is_covered(subject) and not has_table:
                yield parameter, f"no index has {subject.text}: it is read from all rows that match"


def entries(session: Session, source: Source, about: Sequence[Condition], bound: int) -> int:
    """Return how many entries of an index meet conditions on one subject, at most one more than a bound."""
    found = found_in_index(source, about).limit(bound + 1).subquery()
    return session.scalar(select(func.count()).select_from(found)) or 0


def _by_subject(source: Source, conditions: Sequence[Condition]) -> dict[Subject, list[Condition]]:
    """Return the conditions that an index can find, those on the same subject together."""
    found: dict[Subject, list[Condition]] = {}
    for condition in conditions:
        subject = condition.subject
        is_indexed = source.attached(subject) is not None or subject.name in source.indexed
        if is_indexed and condition.operator in _IN_AN_INDEX:
            found.setdefault(subject, []).append(condition)
    return found
