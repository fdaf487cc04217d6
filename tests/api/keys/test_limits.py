import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.api.keys.limits import TokenBucket
from service.jobs.keys import Role
from service.settings import Settings
from service.storage.keys import KeyLimits, KeyStore, charge
from tests.support.api import STATE, TestClient, create_app, finish
from tests.support.keys import Clock, header, make

pytestmark = pytest.mark.any_database


def problem(number: int) -> dict:
    """A problem like no other."""
    return {**STATE, "time": {"stop": 20, "samples": 100 + number}}


def code(response) -> str:
    return response.json()["type"].removeprefix("urn:polhode:problem:")


@pytest.fixture
def clock(client, monkeypatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(client.app.state.resources.limits, "_clock", clock)
    return clock


def served(url: str, **settings) -> TestClient:
    return TestClient(create_app(Settings(database_url=url, **settings)))


@given(
    rate=st.floats(0.01, 1e4),
    steps=st.lists(st.floats(0.0, 100.0), min_size=1, max_size=50),
)
def test_a_bucket_never_gives_more_than_its_size_and_what_came_in(rate, steps):
    bucket, now, given_away = TokenBucket(rate, 0.0), 0.0, 0
    for step in steps:
        now += step
        given_away += bucket.take(now) == 0.0
        # Sums of fifty floats: 1e-9 of the total is far above their rounding.
        assert given_away <= (max(1.0, rate) + rate * now) * (1 + 1e-9)


@given(rate=st.floats(0.01, 1e4))
def test_whoever_waits_as_long_as_told_is_let_in(rate):
    bucket = TokenBucket(rate, 0.0)
    while (wait := bucket.take(0.0)) == 0.0:
        pass
    assert 0 < wait <= 1 / rate * (1 + 1e-9)
    assert bucket.take(wait * 0.9) > 0.0
    # A rounding below: clients are told whole seconds, rounded up.
    assert bucket.take(wait * (1 + 1e-9)) == 0.0


def test_requests_beyond_the_rate_of_a_key_are_told_when_to_come_again(client, clock, database):
    slow, other = make(database, Role.READ, requests_per_second=0.25)[1], make(database, Role.READ)[1]
    assert client.get("/v1/jobs", headers=slow).status_code == 200
    response = client.get("/v1/jobs", headers=slow)
    assert (response.status_code, code(response)) == (429, "too_many_requests")
    assert response.headers["retry-after"] == "4"
    assert "0.25 requests per second" in response.json()["detail"]
    assert client.get("/v1/jobs", headers=other).status_code == 200
    assert client.get("/livez").status_code == 200
    clock.now += 4.0
    assert client.get("/v1/jobs", headers=slow).status_code == 200


def test_what_a_key_may_not_do_counts_as_well(client, clock, database):
    sent = make(database, Role.METRICS, requests_per_second=1.0)[1]
    assert client.get("/v1/jobs", headers=sent).status_code == 403
    assert client.get("/metrics", headers=sent).status_code == 429


def test_without_keys_everybody_shares_the_rate_of_the_installation(sqlite_url):
    with served(sqlite_url, requests_per_second=2.0) as client:
        client.app.state.resources.limits._clock = Clock()
        assert [client.get("/v1/jobs").status_code for _ in range(3)] == [200, 200, 429]


def test_a_key_has_so_many_live_jobs_and_no_more(client, clock, jobs, database):
    sent, other = make(database, Role.SUBMIT, queued_jobs=2)[1], make(database, Role.SUBMIT)[1]
    ids = [client.post("/v1/jobs", json=problem(k), headers=sent).json()["id"] for k in range(2)]
    response = client.post("/v1/jobs", json=problem(2), headers=sent)
    assert (response.status_code, code(response)) == (429, "too_many_queued_jobs")
    assert response.headers["retry-after"] == "10"
    assert "2 jobs are queued or running" in response.json()["detail"]
    assert client.post("/v1/jobs", json=problem(3), headers=other).status_code == 202
    # A running job still counts, one that has ended makes room at once.
    assert client.get("/v1/jobs?state=queued", headers=sent).json()["total"] == 3
    claim = jobs.claim("w", lease_seconds=60.0)
    assert claim.job_id == ids[0]
    assert client.post("/v1/jobs", json=problem(4), headers=sent).status_code == 429
    assert client.post(f"/v1/jobs/{ids[1]}/cancel", headers=sent).status_code == 200
    assert client.post("/v1/jobs", json=problem(5), headers=sent).status_code == 202


def test_a_problem_that_is_refused_takes_nobodys_place_for_good(client, clock, database):
    sent = make(database, Role.SUBMIT, queued_jobs=1)[1]
    inadmissible = {**STATE, "potential": {"type": "gravity", "a": 1, "c": 1}}
    inadmissible["motion"] = {"type": "planar", "lambda": 1}
    for _ in range(2):
        assert client.post("/v1/jobs", json=inadmissible, headers=sent).status_code == 422
    assert client.post("/v1/jobs", json=problem(0), headers=sent).status_code == 202


def test_without_keys_everybody_shares_the_queue_of_the_installation(url):
    with served(url, max_queued_jobs=1) as client:
        assert [client.post("/v1/jobs", json=problem(k)).status_code for k in range(2)] == [202, 429]


def test_the_limit_of_the_installation_holds_for_keys_without_their_own(url, database):
    own, none = make(database, Role.SUBMIT, queued_jobs=1)[1], make(database, Role.SUBMIT)[1]
    with served(url, max_queued_jobs=0) as client:
        assert client.post("/v1/jobs", json=problem(0), headers=own).status_code == 202
        assert code(client.post("/v1/jobs", json=problem(1), headers=none)) == "too_many_queued_jobs"


def test_who_has_stored_enough_may_read_and_not_submit(client, jobs, database):
    sent = make(database, Role.SUBMIT, stored_bytes=100)[1]
    assert client.post("/v1/jobs", json=STATE, headers=sent).status_code == 202
    solution = finish(jobs).solution_id
    client.app.state.resources.keys._known = None  # as after two seconds
    response = client.post("/v1/jobs", json=problem(1), headers=sent)
    assert (response.status_code, code(response)) == (429, "storage_limit")
    assert response.headers["retry-after"] == "3600"
    assert client.get(f"/v1/solutions/{solution}/trajectory", headers=sent).status_code == 200


def test_what_is_stored_is_limited_by_the_installation_if_not_by_the_key(url, database):
    key, text = KeyStore(database).create(Role.SUBMIT, limits=KeyLimits())
    with database.write() as session:
        charge(session.connection(), key.id, 2 * 10**6)
    for megabytes, status in ((2, 429), (3, 202)):
        with served(url, max_stored_mb=megabytes) as client:
            assert client.post("/v1/jobs", json=STATE, headers=header(text)).status_code == status


@pytest.mark.parametrize(
    ("time", "pointer"),
    [
        ({"stop": 20, "samples": 11}, "/time/samples"),
        ({"times": [k / 10 for k in range(11)]}, "/time/times"),
    ],
)
def test_an_installation_may_give_fewer_samples(sqlite_url, time, pointer):
    with served(sqlite_url, max_samples=10) as client:
        response = client.post("/v1/jobs", json={**STATE, "time": time})
        assert (response.status_code, code(response)) == (422, "invalid_problem")
        (fault,) = response.json()["errors"]
        assert (fault["pointer"], fault["code"]) == (pointer, "out_of_range")
        assert "1 to 10 are accepted" in fault["message"]


def test_an_installation_may_give_fewer_samples_of_a_solution(sqlite_url):
    with served(sqlite_url, max_samples=300) as client:
        assert client.post("/v1/jobs", json=STATE).status_code == 202
        path = (
            f"/v1/solutions/{finish(client.app.state.resources.jobs).solution_id}/trajectory?stop=1&samples="
        )
        assert client.get(f"{path}300").status_code == 200
        response = client.get(f"{path}301")
    assert (response.status_code, code(response)) == (422, "invalid_request")
    assert response.json()["errors"][0]["pointer"] == "?samples"


def test_where_there_are_no_waiting_places_nobody_waits(sqlite_url):
    with served(sqlite_url, waiting_places=0) as client:
        response = client.post("/v1/jobs", json=STATE, headers={"Prefer": "wait=60"})
    assert response.status_code == 202
    assert "preference-applied" not in response.headers
