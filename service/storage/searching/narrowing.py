"""Chooses the one index in which the rows of a query are found; its other conditions test these rows.

A database that reads an index in the order of a page, and finds hardly any row that meets the conditions,
reads all of it; one that finds what meets a condition, and sorts it, may sort nearly all rows. SQLite has
no statistics to know that before, and Postgres none of labels and of numbers without a column. So the rows
that meet a condition are counted first in its index, up to a bound.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from sqlalchemy import ColumnElement, func, intersect, select
from sqlalchemy.orm import Session, aliased

from service.schemas.query.conditions import Condition, ListQuery, OrderKey, Subject
from service.storage.database.database import is_postgres
from service.storage.searching.conditions import conditions_of, found_in_index, untouched
from service.storage.searching.sources import Expression, Source

FEW = 1000
"""Rows that are looked up one by one in some milliseconds."""
MANY = 20_000
"""Rows of an index that has all that is asked for: they are read in the same time."""
MOST = 200_000
"""Rows of an index that are read, or put beside those of others, before a whole index is."""

_IN_AN_INDEX = ("=", "<", "<=", ">", ">=", "in")
_IN_LABELS = ("id", "created_at")
"""Columns that the index of labels has, too."""


def narrowed(
    session: Session, source: Source, conditions: Sequence[Condition], bounds: Sequence[int] = (FEW,)
) -> list[ColumnElement[bool]] | None:
    """Return the SQL of conditions, of which one is met by few rows, up to a bound; None if none is."""
    small = _met_by_few(session, source, conditions, bounds)
    if not small:
        return None
    tables = [about for about in small if source.attached(about[0].subject) is not None]
    columns = [about for about in small if about not in tables]
    if columns:
        # The index of the column has the others, too: no row is read.
        found = conditions_of(source, columns[0])
        given, others = columns[0], [about for about in tables if bounds[-1] > FEW]
    elif len(tables) > 1 or bounds[-1] <= FEW:
        ids = [found_in_index(source, about).limit(bounds[-1] + 1).subquery() for about in tables]
        both = intersect(*(select(each.c[0]) for each in ids)) if len(ids) > 1 else select(ids[0].c[0])
        found, given, others = [source.row.id.in_(both)], [each for about in tables for each in about], []
    else:
        return None
    return [*source.always, *found, *tests(session, source, conditions, given, others)]


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
    row = untouched(source.row.id.expression) if is_test else source.row.id
    return [
        *conditions_of(source, rest, is_test=is_test),
        *(row.in_(found_in_index(source, about)) for about in others),
    ]


def members(source: Source, conditions: Sequence[Condition]) -> list[list[Condition]]:
    """Return the conditions that rows can be tested by in another table, those on one subject together."""
    found = _by_subject(source, conditions).values()
    return [about for about in found if source.attached(about[0].subject) is not None]


def met(session: Session, source: Source, conditions: Sequence[Condition]) -> list[ColumnElement[bool]]:
    """Return the SQL of conditions: where few rows meet one of them, with these alone."""
    few = narrowed(session, source, conditions)
    return [*source.always, *conditions_of(source, conditions)] if few is None else few


def in_order_of_labels(source: Source, query: ListQuery) -> tuple[Source, tuple[Condition, ...]]:
    """Return how a page in the order of ids or instants is read from the index of a label's value.

    These are the source with the columns of that index, and the other conditions; both are as they
    were if no label is asked for, or another order. So a page costs the same however many have the label.
    """
    found = (each for each in query.conditions if each.subject.place == "label" and each.operator == "=")
    wanted = next(found, None)
    if wanted is None or any(key.subject.name not in _IN_LABELS for key in query.keys):
        return source, query.conditions
    labels = aliased(source.labels)
    its_value = labels.key == wanted.subject.name, labels.value == wanted.values[0]
    always = *source.always, labels.owner_id == source.row.id, *its_value
    columns: dict[str, Expression] = {
        "id": labels.owner_id.expression,
        "created_at": labels.created_at.expression,
    }
    others = tuple(each for each in query.conditions if each != wanted)
    return replace(source, facts={**source.facts, **columns}, always=always), others


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
    for key in keys[:1]:
        if not (source.has_index_of(key.subject) or key.subject.name in _IN_LABELS):
            yield "?order", f"no index has {key.subject.text}: all rows that match are sorted"
    for parameter, subjects in read.items():
        for subject in subjects:
            if not source.is_covered(subject):
                yield parameter, f"no index has {subject.text}: it is read from all rows that match"


def _met_by_few(
    session: Session, source: Source, conditions: Sequence[Condition], bounds: Sequence[int]
) -> list[list[Condition]]:
    """Return the conditions, those on one subject together, that few rows meet, the fewest first.

    These are counted up to each of the bounds, until there are some. Postgres knows without what it has a
    statistic of, and finds it by itself.
    """
    knows = is_postgres(session.connection())
    found = [
        about
        for subject, about in _by_subject(source, conditions).items()
        if not knows or source.attached(subject) is not None
    ]
    for bound in bounds:
        counts = []
        for about in found:
            rows = found_in_index(source, about).limit(bound + 1).subquery()
            counts.append(session.scalar(select(func.count()).select_from(rows)) or 0)
        small = sorted(zip(counts, found, strict=True), key=lambda pair: pair[0])
        if small and small[0][0] <= bound:
            return [about for count, about in small if count <= bound]
    return []


def _by_subject(source: Source, conditions: Sequence[Condition]) -> dict[Subject, list[Condition]]:
    """Return the conditions that an index can find, those on the same subject together."""
    found: dict[Subject, list[Condition]] = {}
    for condition in conditions:
        subject = condition.subject
        is_indexed = source.attached(subject) is not None or subject.name in source.indexed
        if is_indexed and condition.operator in _IN_AN_INDEX:
            found.setdefault(subject, []).append(condition)
    return found
