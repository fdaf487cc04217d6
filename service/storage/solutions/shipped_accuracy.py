"""Reads the table of accuracy and speed that is shipped with this version, which needs no database."""

from functools import cache
from pathlib import Path

from service.dynamics.accuracy import AccuracyTable
from service.schemas.replies.accuracy import AccuracyTableModel

SHIPPED = Path(__file__).with_name("shipped_accuracy.json")


@cache
def shipped_table() -> AccuracyTable:
    """Return the table, measured on the developers' machine."""
    return AccuracyTableModel.model_validate_json(SHIPPED.read_bytes()).to_domain()
