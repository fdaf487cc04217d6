"""Finds a condition that few rows meet, so that a page is read from these rows alone.

A database that reads an index in the order of a page, and finds hardly any row that
meets the conditions, reads all of them. SQLite has no statistics to know that before, and
Postgres overestimates what comes early. So each condition with an index is tried first, up to a
bound: of those that few rows meet, the ids are known then.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any  # conditions of some type

from sqlalchemy import ColumnElement, func, select
from sqlalchemy.orm import Session, aliased

from service.schemas.query.conditions import Condition, Subject
from service.schemas.query.list_query import ListQuery
from service.storage.database.database import is_postgres
from service.storage.searching.conditions import conditions_of, labelled
from service.storage.searching.sources import Expression, Source

FEW = 1000
"""Rows that are found and sorted in a few milliseconds."""

_IN_AN_INDEX = ("=", "<", "<=", ">", ">=", "in")
_IN_LABELS = ("id", "created_at")
"""Columns that the index of labels has, too."""


def narrowed(session: Session, source: Source, query: ListQuery) -> list[ColumnElement[Any]]:
    """Return a condition on rows that the conditions of the query imply, if few rows meet one of them."""
    first = query.keys[0].subject
    for subject, conditions in _by_subject(source, query.conditions).items():
        if subject.place == "label":
            ids = labelled(source, conditions[0])
        elif subject == first and len(query.conditions) == len(conditions):
            continue  # the index of the order finds these rows by itself
        else:
            ids = select(source.row.id).where(*conditions_of(source, conditions))
        # Counted in the index first: to read the ids takes ten times as long.
        if (session.scalar(select(func.count()).select_from(ids.limit(FEW + 1).subquery())) or 0) <= FEW:
            if subject.place == "label" or is_postgres(session.connection()):
                return [source.row.id.in_(session.scalars(ids.limit(FEW + 1)).all())]
            # The index has the place of each row: none is looked up by its id.
            rowids = ids.with_only_columns(source.rowid).select_from(source.row)
            return [source.rowid.in_(rowids.limit(FEW + 1).correlate(None))]
    return []


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
    return replace(source, facts={**source.facts, **columns}, always=always, walked=frozenset()), others


def _by_subject(source: Source, conditions: Sequence[Condition]) -> dict[Subject, list[Condition]]:
    """Return the conditions that an index can find, those on the same subject together."""
    found: dict[Subject, list[Condition]] = {}
    for condition in conditions:
        subject = condition.subject
        is_indexed = subject.place == "label" or subject.name in source.indexed
        if is_indexed and condition.operator in _IN_AN_INDEX:
            found.setdefault(subject, []).append(condition)
    return found
