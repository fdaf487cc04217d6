"""Reads the first rows of a list along the index of the first column of its order, on SQLite.

SQLite does not know how many rows meet a condition. Given the choice, it takes all that meet one
from an index and sorts them: 200 000 for a page of 50, where the first 500 rows of the order have
such a page among them. So the index of the order is walked window by window, each a bounded range
of it, and only the rows of a window are looked up. What the windows before have brought tells how
many further rows a page would take: where these are too many, the walk is given up early, and the
database may choose.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any  # conditions and rows of some type

from sqlalchemy import ColumnElement, Row, Select, func, select
from sqlalchemy.orm import Session

from service.schemas.query.conditions import Value
from service.schemas.query.list_query import ID
from service.storage.database.database import is_postgres
from service.storage.searching.ordering import SortedColumn, beyond, sorting_of
from service.storage.searching.sources import Source

WINDOW = 200
"""Rows of the first window."""
GROWTH = 8
"""How many times the rows of all windows before a window has at most."""
MOST = 20_000
"""Rows that are looked up for a page at most: a tenth of a second."""


@dataclass(frozen=True, slots=True)
class Walk:
    """A way to walk a part of a list along an index."""

    source: Source
    order: Sequence[SortedColumn]
    """Its first column has a value in every row of the part."""
    along: Sequence[SortedColumn]
    """The columns at the beginning of the order that the index is sorted by."""
    inside: Sequence[ColumnElement[Any]]
    """Conditions that every row of the part meets, and that the index itself can decide."""

    def window(self, bounds: Sequence[ColumnElement[Any]], *columns: ColumnElement[Any]) -> Select[Any]:
        """Return the statement that reads columns of the index from some bounds on."""
        statement = select(*columns).select_from(self.source.row).where(*self.inside, *bounds)
        return statement.order_by(*sorting_of(self.along)).correlate(None)

    @property
    def has_ties(self) -> bool:
        """Whether rows that the index does not tell apart are in a certain order."""
        return self.along[-1].subject != ID


def walk_of(
    session: Session, source: Source, order: Sequence[SortedColumn], inside: Sequence[ColumnElement[Any]]
) -> Walk | None:
    """Return how a part of a list is walked, None if it cannot be."""
    first, *others = order
    if is_postgres(session.connection()) or first.may_be_null or first.subject.name not in source.walked:
        return None
    is_like_index = not others or (others[0].subject == ID and others[0].descending == first.descending)
    return Walk(source, order, order if is_like_index else order[:1], inside)


def walked(
    session: Session,
    walk: Walk,
    statement: Select[Any],
    after: Sequence[Value | None] | None,
    wanted: int,
) -> list[Row[Any]] | None:
    """Return the first ``wanted`` rows of a statement in the order of a walk, None if that would take long.

    ``statement`` has all conditions, also that for what comes after the place ``after``.
    """
    rowid = walk.source.rowid
    statement = statement.order_by(*sorting_of(walk.order))
    rows: list[Row[Any]] = []
    bounds, seen, size = _from(walk, after), 0, WINDOW
    while True:
        last = session.execute(
            walk.window(bounds, *(column.expression for column in walk.along)).limit(1).offset(size - 1)
        ).first()
        if last is not None and walk.has_ties:
            # A window ends with all rows of its last value: the other columns put these in order.
            size = _count(session, walk, [*bounds, walk.along[0].not_after(last[0])], MOST + 1 - seen)
        if seen + size > MOST:
            return None
        window = walk.window(bounds, rowid).limit(size)
        rows += session.execute(statement.where(rowid.in_(window)).limit(wanted - len(rows))).all()
        seen += size
        missing = wanted - len(rows)
        if last is None or not missing:
            return rows
        expected = missing * seen / max(1, len(rows))
        if seen + expected > MOST:
            return None
        bounds = beyond(walk.along, tuple(last))
        size = min(GROWTH * seen, int(1.25 * expected) + 1)


def _from(walk: Walk, after: Sequence[Value | None] | None) -> list[ColumnElement[bool]]:
    if after is None:
        return []
    if walk.has_ties:
        assert after[0] is not None
        return [walk.along[0].not_before(after[0])]
    return beyond(walk.along, after)


def _count(session: Session, walk: Walk, bounds: Sequence[ColumnElement[Any]], most: int) -> int:
    found = walk.window(bounds, walk.along[0].expression).limit(most).subquery()
    return session.scalar(select(func.count()).select_from(found)) or 0
