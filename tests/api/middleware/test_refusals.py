import gzip
import json

import psycopg
import pytest
from fastapi import FastAPI
from sqlalchemy.exc import OperationalError

from service.api.middleware.error_handlers import refusal_of
from service.api.replies import TITLES
from service.sandbox import SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from tests.support.api import PLANAR, STATE
from tests.support.verdicts import die, never_answer

pytestmark = pytest.mark.any_database

JSON = {"Content-Type": "application/json"}
QUESTION = {name: PLANAR[name] for name in ("body", "potential")}


def refusal(response, status, code):
    document = response.json()
    assert response.status_code == status, document
    assert response.headers["content-type"] == "application/problem+json"
    assert document["type"] == f"urn:polhode:problem:{code}"
    assert document["status"] == status
    assert document["title"] == TITLES[code]
    return document


def pointers(document):
    return {fault["pointer"] for fault in document["errors"]}


@pytest.mark.one_in(4)
@pytest.mark.parametrize("path", ["/v1/jobs", "/v1/validations"])
@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b'{"body": NaN}',
        b'{"body": Infinity}',
        b'{"body": -Infinity}',
        b'{"body": 1, "body": 2}',
        b'{"body": "\xff"}',
        b'{"body": "\\ud800"}',
        b'{"body": ' + b"9" * 5000 + b"}",
        b"[" * 200_000,
        b'{"a":' * 100_000,
    ],
    ids=lambda content: repr(content[:20]),
)
def test_what_is_not_json_is_refused_as_such(client, path, content):
    document = refusal(client.post(path, content=content, headers=JSON), 400, "invalid_json")
    assert document["detail"]


def test_the_place_where_a_body_stops_being_json_is_named(client):
    document = refusal(client.post("/v1/jobs", content=b'{"body":\n  ?}', headers=JSON), 400, "invalid_json")
    assert "line 2, column 3" in document["detail"]


def test_a_body_beyond_the_limit_is_refused_and_one_at_it_is_read(client):
    padding = b" " * (1_000_000 - 2)
    refusal(client.post("/v1/jobs", content=b"{}" + padding + b" ", headers=JSON), 413, "body_too_large")
    refusal(client.post("/v1/jobs", content=b"{}" + padding, headers=JSON), 422, "invalid_problem")


@pytest.mark.parametrize(
    "media_type",
    [
        "text/plain",
        "application/x-www-form-urlencoded",
        "",
        "application/json; charset=latin-1",
        'application/json; charset="utf-16"',
        "application/json-seq",
        "json",
        "application/json, text/plain",
    ],
)
def test_bodies_of_another_kind_are_refused(client, media_type):
    headers = {"Content-Type": media_type} if media_type else {}
    document = refusal(client.post("/v1/jobs", content=b"{}", headers=headers), 415, "unsupported_media_type")
    assert "application/json in utf-8 is accepted" in document["detail"]


@pytest.mark.parametrize(
    "media_type",
    ["Application/JSON; charset=utf-8", 'application/json;charset="UTF-8"', "application/json; version=1"],
)
def test_a_parameter_of_the_content_type_does_no_harm(client, media_type):
    response = client.post("/v1/jobs", content=json.dumps(STATE), headers={"Content-Type": media_type})
    assert response.status_code == 202


@pytest.mark.one_in(4)
@pytest.mark.parametrize("path", ["/v1/jobs", "/v1/sweeps", "/v1/validations"])
@pytest.mark.parametrize("encoding", ["br", "gzip, zstd", "gzip, gzip", "x-gzip", "deflate"])
def test_a_body_in_another_coding_is_refused_with_what_would_be_accepted(client, path, encoding):
    content = gzip.compress(json.dumps(STATE).encode())
    response = client.post(path, content=content, headers={**JSON, "Content-Encoding": encoding})
    refusal(response, 415, "unsupported_content_encoding")
    assert response.headers["Accept-Encoding"] == "zstd, gzip"


