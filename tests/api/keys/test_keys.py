import asyncio
import logging

import pytest
from fastapi import APIRouter, FastAPI
from fastapi.routing import iter_route_contexts
from sqlalchemy import select
from sqlalchemy.exc import TimeoutError as PoolTimeoutError

from service.api.keys.access import (
    ACCESS,
    FRESH_SECONDS,
    OPEN,
    SECOND_LOOK_SECONDS,
    KeyRing,
    MissingRoleError,
    check_roles,
)
from service.api.replies import TITLES
from service.jobs.keys import KeyStanding, Role
from service.settings import Settings
from service.storage.database.database import Database
from service.storage.keys import KeyStore
from tests.support.api import PLANAR, STATE, TestClient, create_app, finish
from tests.support.keys import Clock, header, make

pytestmark = pytest.mark.any_database

QUESTION = {name: PLANAR[name] for name in ("body", "potential")}
UNKNOWN = "01a1fcba-3232-7921-abd1-05ca72abad77"


def endpoints(app: FastAPI) -> set[tuple[str, str]]:
    """Method and path of everything that the application's router would answer."""
    return {
        (method, route.path)
        for route in iter_route_contexts(app.routes)
        for method in getattr(route, "methods", None) or ()
    }


def asked(path: str) -> str:
    for name in ("job_id", "solution_id", "sweep_id", "audit_id", "atlas_id", "digest"):
        path = path.replace(f"{{{name}}}", UNKNOWN)
    path = path.replace("{version}", "x").replace("{name}", "core.js")
    assert "{" not in path, f"say here what to ask {path} with"
    return path


def code(response) -> str:
    document = response.json()
    assert response.headers["content-type"] == "application/problem+json"
    found = document["type"].removeprefix("urn:polhode:problem:")
    assert document["status"] == response.status_code
    assert document["title"] == TITLES[found]
    return found


@pytest.fixture
def ring(client, app: FastAPI) -> KeyRing:
    return app.state.resources.keys


@pytest.fixture
def clock(ring, monkeypatch) -> Clock:
    """Make the running service's clock stand still, its keys forgotten."""
    clock = Clock()
    monkeypatch.setattr(ring, "_clock", clock)
    monkeypatch.setattr(ring, "_known", None)
    return clock


def test_every_endpoint_has_a_role_and_every_role_an_endpoint(app: FastAPI):
    table = {(method, path) for path, roles in ACCESS.items() for method in roles}
    assert len(table) > 15
    assert endpoints(app) == table


def test_an_endpoint_without_a_role_keeps_the_application_from_starting():
    router = APIRouter()
    router.add_api_route("/v1/forgotten", lambda: None, methods=["DELETE"])
    with pytest.raises(MissingRoleError, match="DELETE /v1/forgotten"):
        check_roles([router])


@pytest.mark.parametrize("with_keys", [False, True])
def test_an_endpoint_that_slipped_past_the_table_is_not_served(app: FastAPI, client, database, with_keys):
    app.add_api_route("/v1/forgotten", lambda: "secret")
    sent = make(database, Role.ADMIN)[1] if with_keys else {}
    response = client.get("/v1/forgotten", headers=sent)
    assert (response.status_code, code(response)) == (404, "not_found")


def test_every_endpoint_is_open_to_its_roles_and_to_nobody_else(app: FastAPI, database, client):
    sent = {role: make(database, role)[1] for role in Role}
    app.state.resources.events.stop()  # else the events of the installation would go on
    for method, path in sorted(endpoints(app)):
        needed = ACCESS[path][method]
        for role in Role:
            response = client.request(method, asked(path), headers=sent[role])
            is_refused = needed is not OPEN and not role.may(needed)
            assert (response.status_code == 403) is is_refused, (method, path, role, response.text)
            assert response.status_code not in (401, 429, 500), (method, path, role, response.text)
            if is_refused and method != "HEAD":
                assert code(response) == "role_insufficient"
                assert response.json()["needed_role"] == needed
                assert f"role {needed}" in response.json()["detail"]


def test_no_endpoint_is_open_without_a_good_key(app: FastAPI, database, client):
    store = KeyStore(database)
    _, good = store.create(Role.ADMIN)
    _, expired = store.create(Role.ADMIN, seconds=-1.0)
    revoked, revoked_text = store.create(Role.ADMIN)
    store.revoke(revoked.prefix)
    bad = {
        "key_missing": [{}, {"Authorization": f"Basic {good}"}, {"Authorization": "Bearer"}, {"X-Key": good}],
        "key_unknown": [
            header("secret"),
            header(good[:-1]),
            header(good + "a"),
            header(good[:13] + "x" * 43),
            header("plh_00000000" + good[12:]),
            header(good.swapcase()),
        ],
        "key_expired": [header(expired)],
        "key_revoked": [header(revoked_text)],
    }
    for method, path in sorted(endpoints(app)):
        for expected, headers in bad.items():
            for sent in headers:
                response = client.request(method, asked(path), headers=sent)
                if ACCESS[path][method] is OPEN:
                    assert response.status_code == 200
                    continue
                assert response.status_code == 401, (method, path, sent, response.text)
                assert response.headers["www-authenticate"].startswith('Bearer realm="polhode"')
                if method != "HEAD":
                    assert code(response) == expected
    assert client.get("/v1/jobs", headers=header(good)).status_code == 200


