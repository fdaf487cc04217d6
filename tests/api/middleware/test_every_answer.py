"""What every answer says of itself, and which pages may read it."""

import asyncio
import json
import re
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from service.api.descriptions import recorded
from service.api.keys.limits import TokenBucket
from service.app import create_app
from service.jobs.keys import Role
from service.schemas.reading.documents import instant_text
from service.settings import Settings
from service.storage.jobs.job_store import JobStore
from service.versions import version_of
from tests.support.api import STATE, TestClient
from tests.support.keys import make
from tests.support.streams import started

pytestmark = pytest.mark.any_database

PAGE = {"Origin": "https://plots.example"}
RATE = re.compile(r'"requests";r=(\d+);t=(\d+)')
POLICY = re.compile(r'"requests";q=(\d+);w=(\d+)')


@pytest.fixture
def shared(sqlite_url, verdicts):
    """A client of a service that lets pages of one origin read."""
    settings = Settings(database_url=sqlite_url, cors_origins="https://a.example, https://plots.example")
    with TestClient(create_app(settings, sandbox=verdicts)) as client:
        yield client


@pytest.mark.parametrize("scheme", ["http", "HTTPS"])
def test_a_target_in_absolute_form_is_that_of_its_path(app, scheme):
    """RFC 9112, 3.2.2: a server accepts it, and its authority replaces the header Host."""
    asked = {
        "type": "http",
        "method": "GET",
        "http_version": "1.1",
        "scheme": "http",
        "client": ("127.0.0.1", 1),
        "root_path": "",
        "path": f"{scheme}://127.0.0.1:8000/v1/families",
        "raw_path": f"{scheme}://127.0.0.1:8000/v1/families".encode(),
        "query_string": b"",
        "headers": [(b"host", b"elsewhere.example")],
    }

    async def answered(scope):
        statuses, parts = [], []

        async def receive():
            return {"type": "http.request", "body": b"", "more_body": False}

        async def send(message):
            statuses.append(message.get("status"))
            parts.append(message.get("body", b""))

        await app(scope, receive, send)
        return statuses[0], b"".join(parts)

    async def both():
        async with started(app):
            usual = {**asked, "path": "/v1/families", "raw_path": b"/v1/families"}
            usual["headers"] = [(b"host", b"127.0.0.1:8000")]
            return await answered(asked), await answered(usual)

    ours, theirs = asyncio.run(both())
    assert ours[0] == 200
    assert ours == theirs


def test_instants_end_in_z_since_a_url_makes_a_blank_of_plus():
    shown = json.dumps(recorded())
    assert re.findall(r"\d\d:\d\d(?:\.\d+)?\+\d\d", shown) == []
    assert re.findall(r"\d{4}-\d\d-\d\dT[\d:.]+(?!\.?\d)(.)", shown) != []
    moment = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
    assert instant_text(moment) == "2026-01-02T03:04:05Z"
    assert datetime.fromisoformat(instant_text(moment)) == moment


@pytest.mark.parametrize("zone", ["Z", "%2B00:00", "-00:00"])
def test_conditions_accept_both_ends_of_an_instant(client, zone):
    client.post("/v1/jobs", json=STATE)
    path = "/v1/jobs?count=exact&where=created_at%3E=2020-01-01T00:00:00"
    assert client.get(path + zone).json()["total"] == 1
    made = client.get("/v1/jobs").json()["items"][0]["created_at"]
    assert made.endswith("Z")
    # As it is shown it can be put into a URL; doubles round its last digit.
    assert client.get(f"/v1/jobs?count=exact&where=created_at>={made[:19]}Z").json()["total"] == 1


def test_every_answer_says_who_gives_it_and_to_which_request(client, monkeypatch):
    monkeypatch.setattr(JobStore, "cancel", None)  # whoever calls it, fails
    job = client.post("/v1/jobs", json=STATE).json()
    answers = [
        client.get("/v1/jobs"),
        client.post("/v1/jobs", json=STATE),
        client.post("/v1/jobs", json={}),
        client.post("/v1/jobs", content=b"{", headers={"Content-Type": "application/json"}),
        client.get("/v1/nothing"),
        client.delete("/v1/families"),
        client.head("/v1/jobs"),
        client.options("/v1/jobs"),
        client.get("/v1/jobs", headers={"If-None-Match": "*"}),
        client.get("/v1/jobs", headers={"Host": "evil.example"}),
        client.get("/livez"),
        client.post(f"/v1/jobs/{job['id']}/cancel"),
    ]
    statuses = [200, 202, 422, 400, 404, 405, 200, 204, 304, 403, 200, 500]
    assert [answer.status_code for answer in answers] == statuses
    for answer in answers:
        assert answer.headers["server"] == f"polhode/{version_of('polhode')}"
        assert answer.headers["x-request-id"]
    ids = [answer.headers["x-request-id"] for answer in answers]
    assert len(set(ids)) == len(ids)
    assert client.get("/livez", headers={"X-Request-ID": "mine"}).headers["x-request-id"] == "mine"


