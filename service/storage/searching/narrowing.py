"""Finds a condition that few rows meet, so that a page is read from these rows alone.

A database that reads an index in the order of a page, and finds hardly any row that
meets the conditions, reads all of them. SQLite has no statistics to know that before, and
Postgres overestimates what comes early. So each condition with an index is tried first, up to a
bound: of those that few rows meet, the ids are known then.
"""

from collections.abc import Sequence
from typing import Any  # conditions of some type

from sqlalchemy import ColumnElement, func, select
from sqlalchemy.orm import Session

from service.schemas.query.conditions import Condition, Subject
from service.schemas.query.list_query import ListQuery
from service.storage.searching.conditions import conditions_of
from service.storage.searching.sources import Source

FEW = 1000
"""Rows that are found and sorted in a few milliseconds."""

_IN_AN_INDEX = ("=", "<", "<=", ">", ">=", "in")


def narrowed(session: Session, source: Source, query: ListQuery) -> list[ColumnElement[Any]]:
    """Return a condition on ids that the conditions of the query imply, if few rows meet one of them."""
    first = query.keys[0].subject
    for subject, conditions in _by_subject(source, query.conditions).items():
        if subject == first and len(query.conditions) == len(conditions):
            continue  # the index of the order finds these rows by itself
        ids = select(source.row.id).where(*conditions_of(source, conditions))
        # Counted in the index first: to read the ids takes ten times as long.
        if (session.scalar(select(func.count()).select_from(ids.limit(FEW + 1).subquery())) or 0) <= FEW:
            return [source.row.id.in_(session.scalars(ids.limit(FEW + 1)).all())]
    return []


def _by_subject(source: Source, conditions: Sequence[Condition]) -> dict[Subject, list[Condition]]:
    """Return the conditions that an index can find, those on the same subject together."""
    found: dict[Subject, list[Condition]] = {}
    for condition in conditions:
        if condition.subject.name in source.indexed and condition.operator in _IN_AN_INDEX:
            found.setdefault(condition.subject, []).append(condition)
    return found
