"""Asking again is free: each GET has a strong tag, and 304 exactly when nothing has changed."""

import json
import re

import pytest

from service.api.keys.access import ACCESS
from service.api.replies import (
    IMMUTABLE,
    NO_STORE,
    REVALIDATE,
    VOLATILE,
)
from service.api.tagged import TAGGED
from service.cache import Cache
from service.jobs.keys import Role
from service.schemas.reading.documents import Annotation
from service.storage.database.database import Database
from service.storage.jobs.job_store import JobStore
from service.storage.keys import KeyStore
from service.storage.solutions.result_store import ResultStore
from service.storage.solutions.solution_store import SolutionStore
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.upkeep.retention import delete_solution, prune_samples
from tests.support.api import NEEDED_QUERY, PLANAR, ask_again, solve_job
from tests.support.keys import make
from tests.support.sweeps import SWEEP, finish_sweep
from workers.process.tasks import draw_atlas, study

pytestmark = pytest.mark.any_database

STRONG = re.compile(r'"[0-9a-f]{32}(-gzip|-zstd)?"')
CERTIFIED = {
    **PLANAR,
    "time": {"stop": 1, "samples": 3},
    "accuracy": {"tier": "certified"},
}
UNKNOWN = "01a1fcba-3232-7921-abd1-05ca72abad77"
ATLAS = {
    "body": {"A": 2, "C": 1},
    "potential": {"type": "expression", "expression": "-g1"},
    "lambda": [1, 2],
    "samples": 9,
}
STUDY = {
    "body": {"A": 2, "B": 2, "C": 1},
    "potential": {"type": "expression", "expression": "g1"},
    "function": "(p^2 - q^2 - g1)^2 + (2*p*q - g2)^2",
}
ARRAYS = ("dense", "samples", "samples_if_kept")


@pytest.fixture
def places(client, jobs):
    """A path of every route that GET has, for things that exist; streams of events are never the same."""
    certified = solve_job(client, jobs, CERTIFIED)
    sweep = client.post("/v1/sweeps", json=SWEEP).json()
    finish_sweep(jobs)
    audit = client.post(f"/v1/solutions/{certified['id']}/audits").json()
    jobs.cancel(audit["id"])
    atlas = client.post("/v1/atlases", json=ATLAS, headers={"Prefer": "respond-async"}).json()
    assert jobs.finish(jobs.claim("test", lease_seconds=60.0), draw_atlas(json.dumps(ATLAS)))[0]
    asked = client.post("/v1/integrals", json=STUDY, headers={"Prefer": "respond-async"}).json()
    claim = jobs.claim("test", lease_seconds=60.0)
    assert jobs.finish(claim, study(json.dumps(claim.payload)))[0]
    ids = {
        "audit_id": audit["id"],
        "atlas_id": atlas["id"],
        "job_id": certified["job"],
        "solution_id": certified["id"],
        "sweep_id": sweep["id"],
        "digest": "0" * 64,
        "version": "x",
        "name": "core.js",
    }
    return {
        path: path.format(**ids | ({"job_id": asked["id"]} if path.endswith("/result") else {}))
        + NEEDED_QUERY.get(path, "")
        for path, roles in ACCESS.items()
        if "GET" in roles and not path.endswith("/events")
    }


def test_every_get_answers_304_to_its_own_tag_and_to_no_other(client, places):
    for template, path in places.items():
        answer = client.get(path)
        assert answer.status_code == 200, path
        if template in VOLATILE:
            assert answer.headers["cache-control"] == NO_STORE
            assert "etag" not in answer.headers
            continue
        assert STRONG.fullmatch(answer.headers["etag"]), path
        again = ask_again(client, path, answer)
        assert (again.status_code, again.content) == (304, b""), path
        for name in ("etag", "cache-control", "vary"):
            assert again.headers.get(name) == answer.headers.get(name), (path, name)
        assert client.get(path, headers={"If-None-Match": "*"}).status_code == 304
        other = client.get(path, headers={"If-None-Match": '"another", W/"one"'})
        assert (other.status_code, other.content) == (200, answer.content), path


def test_every_get_has_a_head_with_the_same_headers_and_no_body(client, places):
    for template, path in places.items():
        answer, head = client.get(path), client.head(path)
        assert (head.status_code, head.content) == (200, b""), path
        if template not in VOLATILE:
            changing = {"x-request-id", "content-length", "date"}
            assert set(head.headers) - changing == set(answer.headers) - changing, path
            assert head.headers["etag"] == answer.headers["etag"], path
    missing = client.head("/v1/jobs/none")
    assert (missing.status_code, missing.content) == (404, b"")


def test_every_path_says_its_methods(client, places):
    for template, path in {**places, "/v1/validations": "/v1/validations"}.items():
        allowed = set(ACCESS[template]) | {"OPTIONS"} | ({"HEAD"} if "GET" in ACCESS[template] else set())
        told = client.options(path)
        assert (told.status_code, told.content) == (204, b"")
        assert set(told.headers["allow"].split(", ")) == allowed, path
        refused = client.request("TRACE", path)
        assert refused.status_code == 405
        assert set(refused.headers["allow"].split(", ")) == allowed, path
    assert client.options("/v1/nothing").status_code == 404