@pytest.mark.parametrize("encoding", ["identity", "Identity", ""])
def test_a_body_that_is_said_to_be_as_it_is_is_read(client, encoding):
    headers = {**JSON, "Content-Encoding": encoding}
    assert client.post("/v1/jobs", content=json.dumps(STATE), headers=headers).status_code == 202


def test_all_faults_are_told_at_once_each_with_its_place(client):
    problem = {
        "body": {"A": 2, "C": "one"},
        "potential": {"type": "gravity", "d": 1},
        "motion": {"type": "planar", "lambda": -1},
        "time": {"stop": 10},
        "method": "guess",
        "extra": True,
    }
    document = refusal(client.post("/v1/jobs", json=problem), 422, "invalid_problem")
    assert {
        "/body/C",
        "/potential/d",
        "/motion/lambda",
        "/time/samples",
        "/method",
        "/extra",
    } <= pointers(document)
    assert all(fault["code"] and fault["message"] for fault in document["errors"])


def test_every_coefficient_without_a_term_is_told_and_what_stands_for_it(client):
    potential = {"type": "homogeneous", "A": ["one"], "B": [0, 0, 1], "log": [1]}
    question = {"body": {"A": 3, "C": 1}, "potential": potential}
    document = refusal(client.post("/v1/validations", json=question), 422, "invalid_problem")
    codes = {fault["pointer"]: fault["code"] for fault in document["errors"]}
    assert codes == {
        "/potential/A/0": "invalid_number",
        "/potential/B/2": "undefined_term",
        "/potential/log/0": "no_log_term",
    }
    assert '"log" with index 2' in next(
        fault["message"] for fault in document["errors"] if fault["code"] == "undefined_term"
    )


@pytest.mark.parametrize("number", ["1e999", "-1e999", "1" * 900])
def test_numbers_beyond_what_can_be_computed_with_are_refused_in_their_place(client, number):
    content = json.dumps(STATE).replace('"A": 2', f'"A": {number}')
    document = refusal(client.post("/v1/jobs", content=content, headers=JSON), 422, "invalid_problem")
    assert "/body/A" in pointers(document)


@pytest.mark.parametrize("document", [None, 3, "text", [], [STATE]])
def test_a_document_that_is_no_object_is_refused(client, document):
    # A list of problems is a list of jobs.
    paths = ("/v1/validations",) if document == [STATE] else ("/v1/jobs", "/v1/validations")
    for path in paths:
        refusal(client.post(path, content=json.dumps(document), headers=JSON), 422, "invalid_problem")


@pytest.mark.parametrize(
    ("method", "path", "status", "code"),
    [
        ("GET", "/v1/nothing", 404, "not_found"),
        ("GET", "/v1/jobs/unknown", 404, "not_found"),
        ("GET", "/v1/jobs/01a1fcba-3232-7921-abd1-05ca72abad77", 404, "not_found"),
        ("POST", "/v1/jobs/unknown/cancel", 404, "not_found"),
        ("GET", "/v1/solutions/unknown", 404, "not_found"),
        ("GET", "/v1/solutions/unknown/trajectory", 404, "not_found"),
        ("GET", "/v1/solutions/unknown/trajectory?stop=1&samples=2", 404, "not_found"),
        ("DELETE", "/v1/jobs", 405, "method_not_allowed"),
    ],
)
def test_what_is_not_there_is_told(client, method, path, status, code):
    refusal(client.request(method, path), status, code)


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    ("path", "pointer"),
    [
        ("/v1/jobs?state=lost", "?state"),
        ("/v1/jobs?limit=0", "?limit"),
        ("/v1/jobs?limit=many", "?limit"),
        ("/v1/jobs?offset=-1", "?offset"),
        ("/v1/jobs?offset=99999999999999999999", "?offset"),
        ("/v1/jobs?unknown=1", "?unknown"),
        ("/v1/jobs/x?unknown=1", "?unknown"),
        ("/v1/solutions?sort=name", "?sort"),
        ("/v1/solutions?period_min=nan", "?period_min"),
        ("/v1/solutions?period=1", "?period"),
        ("/v1/solutions/x?unknown=1", "?unknown"),
        ("/v1/solutions/x/trajectory?samples=0", "?samples"),
        ("/v1/solutions/x/trajectory?start=inf&stop=1&samples=2", "?start"),
        ("/v1/solutions/x/trajectory?stop=1e16&samples=2", "?stop"),
        ("/v1/families?unknown=1", "?unknown"),
        ("/livez?unknown=1", "?unknown"),
        ("/readyz?unknown=1", "?unknown"),
    ],
)
def test_a_bad_query_names_its_parameter(client, path, pointer):
    assert pointer in pointers(refusal(client.get(path), 422, "invalid_request"))


