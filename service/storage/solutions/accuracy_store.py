"""Tables of accuracy and speed: every calibration is kept, the latest one counts."""

from functools import cache
from pathlib import Path

from sqlalchemy import select

from service.dynamics.accuracy import AccuracyTable
from service.schemas.accuracy import AccuracyTableModel
from service.storage.clock import DatabaseNow
from service.storage.database import Database
from service.storage.ids import new_id
from service.storage.operation_tables import CalibrationRow

SHIPPED = Path(__file__).with_name("shipped_accuracy.json")


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
        """Return the table of the latest calibration, None before the first."""
        newest = select(CalibrationRow.document).order_by(
            CalibrationRow.created_at.desc(), CalibrationRow.id.desc()
        )
        with self._database.read() as session:
            document = session.scalar(newest.limit(1))
        return None if document is None else AccuracyTableModel.model_validate(document).to_domain()

    def current(self) -> AccuracyTable:
        """Return the latest table, before the first calibration the one that is shipped."""
        return self.latest() or shipped_table()


@cache
def shipped_table() -> AccuracyTable:
    """Return the table that comes with this version, measured on a machine of its makers."""
    return AccuracyTableModel.model_validate_json(SHIPPED.read_bytes()).to_domain()