def test_a_scraper_reads_metrics_only_and_a_reader_gets_verdicts(client, database):
    scraper, reader = (make(database, role)[1] for role in (Role.METRICS, Role.READ))
    assert client.get("/metrics", headers=scraper).status_code == 200
    verdict = client.post("/v1/validations", json=QUESTION, headers=reader)
    assert (verdict.status_code, verdict.json()["verdict"]) == (200, "admissible"), verdict.text
    for method, path in (("GET", "/v1/jobs"), ("GET", "/v1/status"), ("POST", "/v1/validations")):
        response = client.request(method, path, headers=scraper)
        assert (response.status_code, response.json()["needed_role"]) == (403, "read")


@pytest.mark.parametrize(
    ("method", "path"), [("GET", "/v1/nothing"), ("DELETE", "/v1/jobs"), ("GET", "/v1/jobs/")]
)
def test_what_there_is_is_only_told_to_those_with_a_key(client, database, method, path):
    sent = make(database, Role.READ)[1]
    assert client.request(method, path, headers=sent).status_code in (404, 405)
    assert client.request(method, path).status_code == 401


def test_the_scheme_is_read_as_its_rfc_says(client, database):
    sent = make(database, Role.READ)[1]["Authorization"].removeprefix("Bearer ")
    for value in (f"bearer {sent}", f"BEARER   {sent} "):
        assert client.get("/v1/jobs", headers={"Authorization": value}).status_code == 200


def test_without_any_key_everything_is_open(client):
    assert client.post("/v1/jobs", json=STATE).status_code == 202
    assert client.get("/metrics").status_code == 200
    assert client.get("/v1/jobs", headers=header("plh_00000000_" + "x" * 43)).status_code == 200


def test_without_any_key_other_machines_are_told_to_bring_one(sqlite_url):
    app = create_app(Settings(database_url=sqlite_url, host="0.0.0.0"))
    with TestClient(app) as client:
        assert client.get("/livez").status_code == 200
        assert code(client.get("/v1/jobs")) == "key_missing"


def test_a_key_that_is_not_good_any_more_still_closes_the_service(client, database):
    key, sent = make(database, Role.READ)
    KeyStore(database).revoke(key.prefix)
    assert code(client.get("/v1/jobs", headers=sent)) == "key_revoked"
    assert code(client.get("/v1/jobs")) == "key_missing"


def test_a_running_service_hears_of_the_first_key_and_of_a_revocation_soon(client, clock, database):
    assert client.get("/v1/jobs").status_code == 200
    key, sent = make(database, Role.READ)
    clock.now += FRESH_SECONDS + 0.1
    assert code(client.get("/v1/jobs")) == "key_missing"
    assert client.get("/v1/jobs", headers=sent).status_code == 200
    KeyStore(database).revoke(key.prefix)
    clock.now += FRESH_SECONDS + 0.1
    assert code(client.get("/v1/jobs", headers=sent)) == "key_revoked"


def test_a_new_key_among_others_is_good_almost_at_once(client, clock, database):
    client.get("/v1/jobs", headers=make(database, Role.READ)[1])
    sent = make(database, Role.READ)[1]
    clock.now += SECOND_LOOK_SECONDS + 0.1
    assert client.get("/v1/jobs", headers=sent).status_code == 200


def test_a_key_expires_while_the_service_goes_on_with_what_it_has_read(database):
    key, _ = KeyStore(database).create(Role.READ, seconds=3600.0)
    clock = Clock()
    ring = KeyRing(KeyStore(database), clock)
    known = asyncio.run(ring.known())
    assert known.keys[key.prefix].standing(ring.now(known)) is KeyStanding.LIVE
    clock.now += 3601.0
    assert known.keys[key.prefix].standing(ring.now(known)) is KeyStanding.EXPIRED
    ring.close()


def test_however_many_unknown_keys_come_the_database_is_asked_now_and_then(database):
    reads = []

    class Counted(KeyStore):
        def all(self):
            reads.append(1)
            return super().all()

    clock = Clock()
    ring = KeyRing(Counted(database), clock)

    async def flood() -> None:
        for _ in range(1000):
            await ring.known()
            await ring.known(SECOND_LOOK_SECONDS)
            clock.now += 0.001

    asyncio.run(flood())
    ring.close()
    # One second at one read in SECOND_LOOK_SECONDS, the first one and the rounding of sums of 0.001.
    assert len(reads) <= 1 / SECOND_LOOK_SECONDS + 2