def raises(error):
    def instead(*_, **__):
        raise error

    return instead


@pytest.mark.parametrize(
    ("error", "status", "code"),
    [
        (SandboxTimeoutError(), 422, "verdict_time_limit"),
        (SandboxMemoryError(), 422, "verdict_memory_limit"),
        (SandboxCrashError(), 422, "verdict_crashed"),
    ],
)
def test_a_verdict_that_is_not_reached_is_told(client, app: FastAPI, monkeypatch, error, status, code):
    monkeypatch.setattr(app.state.resources.sandbox, "run", raises(error))
    refusal(client.post("/v1/jobs", json=PLANAR), status, code)
    assert client.get("/v1/jobs").json()["total"] == 0


@pytest.mark.parametrize(
    ("examine", "seconds", "code"),
    [(never_answer, 0.3, "verdict_time_limit"), (die, 30.0, "verdict_crashed")],
)
def test_a_child_that_does_not_answer_is_replaced(client, app: FastAPI, monkeypatch, examine, seconds, code):
    with monkeypatch.context() as patch:
        patch.setattr("service.api.routes.validations.examine_question", examine)
        patch.setattr(app.state.resources.settings, "verdict_seconds", seconds)
        for _ in range(3):  # more often than there are children
            refusal(client.post("/v1/validations", json=QUESTION), 422, code)
    assert client.post("/v1/validations", json=QUESTION).status_code == 200


def test_a_database_that_cannot_be_reached_asks_to_come_again(client, app: FastAPI, monkeypatch):
    error = OperationalError("SELECT secret", {}, psycopg.OperationalError("connection refused"))
    monkeypatch.setattr(app.state.resources.jobs, "get", raises(error))
    response = client.get("/v1/jobs/x")
    refusal(response, 503, "unavailable")
    assert response.headers["retry-after"] == "5"
    assert "secret" not in response.text


def test_an_unforeseen_error_tells_nothing_of_the_inside(client, app: FastAPI, monkeypatch):
    monkeypatch.setattr(app.state.resources.jobs, "get", raises(ValueError("secret")))
    response = client.get("/v1/jobs/x")
    refusal(response, 500, "internal_error")
    assert "secret" not in response.text


def test_a_half_of_a_surrogate_pair_in_a_message_can_still_be_sent():
    assert refusal_of(KeyError("\ud800")).response().status_code == 500


@pytest.mark.parametrize(
    ("length", "closes"), [("1000001", False), ("16000001", True), ("1" + 20 * "0", True), ("9" * 5000, True)]
)
def test_a_body_that_is_said_to_be_too_long_is_refused_before_it_is_read(client, length, closes):
    def never_sent():
        raise AssertionError("it was read")
        yield

    headers = {**JSON, "Content-Length": length}
    response = client.post("/v1/jobs", content=never_sent(), headers=headers)
    refusal(response, 413, "body_too_large")
    assert (response.headers.get("connection") == "close") is closes
    # A client that asks first sends nothing of it, and its next request would be taken for the body.
    response = client.post("/v1/jobs", content=never_sent(), headers={**headers, "Expect": "100-continue"})
    assert response.headers["connection"] == "close"
