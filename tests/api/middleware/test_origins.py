"""Pages of other origins change nothing here, and no request hides another one."""

import pytest
from starlette.datastructures import Headers

from service.api.keys.access import ACCESS
from service.api.middleware.security import check_length, check_origin
from service.api.replies import ApiError
from service.app import create_app
from service.settings import Settings
from tests.support.api import STATE, TestClient

HERE = "http://127.0.0.1:8000"
UNSAFE = [(method, path) for path, roles in ACCESS.items() for method in roles if method == "POST"]
FOREIGN = [
    {"Origin": "https://evil.example"},
    {"Origin": "null"},
    {"Origin": "http://127.0.0.1:3000"},
    {"Origin": HERE, "Sec-Fetch-Site": "cross-site"},
    {"Origin": "http://127.0.0.1:3000", "Sec-Fetch-Site": "same-site"},
    {"Sec-Fetch-Site": "cross-site"},
    {"Origin": "http://["},
]
OWN = [
    {},
    {"Origin": HERE},
    {"Origin": HERE, "Sec-Fetch-Site": "same-origin"},
    # Behind a proxy that changes Host, the browser's own word holds.
    {"Origin": "https://polhode.example", "Sec-Fetch-Site": "same-origin"},
    {"Sec-Fetch-Site": "none"},
    {"Origin": "https://trusted.example", "Sec-Fetch-Site": "cross-site"},
]


@pytest.fixture
def client(sqlite_url, verdicts):
    settings = Settings(database_url=sqlite_url, origins="https://a.example, https://trusted.example")
    with TestClient(create_app(settings, sandbox=verdicts)) as client:
        yield client


@pytest.mark.one_in(3)
@pytest.mark.parametrize("headers", FOREIGN, ids=str)
def test_a_page_of_another_origin_changes_nothing(client, headers):
    job = client.post("/v1/jobs", json=STATE).json()
    for method, path in UNSAFE:
        place = path.replace("{job_id}", job["id"]).replace("{sweep_id}", job["id"])
        refused = client.request(method, place, headers={**headers, "Content-Type": "text/plain"})
        assert refused.status_code == 403, (path, refused.text)
        assert refused.json()["type"] == "urn:polhode:problem:cross_origin"
    assert client.get(f"/v1/jobs/{job['id']}", headers=headers).json()["state"] == "queued"


@pytest.mark.parametrize("headers", OWN, ids=str)
def test_own_pages_and_programs_may(client, headers):
    job = client.post("/v1/jobs", json=STATE, headers=headers).json()
    cancelled = client.post(f"/v1/jobs/{job['id']}/cancel", headers=headers)
    assert cancelled.json()["state"] == "cancelled"


@pytest.mark.parametrize(
    ("origin", "host", "is_own"),
    [
        ("https://polhode.example", "polhode.example", True),
        ("https://polhode.example", "polhode.example:443", True),
        ("http://polhode.example", "polhode.example:443", False),
        ("https://polhode.example:8443", "polhode.example", False),
        ("https://POLHODE.example", "polhode.example", True),
        ("http://[::1]:8000", "[::1]:8000", True),
        ("https://polhode.example.evil.example", "polhode.example", False),
        ("https://polhode.example@evil.example", "polhode.example", False),
        ("", "", False),
    ],
)
def test_an_origin_is_compared_with_the_host_that_was_asked(origin, host, is_own):
    headers = Headers({"origin": origin, "host": host})
    if is_own:
        check_origin("POST", headers, ())
    else:
        with pytest.raises(ApiError):
            check_origin("POST", headers, ())


@pytest.mark.parametrize(
    ("version", "headers", "is_refused"),
    [
        ("1.1", {"Content-Length": "5", "Transfer-Encoding": "chunked"}, True),
        ("1.0", {"Transfer-Encoding": "chunked"}, True),
        ("1.1", {"Transfer-Encoding": "chunked"}, False),
        ("1.0", {"Content-Length": "5"}, False),
    ],
)
def test_a_body_has_one_length(version, headers, is_refused):
    if not is_refused:
        check_length(version, Headers(headers))
        return
    with pytest.raises(ApiError) as refused:
        check_length(version, Headers(headers))
    assert (refused.value.status, refused.value.headers) == (400, {"Connection": "close"})
