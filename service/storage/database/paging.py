"""Reads a page of a long list: first its ids, from an index alone, then its rows.

A database skips the entries of an offset one by one. Rows hold whole documents, so
skipping rows would read the table; skipping ids reads one narrow index.
"""

from collections.abc import Sequence
from typing import TypeVar

from sqlalchemy import select
from sqlalchemy.orm import Session
from sqlalchemy.orm.interfaces import ORMOption

from service.storage.tables.jobs import JobRow
from service.storage.tables.solutions import SolutionRow
from service.storage.tables.sweeps import SweepRow

Row = TypeVar("Row", JobRow, SolutionRow, SweepRow)


def rows_of_page(session: Session, row: type[Row], ids: Sequence[str], *options: ORMOption) -> list[Row]:
    """Return the rows with these ids, in their order."""
    if not ids:
        return []
    rows = session.scalars(select(row).where(row.id.in_(ids)).options(*options))
    by_id = {each.id: each for each in rows}
    # On Postgres a row may be deleted between the two statements.
    return [by_id[each] for each in ids if each in by_id]
