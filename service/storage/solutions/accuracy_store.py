"""Stores the tables of accuracy and speed: every calibration is kept, the latest one is used."""

import logging
from functools import cache

from sqlalchemy import select

from service.dynamics.accuracy import AccuracyTable
from service.dynamics.numerics import NUMERICS
from service.schemas.replies.installation import AccuracyTableModel
from service.storage.database.database import Database
from service.storage.database.rows import new_id
from service.storage.solutions.shipped_accuracy import shipped_table
from service.storage.tables.base import DatabaseNow
from service.storage.tables.operations import CalibrationRow

logger = logging.getLogger(__name__)


class AccuracyStore:
    """Writes and reads the tables of this installation."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, table: AccuracyTable) -> str:
        """Store a table that was measured; return its id."""
        document = AccuracyTableModel.of(table).model_dump()
        with self._database.write() as session:
            now = session.scalars(select(DatabaseNow())).one()
            row = CalibrationRow(id=new_id(), created_at=now, document=document)
            session.add(row)
            return row.id

    def latest(self) -> AccuracyTable | None:
        """Return the table of the latest calibration; None if there was none."""
        newest = select(CalibrationRow.document).order_by(
            CalibrationRow.created_at.desc(), CalibrationRow.id.desc()
        )
        with self._database.read() as session:
            document = session.scalar(newest.limit(1))
        return None if document is None else AccuracyTableModel.model_validate(document).to_domain()

    def current(self) -> AccuracyTable:
        """Return the latest table if it was measured with these numerics, else the one that is shipped."""
        latest = self.latest()
        if latest is None:
            return shipped_table()
        if latest.numerics != NUMERICS:
            _warn_outdated(latest.date, latest.numerics)
            return shipped_table()
        return latest


@cache
def _warn_outdated(date: str, numerics: int) -> None:
    """Log once per process that a table is not used."""
    logger.warning(
        "the table of accuracy and speed of %s is of numerics %d, this version computes with %d: "
        "the shipped one is used until polhode calibrate has measured again",
        date,
        numerics,
        NUMERICS,
    )