def test_the_use_of_a_key_is_noted(client, ring, database):
    key, sent = make(database, Role.READ)
    assert client.get("/v1/jobs", headers=sent).status_code == 200
    ring.close()
    assert KeyStore(database).all().keys[0].last_used_at >= key.created_at


def test_requests_do_not_fail_where_the_use_cannot_be_noted(sqlite_url, caplog):
    database = Database(sqlite_url)
    key, sent = make(database, Role.READ)
    # The writer waits for so long, and gives up.
    with TestClient(create_app(Settings(database_url=f"{sqlite_url}?timeout=0.05"))) as client:
        with database.write() as session:
            session.execute(select(1))  # now it has the lock
            assert client.get("/v1/jobs", headers=sent).status_code == 200
            client.app.state.resources.keys.close()
        assert client.get("/v1/jobs", headers=sent).status_code == 200
    assert KeyStore(database).all().keys[0].last_used_at is None
    database.close()
    assert f"the last use of key {key.prefix} could not be recorded" in caplog.text
    assert sent["Authorization"][-43:] not in caplog.text


def test_a_database_that_cannot_be_read_lets_nobody_in(client, clock, ring, monkeypatch):
    def fail():
        raise PoolTimeoutError("no connection")

    monkeypatch.setattr(ring._store, "all", fail)
    response = client.get("/v1/families")
    assert (response.status_code, code(response)) == (503, "unavailable")
    assert response.headers["retry-after"] == "5"
    assert client.get("/livez").status_code == 200


def test_keys_are_neither_logged_nor_repeated(client, database, caplog):
    caplog.set_level(logging.DEBUG)
    _, good = make(database, Role.READ)
    bad = header(good["Authorization"][7:20] + "y" * 43)
    said = [
        client.request(method, path, headers=sent)
        for sent in (good, bad)
        for method, path in [("GET", "/v1/jobs"), ("POST", "/v1/jobs"), ("GET", "/v1/nothing")]
    ]
    text = caplog.text + "".join(response.text + str(response.headers) for response in said)
    for sent in (good, bad):
        assert sent["Authorization"][-43:] not in text


def test_everybody_may_read_what_anybody_had_computed(client, jobs, database):
    mine, other = make(database, Role.SUBMIT)[1], make(database, Role.READ)[1]
    job = client.post("/v1/jobs", json=STATE, headers=mine).json()
    stored = finish(jobs)
    for path in (f"/v1/jobs/{job['id']}", f"/v1/solutions/{stored.solution_id}/trajectory"):
        assert client.get(path, headers=other).status_code == 200


@pytest.mark.parametrize(("role", "status"), [(Role.SUBMIT, 403), (Role.OPERATE, 200), (Role.ADMIN, 200)])
def test_the_jobs_of_others_are_cancelled_by_operators_alone(client, database, role, status):
    (key, mine), (_, other) = make(database, Role.SUBMIT), make(database, role)
    path = f"/v1/jobs/{client.post('/v1/jobs', json=STATE, headers=mine).json()['id']}"
    response = client.post(f"{path}/cancel", headers=other)
    assert response.status_code == status
    if status == 403:
        assert response.json()["needed_role"] == "operate"
        assert client.get(path, headers=mine).json()["state"] == "queued"
    assert client.post(f"{path}/cancel", headers=mine).json()["state"] == "cancelled"
    assert client.app.state.resources.jobs.get(path.rpartition("/")[2]).key_id == key.id


def test_what_was_submitted_before_there_were_keys_is_nobodys_own(client, jobs, database):
    job = client.post("/v1/jobs", json=STATE).json()
    assert jobs.get(job["id"]).key_id is None
    for role, status in ((Role.SUBMIT, 403), (Role.OPERATE, 200)):
        sent = make(database, role)[1]
        client.app.state.resources.keys._known = None
        assert client.post(f"/v1/jobs/{job['id']}/cancel", headers=sent).status_code == status


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.1:8000", "localhost:9", "[::1]:8000", "127.8.9.1"])
def test_without_keys_this_machine_is_answered_by_its_own_names(client, host):
    assert client.get("/v1/jobs", headers={"Host": host}).status_code == 200


@pytest.mark.parametrize("host", ["evil.example:8000", "127.0.0.1.evil.example", "10.0.0.1", "", "[", "a]:b"])
def test_a_name_that_was_made_to_lead_here_is_refused_unless_there_are_keys(client, database, clock, host):
    refused = client.get("/v1/jobs", headers={"Host": host})
    assert (refused.status_code, code(refused)) == (403, "host_not_local")
    assert client.get("/livez", headers={"Host": host}).status_code == 200
    _, key = make(database, Role.READ)
    clock.now += FRESH_SECONDS + 0.1
    assert client.get("/v1/jobs", headers={"Host": host, **key}).status_code == 200
