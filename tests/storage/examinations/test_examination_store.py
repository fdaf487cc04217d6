"""What is kept comes back as it was, or not at all."""

import logging
from concurrent.futures import ThreadPoolExecutor
from random import Random

import pytest
from sqlalchemy import func, select, update

from service.storage import examinations as kept_rows
from service.storage.examinations import CacheRow, ExaminationStore
from service.storage.inspection.blob_inspection import check_blobs, repair_examinations
from service.storage.tables.operations import ExaminationRow

DAMAGES = [{"content": b'{"number": 7}'}, {"content": b"\xff\x00"}, {"seal": "0" * 64}]


@pytest.fixture
def kept(database):
    return ExaminationStore(database)


def entries(count, first=0):
    return [CacheRow(f"{first + k:064x}", f'{{"number": {first + k}, "ω": "é"}}') for k in range(count)]


def keys_in(database):
    with database.read() as session:
        return set(session.scalars(select(ExaminationRow.key)))


def test_entries_come_back(kept):
    given = entries(3)
    kept.add(given)
    assert kept.get([entry.key for entry in (*given, *entries(1, 9))]) == {e.key: e.content for e in given}


def test_more_entries_than_a_statement_has_parameters(kept):
    given = entries(1200)
    kept.add(given)
    assert len(kept.get([entry.key for entry in given])) == 1200


def test_the_first_to_keep_an_entry_wins_and_nothing_is_stored_twice(kept, database):
    kept.add(entries(2))
    kept.add([*entries(3), *entries(3)])
    assert len(keys_in(database)) == 3


def test_several_threads_may_keep_the_same_entries(kept, database):
    given = entries(50)
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(kept.add, (given, given[::-1], given, given[::-1])))
    assert len(keys_in(database)) == 50


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_entry_is_noticed_and_makes_place_for_a_sound_one(kept, database, caplog, damage):
    one, other = entries(2)
    kept.add([one, other])
    with database.write() as session:
        session.execute(update(ExaminationRow).where(ExaminationRow.key == one.key).values(**damage))
    with caplog.at_level(logging.WARNING):
        assert kept.get([one.key, other.key]) == {other.key: other.content}
    assert one.key in caplog.text
    assert keys_in(database) == {other.key}
    kept.add([one])
    assert kept.get([one.key]) == {one.key: one.content}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_entry_that_is_found_again_is_replaced(kept, database, damage):
    (one,) = entries(1)
    kept.add([one])
    with database.write() as session:
        session.execute(update(ExaminationRow).values(**damage))
    kept.add([one])
    assert kept.get([one.key]) == {one.key: one.content}


def test_an_entry_that_is_used_again_is_marked_once_a_day(kept, database):
    def used_at():
        with database.read() as session:
            return session.scalar(select(ExaminationRow.used_at))

    kept.add(entries(1))
    first = used_at()
    kept.add(entries(1))
    assert used_at() == first
    with database.write() as session:
        session.execute(update(ExaminationRow).values(used_at=first - 90_000.0))
    kept.add(entries(1))
    assert used_at() >= first


def test_an_entry_under_the_key_of_another_is_damaged(kept, database):
    one, other = entries(2)
    kept.add([one])
    with database.write() as session:
        session.execute(update(ExaminationRow).values(key=other.key))
    assert kept.get([other.key]) == {}


def test_trimming_leaves_the_newest(kept, database):
    for k in range(5):
        kept.add(entries(2, first=2 * k))
    with database.write() as session:
        # Clocks of databases may be too coarse for five transactions in a row.
        for k in range(10):
            changed = update(ExaminationRow).where(ExaminationRow.key == f"{k:064x}")
            session.execute(changed.values(used_at=float(k)))
    assert kept.trim(most=4, dry_run=True) == 6
    assert len(keys_in(database)) == 10
    assert kept.trim(most=4) == 6
    assert keys_in(database) == {f"{k:064x}" for k in range(6, 10)}
    assert kept.trim(most=4) == 0


def test_what_another_version_found_is_trimmed(kept, database, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(kept_rows, "examination_version", lambda: "earlier")
        kept.add(entries(2))
    kept.add(entries(1, first=5))
    assert kept.trim() == 2
    with database.read() as session:
        assert session.scalar(select(func.count()).select_from(ExaminationRow)) == 1


def test_the_inspection_finds_what_is_damaged_and_deletes_it_alone(kept, database):
    kept.add(entries(120))
    keys = [entry.key for entry in entries(70)]
    with database.write() as session:
        session.execute(update(ExaminationRow).where(ExaminationRow.key.in_(keys)).values(content=b"{}"))

    def finding():
        found = check_blobs(database, sample=None, random=Random(1))
        return next(each for each in found if each.code == "examinations")

    assert (finding().broken, finding().is_clean) == (70, True)
    assert repair_examinations(database).mended == 70
    assert finding().broken == 0
    assert repair_examinations(database) is None
    assert keys_in(database) == {entry.key for entry in entries(50, first=70)}
