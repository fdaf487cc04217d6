"""Killed between the commit and the answer: whoever sends the request again makes nothing twice."""

import signal

import pytest
from sqlalchemy import func, select

from service.storage.database.rows import new_id
from service.storage.tables.jobs import JobRow
from service.storage.tables.solutions import SweepRow
from tests.crash.submitters import REQUESTS, Submitters, app_on, send
from tests.support.api import TestClient
from tests.support.effort import examples

MADE = {"job": (1, 0), "list": (2, 0), "sweep": (1, 1)}
"""Jobs and sweeps that one request makes; a sweep begins with one chunk."""


@pytest.fixture(scope="module")
def killed():
    submitters = Submitters()
    yield submitters
    submitters.close()


def count(database):
    with database.read() as session:
        return tuple(session.scalar(select(func.count()).select_from(row)) for row in (JobRow, SweepRow))


@pytest.mark.any_database
@pytest.mark.random_law
def test_what_was_committed_is_answered_again_and_not_made_again(killed, url, database):
    with TestClient(app_on(url)) as client:
        for number in range(examples(3, 200)):
            kind = list(REQUESTS)[number % 3]
            key, before = new_id(), count(database)
            assert killed(url, key, kind, "commit:after:1") == -signal.SIGKILL
            made = tuple(now - then for now, then in zip(count(database), before, strict=True))
            assert made == MADE[kind]
            again = send(client, key, kind)
            assert (again.status_code, again.headers["idempotency-replayed"]) == (202, "true")
            assert send(client, key, kind).content == again.content
            if kind != "list":
                assert client.get(again.headers["location"]).json()["id"] == again.json()["id"]
            assert tuple(now - then for now, then in zip(count(database), before, strict=True)) == made


@pytest.mark.any_database
def test_what_was_not_committed_is_made_when_it_is_sent_again(killed, url, database):
    key = new_id()
    assert killed(url, key, "job", "commit:before:1") == -signal.SIGKILL
    assert count(database) == (0, 0)
    with TestClient(app_on(url)) as client:
        first = send(client, key, "job")
        assert (first.status_code, "idempotency-replayed" in first.headers) == (202, False)
        assert send(client, key, "job").headers["idempotency-replayed"] == "true"
    assert count(database) == (1, 0)