def test_what_never_changes_is_kept_and_what_may_change_is_asked_for(client, places, jobs):
    endings = ("/trajectory", "/function", "/enclosures", "/points", "/grid", "/citation", "/package")
    endings += ("/v1/atlases/{atlas_id}", "/result")
    immutable = {path for path in places if path.endswith(endings)}
    assert len(immutable) == 9
    for template, path in places.items():
        if template not in VOLATILE and not template.startswith("/docs"):
            expected = IMMUTABLE if template in immutable else REVALIDATE
            assert client.get(path).headers["cache-control"] == expected, path
    missing = client.get("/v1/jobs/none")
    assert (missing.status_code, missing.headers["cache-control"]) == (404, NO_STORE)
    assert "etag" not in missing.headers


def shut(monkeypatch):
    """Let whoever reads documents or arrays fail."""
    monkeypatch.setattr(Cache, "get", lambda self, key: None)  # as in a service just started
    for store, names in (
        (SolutionStore, (*ARRAYS, "get")),
        (SweepStore, ("get", "chunks", "data")),
        (ResultStore, ("get",)),
        (JobStore, ("get",)),  # with the answer of a study
    ):
        for name in names:
            monkeypatch.setattr(store, name, None)
    monkeypatch.setattr("service.api.routes.audits.origin_of", None)


def test_304_reads_no_arrays(client, places, monkeypatch):
    paths = {places[template] for template in TAGGED}
    for template, tagged in TAGGED.items():
        if len(tagged.formats) > 1 and "atlases" not in template:  # they know no ?format
            sign = "&" if "?" in places[template] else "?"
            paths |= {f"{places[template]}{sign}format={name}" for name in tagged.formats}
    paths |= {f"{places['/v1/solutions/{solution_id}/trajectory']}?stop=1&samples=5&columns=t,g1"}
    answers = {path: client.get(path) for path in paths}
    shut(monkeypatch)
    for path, answer in answers.items():
        assert answer.status_code == 200, path
        again = ask_again(client, path, answer)
        assert (again.status_code, again.content) == (304, b""), path
        assert client.get(path).status_code == 500, path


def test_what_would_be_refused_is_refused_although_a_tag_is_sent(client, places):
    for template, tagged in TAGGED.items():
        path = places[template]
        answer = client.get(path)
        missing = re.sub(r"\{\w+_id\}", UNKNOWN, template)
        wrong = f"{path}{'&' if '?' in path else '?'}"
        cases = [
            (missing + NEEDED_QUERY.get(template, ""), {}, 404),
            (missing.replace(UNKNOWN, "x") + NEEDED_QUERY.get(template, ""), {}, 404),
            (f"{wrong}nonsense=1", {}, 422),
            (
                f"{missing}?nonsense=1",
                {},
                422 if "sweep" not in template or template.endswith("age") else 404,
            ),
        ]
        if len(tagged.formats) > 1:
            cases += [
                (path, {"Accept": "image/png"}, 406),
                (f"{wrong}format=png", {}, 422),
                (f"{wrong}format=json&format=json", {}, 422),
            ]
        for asked, headers, status in cases:
            first = client.get(asked, headers=headers)
            again = ask_again(client, asked, answer, **headers)
            assert (first.status_code, again.status_code) == (status, status), asked
            assert first.json() | {"request_id": None} == again.json() | {"request_id": None}, asked


def test_without_a_key_nobody_is_told_that_nothing_has_changed(client, places, database, app):
    path = places["/v1/solutions/{solution_id}/trajectory"]
    answer = client.get(path)
    key, own = make(database, Role.READ)
    app.state.resources.keys._known = None  # as two seconds later
    assert ask_again(client, path, answer).status_code == 401
    assert ask_again(client, path, answer, **own).status_code == 304
    KeyStore(database).revoke(key.prefix)
    app.state.resources.keys._known = None
    assert ask_again(client, path, answer, **own).status_code == 401


def test_304_sees_what_another_process_has_changed(client, stored, database, solutions):
    summary = f"/v1/solutions/{stored.solution_id}"
    paths = [summary, f"{summary}/trajectory", f"{summary}/function"]

    def ask():
        return {path: client.get(path) for path in paths}

    def again(answers):
        return [ask_again(client, path, answer).status_code for path, answer in answers.items()]

    answers = ask()
    assert again(answers) == again(answers) == [304, 304, 304]
    solutions.annotate(stored.solution_id, lambda solution: Annotation({"project": "thesis"}))
    assert again(answers) == [200, 304, 304]
    answers = ask()
    assert again(answers) == [304, 304, 304]
    assert prune_samples(database, older_than_seconds=-60.0).solutions == 1
    assert again(answers) == [304, 200, 200]
    answers = ask()
    assert again(answers) == [304, 304, 304]
    delete_solution(database, stored.solution_id)
    assert again(answers) == [404, 404, 404]


def test_while_nobody_commits_304_reads_no_row(client, stored, monkeypatch, url):
    path = f"/v1/solutions/{stored.solution_id}/trajectory"
    answer = client.get(path)
    assert ask_again(client, path, answer).status_code == 304
    monkeypatch.setattr(Database, "read_rows", None)  # whoever opens a transaction, fails
    assert ask_again(client, path, answer).status_code == (304 if "sqlite" in url else 500)
