"""Documents that are made to cost time cost little, and what is wrong with them is told briefly."""

import json

import pytest

from service.schemas.problem.problem import read_problem
from service.schemas.reading import numbers, parts
from service.schemas.reading.documents import (
    MAX_ALL_FIELDS,
    MAX_FAULTS,
    MAX_FIELDS,
    InvalidJsonError,
    InvalidProblemError,
    parse_json,
)
from tests.support.api import PLANAR

pytestmark = pytest.mark.any_database

JSON = {"Content-Type": "application/json"}


def fields(count):
    return {f"f{n}": n for n in range(count)}


@pytest.mark.parametrize("path", ["/v1/jobs", "/v1/validations", "/v1/sweeps"])
def test_very_many_fields_are_refused_before_anybody_looks_at_them(client, monkeypatch, path):
    monkeypatch.setattr(parts, "_fault", lambda *_: pytest.fail("a fault was made of a field"))
    refused = client.post(path, json={**PLANAR, **fields(60_000)})
    assert (refused.status_code, refused.json()["type"]) == (400, "urn:polhode:problem:invalid_json")
    assert f"at most {MAX_FIELDS} are accepted" in refused.json()["detail"]


def test_fields_are_counted_over_all_objects():
    parse_json(json.dumps([fields(MAX_FIELDS)] * (MAX_ALL_FIELDS // MAX_FIELDS)).encode())
    with pytest.raises(InvalidJsonError, match="fields in all"):
        parse_json(json.dumps([fields(MAX_FIELDS)] * (MAX_ALL_FIELDS // MAX_FIELDS) + [{"a": 1}]).encode())


def test_a_list_of_a_thousand_problems_has_not_too_many_fields():
    parse_json(json.dumps([PLANAR] * 1000).encode())


def test_a_long_list_of_wrong_numbers_is_read_only_as_far_as_it_is_told(client, monkeypatch):
    read = []
    details = numbers.InitErrorDetails
    monkeypatch.setattr(numbers, "InitErrorDetails", lambda **of: read.append(of["loc"]) or details(**of))
    refused = client.post("/v1/jobs", json={**PLANAR, "time": {"times": [0, *["x"] * 90_000]}})
    faults = refused.json()["errors"]
    assert (refused.status_code, len(faults)) == (422, MAX_FAULTS + 1)
    assert faults[0]["pointer"] == "/time/times/1"
    assert faults[-1]["code"] == "more_faults"
    assert len(read) == MAX_FAULTS + 1


def test_a_list_that_is_too_long_is_not_read(monkeypatch):
    document = {**PLANAR, "time": {"times": ["x"] * 100_001}}
    with pytest.raises(InvalidProblemError) as refused:
        read_problem(document)
    assert [(fault.pointer, fault.code) for fault in refused.value.faults] == [
        ("/time/times", "invalid_length")
    ]


def test_unknown_fields_are_told_as_far_as_anybody_reads(monkeypatch):
    made = []
    right = parts._fault
    monkeypatch.setattr(parts, "_fault", lambda *of: made.append(of) or right(*of))
    with pytest.raises(InvalidProblemError) as refused:
        read_problem({**PLANAR, **fields(MAX_FIELDS - 10)})
    assert len(refused.value.faults) == MAX_FAULTS + 1
    assert len(made) == MAX_FAULTS + 1
    assert len(str(refused.value)) < 5000


def test_faults_of_a_list_are_told_briefly(client):
    """1000 problems with 50 faults each."""
    refused = client.post("/v1/jobs", json=[fields(50)] * 1000).json()
    assert len(refused["errors"]) == MAX_FAULTS + 1
    told = [len(item["problem"]["errors"]) for item in refused["items"]]
    assert (len(told), told[0], told[-1]) == (1000, 54, 2)
    assert sum(told) < 4000


def test_large_documents_are_read_apart_from_small_ones(client, app, monkeypatch):
    """While one large document is read, small ones are; and no two large ones at once."""
    threads = app.state.resources.reading
    assert threads._large.total_tokens == 1
    threads._large.acquire_on_behalf_of_nowait("a large document")
    small = client.post("/v1/validations", json={})
    assert small.status_code == 422
    threads._large.release_on_behalf_of("a large document")
    large = client.post("/v1/validations", content=b" " * 60_000 + b"{}", headers=JSON)
    assert large.status_code == 422