def test_as_many_requests_are_accepted_as_is_told(client, database, monkeypatch):
    monkeypatch.setattr(client.app.state.resources.limits, "_clock", lambda: 1000.0)
    header = make(database, Role.READ, requests_per_second=4.0)[1]
    first = client.get("/v1/jobs", headers=header)
    quota, window = map(int, POLICY.fullmatch(first.headers["ratelimit-policy"]).groups())
    left, seconds = map(int, RATE.fullmatch(first.headers["ratelimit"]).groups())
    assert (quota, window, left, seconds) == (4, 1, 3, 1)
    answers = [client.get("/v1/jobs", headers=header) for _ in range(left + 1)]
    assert [answer.status_code for answer in answers] == [200] * left + [429]
    assert [answer.headers["ratelimit"] for answer in answers] == [
        f'"requests";r={rest};t=1' for rest in (2, 1, 0, 0)
    ]
    assert "ratelimit" not in client.get("/livez").headers


@given(rate=st.floats(0.01, 1e4), taken=st.integers(0, 40))
def test_what_a_bucket_tells_is_what_it_gives(rate, taken):
    bucket = TokenBucket(rate, 0.0)
    for _ in range(taken):
        bucket.take(0.0)
    left, seconds = map(int, RATE.fullmatch(bucket.headers()["RateLimit"]).groups())
    quota = int(POLICY.fullmatch(bucket.headers()["RateLimit-Policy"])[1])
    assert [bucket.take(0.0) == 0.0 for _ in range(left + 1)] == [True] * left + [False]
    fresh = TokenBucket(rate, 0.0)
    for _ in range(taken):
        fresh.take(0.0)
    # After that time all are there again, but for a rounding of the sum.
    later = seconds * (1 + 1e-9)
    assert all(fresh.take(later) == 0.0 for _ in range(quota))


def test_pages_of_other_origins_may_read_nothing_by_default(client):
    preflight = {**PAGE, "Access-Control-Request-Method": "GET"}
    for answer in (client.get("/v1/jobs", headers=PAGE), client.options("/v1/jobs", headers=preflight)):
        assert not [name for name in answer.headers if name.startswith("access-control")]
    assert client.post("/v1/jobs", json=STATE, headers=PAGE).status_code == 403


def test_pages_of_chosen_origins_may_read_and_change(shared):
    preflight = {
        **PAGE,
        "Access-Control-Request-Method": "POST",
        "Access-Control-Request-Headers": "authorization",
    }
    asked = shared.options("/v1/jobs", headers=preflight)
    assert (asked.status_code, asked.headers["access-control-allow-origin"]) == (204, PAGE["Origin"])
    assert "POST" in asked.headers["access-control-allow-methods"].split(", ")
    sent = asked.headers["access-control-allow-headers"].split(", ")
    assert {"Authorization", "Content-Type", "Idempotency-Key", "If-None-Match"} <= set(sent)
    cross = {**PAGE, "Sec-Fetch-Site": "cross-site"}
    for answer in (shared.post("/v1/jobs", json=STATE, headers=cross), shared.get("/v1/none", headers=PAGE)):
        assert answer.headers["access-control-allow-origin"] == PAGE["Origin"]
        assert "access-control-allow-credentials" not in answer.headers
        assert "ETag" in answer.headers["access-control-expose-headers"].split(", ")
        assert "Origin" in answer.headers["vary"]


@pytest.mark.parametrize("origin", ["https://evil.example", "null", "https://plots.example.evil.example", ""])
def test_pages_of_no_other_origin_may(shared, origin):
    preflight = {"Origin": origin, "Access-Control-Request-Method": "GET"}
    for answer in (
        shared.get("/v1/jobs", headers={"Origin": origin}),
        shared.options("/v1/jobs", headers=preflight),
        shared.get("/v1/jobs"),
    ):
        assert "access-control-allow-origin" not in answer.headers
        assert "Origin" in answer.headers["vary"]
    cross = {"Origin": origin, "Sec-Fetch-Site": "cross-site"}
    assert shared.post("/v1/jobs", json=STATE, headers=cross).status_code == 403


@pytest.mark.parametrize(
    "text", ["*", "plots.example", "https://plots.example/", "https://A.example", "null"]
)
def test_what_is_no_origin_is_refused_as_a_setting(text):
    with pytest.raises(ValidationError, match="is not an origin"):
        Settings(cors_origins=text)
