"""Writing twice is safe: the same key and request bring the same answer, and make nothing twice."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
from sqlalchemy import func, select, update

from service.jobs.keys import Role
from service.storage.database.rows import new_id
from service.storage.keys import (
    KEPT_SECONDS,
    GivenAnswer,
    GivenKey,
    IdempotencyStore,
    KeyTakenError,
    Receipt,
)
from service.storage.tables.jobs import JobRow
from service.storage.tables.operations import IdempotencyKeyRow
from tests.support.api import STATE, finish
from tests.support.keys import make
from tests.support.lists import list_jobs
from tests.support.sweeps import SWEEP

OTHER = {**STATE, "time": {"stop": 21, "samples": 3}}
REPLAYED = "idempotency-replayed"
REQUESTS = {"/v1/jobs": STATE, "/v1/jobs?priority=0": [STATE, {"body": {}}, OTHER], "/v1/sweeps": SWEEP}


def send(client, path="/v1/jobs", document=STATE, key="k-1", **headers):
    return client.post(path, json=document, headers={"Idempotency-Key": key, **headers})


def code_of(response):
    return response.status_code, response.json()["type"].rpartition(":")[2]


def count(database, row=JobRow):
    with database.read() as session:
        return session.scalar(select(func.count()).select_from(row))


def age(database, seconds):
    with database.write() as session:
        session.execute(update(IdempotencyKeyRow).values(created_at=IdempotencyKeyRow.created_at - seconds))


@pytest.mark.parametrize("path", REQUESTS)
def test_the_same_request_brings_the_same_answer(client, database, path):
    first = send(client, path, REQUESTS[path])
    made = count(database)
    again = send(client, path, REQUESTS[path])
    assert first.status_code == again.status_code == 202
    assert (first.content, first.headers.get("location")) == (again.content, again.headers.get("location"))
    assert (REPLAYED in first.headers, again.headers[REPLAYED]) == (False, "true")
    assert again.headers["content-type"] == "application/json"
    assert count(database) == made
    # Another key, and none, are other requests.
    assert send(client, path, REQUESTS[path], key="k-2").content != first.content
    assert client.post(path, json=REQUESTS[path]).content != first.content


def test_another_request_with_the_same_key_is_refused(client, database):
    send(client)
    made = count(database)
    for path, document in (("/v1/jobs", OTHER), ("/v1/jobs?priority=-1", STATE), ("/v1/sweeps", SWEEP)):
        assert code_of(send(client, path, document)) == (422, "idempotency_key_reused")
    assert code_of(send(client, document={})) == (422, "idempotency_key_reused")
    assert count(database) == made


@pytest.mark.any_database
def test_a_refused_request_leaves_its_key_free(client):
    assert send(client, document={}).status_code == 422
    mended = send(client)
    assert (mended.status_code, REPLAYED in mended.headers) == (202, False)


def test_who_waits_gets_the_finished_job_again(client, app, jobs):
    def work():
        finish(jobs)
        app.state.resources.wake_up.announce(list_jobs(jobs).jobs[0].id)

    worker = threading.Thread(target=work)
    app.state.resources.wake_up.notify = lambda: worker.start()
    first = send(client, Prefer="wait=30")
    worker.join()
    again = send(client, Prefer="wait=30")
    assert (first.status_code, again.status_code, again.headers[REPLAYED]) == (200, 200, "true")
    assert first.content == again.content
    assert again.headers["preference-applied"] == "wait=30"


def test_while_the_first_is_at_work_the_second_is_told_to_come_back(client, app):
    begun, go_on = threading.Event(), threading.Event()
    submit = app.state.resources.jobs.submit

    def slowly(*given, **named):
        begun.set()
        assert go_on.wait(60)
        return submit(*given, **named)

    app.state.resources.jobs.submit = slowly
    with ThreadPoolExecutor(1) as threads:
        first = threads.submit(send, client)
        assert begun.wait(60)
        second = send(client)
        go_on.set()
        assert first.result().status_code == 202
    assert code_of(second) == (409, "idempotency_key_in_use")
    assert second.headers["retry-after"] == "1"
    assert send(client).content == first.result().content


def test_of_two_processes_one_makes_it_and_both_answer_the_same(client, app, database):
    # The other process commits after this one has looked the key up.
    submit, others = app.state.resources.jobs.submit, []

    def overtaken(*given, receipt, **named):
        if not others:
            others.append(submit(*given, receipt=receipt, **named))
        return submit(*given, receipt=receipt, **named)

    app.state.resources.jobs.submit = overtaken
    answer = send(client)
    assert (answer.status_code, answer.headers[REPLAYED]) == (202, "true")
    assert answer.json()["id"] == others[0].id
    assert count(database) == 1


def test_keys_belong_to_who_sends_them(client, database):
    headers = [make(database, Role.SUBMIT)[1] for _ in range(2)]
    first, second = (send(client, **header) for header in headers)
    assert first.status_code == second.status_code == 202
    assert REPLAYED not in second.headers
    assert first.json()["id"] != second.json()["id"]
    assert send(client, **headers[0]).content == first.content


def test_after_a_day_a_key_is_free(client, database):
    first = send(client)
    age(database, KEPT_SECONDS - 60.0)
    assert send(client).content == first.content
    age(database, 120.0)
    later = send(client, document=OTHER)
    assert (later.status_code, REPLAYED in later.headers) == (202, False)
    assert later.json()["id"] != first.json()["id"]
    assert send(client, document=OTHER).content == later.content


def test_old_answers_are_deleted_and_others_kept(client, database):
    for key in "abc":
        send(client, key=key)
    age(database, KEPT_SECONDS + 60.0)
    send(client, key="d")
    assert IdempotencyStore(database).forget_old() == 3
    assert count(database, IdempotencyKeyRow) == 1
    assert send(client, key="d").headers[REPLAYED] == "true"
    assert REPLAYED not in send(client, key="a").headers


@pytest.mark.any_database
@pytest.mark.parametrize("key", ["", " ", "a b", "ä".encode("latin-1"), "x" * 256, "a\tb"])
def test_a_key_is_up_to_255_visible_characters(client, database, key):
    response = send(client, key=key)
    assert code_of(response) == (422, "invalid_request")
    assert response.json()["errors"][0]["pointer"] == "header Idempotency-Key"
    assert count(database) == 0
    assert send(client, key="!" + "x" * 253 + "~").status_code == 202


def test_nothing_is_stored_if_the_key_is_taken(jobs, database):
    receipt = Receipt(GivenKey("", new_id(), "print"), lambda made: GivenAnswer(202, {}, b"{}"))
    jobs.submit_many([(STATE, "a"), (STATE, "b")], receipt=receipt)
    with pytest.raises(KeyTakenError):
        jobs.submit_many([(STATE, "c"), (STATE, "d")], receipt=receipt)
    assert (count(database), count(database, IdempotencyKeyRow)) == (2, 1)
