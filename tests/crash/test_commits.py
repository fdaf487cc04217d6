"""Killed right before or right after any commit: it has happened, or it has not, and the rest goes on."""

import signal
from collections import Counter

import pytest
from sqlalchemy import func, select

from service.jobs.records import JobKind
from service.storage.inspection.inspect import inspect
from service.storage.tables.jobs import (
    AttemptRow,
    AuditRow,
    JobLabelRow,
    JobRow,
    ResultRow,
    SolutionLabelRow,
    SweepLabelRow,
)
from service.storage.tables.operations import IdempotencyKeyRow
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionRow, SweepChunkRow, SweepRow
from tests.crash.victims import DEEDS, RETRIES, Executioner, Stores, stores_of
from tests.support.databases import copy_of
from tests.support.effort import one_in

MOST_COMMITS = 10
"""More than any deed has."""


@pytest.fixture(scope="module")
def kill_at():
    executioner = Executioner()
    yield executioner
    executioner.close()


@pytest.fixture(scope="module", params=["sqlite", pytest.param("postgres", marks=pytest.mark.long)])
def url(request, tmp_path_factory):
    """One database for all tests: whatever a victim leaves behind is worked off before the next one."""
    if request.param == "sqlite":
        yield copy_of(request.getfixturevalue("sqlite_template"), tmp_path_factory.mktemp("commits"))
    else:
        server = request.getfixturevalue("postgres")
        name = server.create_database(request.getfixturevalue("postgres_template"))
        yield server.url(name)
        server.drop_database(name)


@pytest.fixture(scope="module")
def stores(url):
    with stores_of(url) as stores:
        yield stores


def work_off(stores: Stores) -> None:
    """Do a healthy worker's work until there is none."""
    while True:
        stores.jobs.reconcile(**RETRIES)
        claim = stores.jobs.claim("healthy", lease_seconds=60.0)
        if claim is None:
            return
        if claim.kind is JobKind.CHUNK:
            stores.finish_chunk(claim)
        elif claim.kind is JobKind.ATLAS:
            stores.finish_atlas(claim)
        else:
            stores.finish(claim)


def census(stores: Stores) -> Counter[object]:
    """Count what there is of every kind."""
    counted: Counter[object] = Counter()
    with stores.jobs._database.read() as session:
        for columns in (
            (JobRow.kind, JobRow.state, JobRow.reused, JobRow.attempt),
            (AttemptRow.outcome,),
            (SweepRow.state, SweepRow.points, SweepRow.done, SweepRow.refused, SweepRow.next_index),
        ):
            table = columns[0].class_.__tablename__
            rows = session.execute(select(func.count(), *columns).group_by(*columns))
            counted.update({(table, *kind): count for count, *kind in rows})
        for table in (SolutionRow, DenseOutputRow, SamplesRow, SweepChunkRow, ResultRow, IdempotencyKeyRow):
            counted[table.__tablename__] = session.scalar(select(func.count()).select_from(table))
        compared = AuditRow.comparison.is_not(None)
        audits = session.execute(select(func.count(), compared).group_by(compared))
        counted.update({("audits", bool(has_comparison)): count for count, has_comparison in audits})
        for table in (JobLabelRow, SolutionLabelRow, SweepLabelRow):
            labels = session.execute(
                select(func.count(), table.key, table.value).group_by(table.key, table.value)
            )
            counted.update({(table.__tablename__, *label): count for count, *label in labels})
        for table in (JobRow, SolutionRow, SweepRow):
            notes = session.execute(select(func.count(), table.note).group_by(table.note))
            counted.update({(table.__tablename__, "note", note): count for count, note in notes})
    return counted


def trace(kill_at, deed, url, stores, fault):
    """Return how the deed ended, and what it has changed."""
    work_off(stores)
    before = census(stores)
    code = kill_at(deed, url, fault)
    after = census(stores)
    after.subtract(before)
    return code, {kind: change for kind, change in after.items() if change}


@pytest.mark.parametrize("deed", one_in(6, DEEDS), ids=lambda deed: deed.__name__)
def test_each_commit_happens_or_does_not(kill_at, url, stores, deed):
    done = {}
    for number in range(1, MOST_COMMITS):
        code, before = trace(kill_at, deed, url, stores, f"commit:before:{number}")
        if code == 0:
            break
        assert code == -signal.SIGKILL
        # Nothing of it is there before its commit, and all of it is afterwards.
        assert before == done
        code, done = trace(kill_at, deed, url, stores, f"commit:after:{number}")
        assert code == -signal.SIGKILL
    assert number > 1
    # Whoever is not killed does no more than whoever is killed after the last commit.
    assert trace(kill_at, deed, url, stores, "") == (0, done)


def test_what_the_killed_left_is_in_order_and_worked_off(stores):
    work_off(stores)
    assert [finding.code for finding in inspect(stores.jobs._database) if finding.broken] == []
    live = {kind for kind in census(stores) if isinstance(kind, tuple) and set(kind) & {"queued", "running"}}
    assert live == set()
