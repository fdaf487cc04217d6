"""Tables of accuracy and speed: what is stored comes back, and the latest counts."""

import math
from dataclasses import replace

import pytest
from sqlalchemy import func, select

from service.dynamics.numerics import NUMERICS
from service.schemas.replies.installation import AccuracyTableModel
from service.storage.solutions import accuracy_store
from service.storage.solutions.accuracy_store import AccuracyStore
from service.storage.solutions.shipped_accuracy import shipped_table
from service.storage.tables.operations import CalibrationRow
from tests.support.accuracy import row, table


@pytest.fixture
def tables(database):
    return AccuracyStore(database)


def test_before_the_first_calibration_there_is_what_is_shipped(tables):
    assert tables.latest() is None
    assert tables.current() == shipped_table()
    assert tables.current().source == "shipped"


def test_a_table_comes_back_as_it_was(tables):
    # Doubles keep all their digits in JSON.
    stored = table(row(seconds=1 / 3, seconds_per_1000=math.pi * 1e-7), row("high", "aperiodic"))
    tables.add(stored)
    assert tables.latest() == tables.current() == stored


def test_the_latest_counts_and_the_older_ones_are_kept(tables, database):
    ids = [tables.add(table(version=str(n))) for n in range(3)]
    assert tables.latest().version == "2"
    with database.read() as session:
        assert session.scalar(select(func.count()).select_from(CalibrationRow)) == 3
        rows = list(session.scalars(select(CalibrationRow).order_by(CalibrationRow.id)))
    assert [stored.id for stored in rows] == ids
    assert [stored.document["version"] for stored in rows] == ["0", "1", "2"]
    times = [stored.created_at for stored in rows]
    assert times == sorted(times)


def test_what_is_no_number_is_not_stored(tables):
    with pytest.raises(ValueError, match="finite"):
        tables.add(table(row(seconds=math.inf)))
    assert tables.latest() is None


def test_the_document_is_that_of_the_table():
    assert AccuracyTableModel.of(table()).to_domain() == table()
    assert AccuracyTableModel.of(table()).to_domain() != replace(table(), version="2")


def test_a_table_of_other_numerics_is_not_used_and_that_is_told(tables, caplog):
    accuracy_store._warn_outdated.cache_clear()
    caplog.set_level("WARNING")
    current = table(version="current")
    tables.add(current)
    assert tables.current() == current
    assert caplog.messages == []
    tables.add(table(version="outdated", numerics=NUMERICS - 1))
    for _ in range(2):
        assert tables.current() == shipped_table()
    (told,) = caplog.messages
    assert "polhode calibrate" in told


def test_the_shipped_table_is_of_this_version_and_keeps_its_claims():
    shipped = shipped_table()
    assert shipped.numerics == NUMERICS, "measure it anew: python -m workers.calibration.shipping"
    for measured in shipped.rows:
        assert measured.error <= measured.claimed_error + measured.reference_error
        assert measured.seconds > 0
    assert len({measured.kind for measured in shipped.rows}) == 6
