"""Pages of long lists: the ids of a page first, by an index alone, then its rows.

An offset is walked entry by entry. Rows hold whole documents; walking over
them would read the table, walking over ids reads one narrow index.
"""

from typing import TypeVar

from sqlalchemy import Select, select
from sqlalchemy.orm import Session
from sqlalchemy.orm.interfaces import ORMOption

from service.storage.sweep_tables import SweepRow
from service.storage.tables import JobRow, SolutionRow

Row = TypeVar("Row", JobRow, SolutionRow, SweepRow)


def rows_of_page(session: Session, row: type[Row], ids: Select[str], *options: ORMOption) -> list[Row]:
    """Return the rows whose ids the statement selects, in its order."""
    found = session.scalars(ids).all()
    if not found:
        return []
    rows = session.scalars(select(row).where(row.id.in_(found)).options(*options))
    by_id = {each.id: each for each in rows}
    # On Postgres a row may be deleted between the two statements.
    return [by_id[each] for each in found if each in by_id]
