"""While the database is away or full, every answer is "come again", nothing is lost, and then all goes on."""

import json
import re
import sqlite3
import time
from functools import partial
from pathlib import Path

import psycopg
import pytest
from sqlalchemy import Engine, create_engine, event, exc, make_url, text

from service.api.keys.access import ACCESS
from service.app import create_app
from service.dashboard.routes import PAGES
from service.jobs.records import JobState
from service.sandbox import Sandbox
from service.settings import Settings
from service.storage.database.availability import is_away
from service.storage.database.database import Database
from service.storage.database.rows import new_id
from service.storage.jobs.job_store import JobStore
from tests.support.api import NEEDED_QUERY, STATE, TestClient
from tests.support.lists import list_jobs
from tests.support.waiting import wait_until
from tests.workers.chores import CHORES
from workers.process.pool import ChildrenPool
from workers.process.results import JobLimits
from workers.process.runner import Runner

EXAMPLES = Path(__file__).parents[3] / "examples"
GRAVITY = {"body": {"A": 2, "B": 2, "C": 1}, "potential": {"type": "expression", "expression": "g1"}}
# The route says what is asked, the file of a command does.
SEARCH = json.loads((EXAMPLES / "search.json").read_text(encoding="utf-8"))
del SEARCH["what"]
STUDIES = {
    "integrals": {**GRAVITY, "function": "p"},
    "integrals/searches": {**GRAVITY, "degree": {"omega": 1, "gamma": 1}},
    "potentials/searches": {"body": {"A": 2, "C": 1}, "degree": 1},
    "searches": SEARCH,
}
BODIES = {
    "/v1/jobs": STATE,
    "/v1/validations": {"body": {"A": 2, "C": 1}, "potential": {"type": "gravity", "a": -1}},
    "/v1/atlases": json.loads((EXAMPLES / "atlas.json").read_text(encoding="utf-8")),
    **{f"/v1/{path}": example for path, example in STUDIES.items()},
    "/v1/sweeps": json.loads((EXAMPLES / "sweep.json").read_text(encoding="utf-8")),
}
ROUTES = [(method, path) for path, roles in ACCESS.items() for method in roles if method != "HEAD"]
PATHS_WITHOUT = {"/livez", "/openapi.json", "/v1/families", "/v1/validations", *PAGES}
PATHS_WITHOUT |= {path for _, path in ROUTES if path.startswith(("/docs", "/static/page/"))}
# To draw an atlas, or to answer a study, at once needs none; the list of those that jobs draw does.
AT_ONCE = {("POST", f"/v1/{path}") for path in ("atlases", *STUDIES) if path != "searches"}
WITHOUT_DATABASE = {route for route in ROUTES if route[1] in PATHS_WITHOUT} | AT_ONCE
LIMITS = JobLimits(lease_seconds=60.0, job_seconds=60.0, memory_mb=500, max_attempts=3, retry_seconds=0.1)


def ask(client, method, path):
    body = BODIES.get(path) if method == "POST" else {"note": None} if method == "PATCH" else None
    place = re.sub("{.*?}", new_id(), path.replace("{name}", "core.js"))
    return client.request(method, place + NEEDED_QUERY.get(path, ""), json=body)


def come_again(response):
    assert response.status_code == 503, (response.status_code, response.text)
    assert response.json()["type"] == "urn:polhode:problem:unavailable"
    assert int(response.headers["retry-after"]) > 0


class Outage:
    """Takes the database from under a running service, and gives it back."""

    def __init__(self, url):
        self._url = make_url(url)
        self._is_sqlite = self._url.get_backend_name() == "sqlite"

    def begin(self, engine: Engine) -> None:
        if self._is_sqlite:
            engine.dispose()
            self._folder.rename(self._elsewhere)
        else:
            self._allow("false")
            name = self._url.database
            self._execute(f"SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = '{name}'")

    def end(self) -> None:
        if self._is_sqlite:
            self._elsewhere.rename(self._folder)
        else:
            self._allow("true")

    @property
    def _folder(self):
        return Path(self._url.database).parent

    @property
    def _elsewhere(self):
        return self._folder.with_name("elsewhere")

    def _allow(self, word):
        self._execute(f"ALTER DATABASE {self._url.database} ALLOW_CONNECTIONS {word}")

    def _execute(self, statement):
        server = create_engine(self._url.set(database="postgres"), isolation_level="AUTOCOMMIT")
        with server.connect() as connection:
            connection.execute(text(statement))
        server.dispose()


def engine_of(app) -> Engine:
    return app.state.resources.database.engine


def test_an_outage_is_one_line_of_the_log_however_many_ask(url, app, client, caplog):
    outage = Outage(url)
    outage.begin(engine_of(app))
    try:
        for _ in range(20):
            come_again(client.get("/v1/jobs"))
    finally:
        outage.end()
    (line,) = [record for record in caplog.records if record.name.endswith("error_handlers")]
    assert line.getMessage().startswith("unavailable: OperationalError")
    assert line.exc_info is not None


def test_every_route_asks_to_come_again_while_the_database_is_away(url, app, client, monkeypatch):
    assert client.post("/v1/jobs", json=STATE).status_code == 202
    # Whether there are keys is known for two seconds, which a busy machine may need for all the routes.
    ring, now = app.state.resources.keys, time.monotonic()
    monkeypatch.setattr(ring, "_clock", lambda: now)
    outage = Outage(url)
    outage.begin(engine_of(app))
    try:
        answers = {(method, path): ask(client, method, path) for method, path in ROUTES}
    finally:
        outage.end()
    for (method, path), answer in answers.items():
        if path == "/readyz":
            assert (answer.status_code, answer.json()["type"].rpartition(":")[2]) == (503, "not_ready")
        elif path == "/metrics":
            # It tells of this process what there is to tell.
            assert answer.status_code == 200
        elif (method, path) in WITHOUT_DATABASE:
            assert answer.status_code == 200, (method, path, answer.text)
        else:
            come_again(answer)
    # As it was before, at once or after the broken connections have been noticed.
    wait_until(lambda: client.get("/v1/jobs").status_code == 200)
    assert client.get("/v1/jobs").json()["total"] == 1


def test_a_locked_database_is_waited_for_and_read_meanwhile(sqlite_url):
    app = create_app(Settings(database_url=f"{sqlite_url}?timeout=0.1"))
    with TestClient(app, raise_server_exceptions=False) as client:
        job = client.post("/v1/jobs", json=STATE).json()
        holder = sqlite3.connect(make_url(sqlite_url).database, isolation_level=None)
        holder.execute("BEGIN EXCLUSIVE")
        come_again(client.post("/v1/jobs", json=STATE))
        come_again(client.post(f"/v1/jobs/{job['id']}/cancel"))
        assert client.get(f"/v1/jobs/{job['id']}").json() == job
        assert client.get("/v1/solutions").status_code == 200
        holder.execute("COMMIT")
        holder.close()
        assert client.post(f"/v1/jobs/{job['id']}/cancel").json()["state"] == "cancelled"


def limit_pages(engine: Engine, pages: int | None) -> None:
    """Let the disk be full as soon as the file has so many pages; None: there is room again."""

    def configure(connection, _):
        connection.execute(f"PRAGMA max_page_count = {pages or 1_000_000}")

    event.listen(engine, "connect", configure)
    engine.dispose()


def page_count(engine: Engine) -> int:
    with engine.connect() as connection:
        return connection.execute(text("PRAGMA page_count")).scalar_one()


def test_a_full_disk_refuses_what_must_be_stored_and_serves_what_is(sqlite_url):
    app = create_app(Settings(database_url=sqlite_url))
    with TestClient(app, raise_server_exceptions=False) as client:
        job = client.post("/v1/jobs", json=STATE).json()
        limit_pages(engine_of(app), page_count(engine_of(app)))
        problems = [{**STATE, "time": {"stop": 20 + n, "samples": 201}} for n in range(100)]
        answers = [client.post("/v1/jobs", json=problem) for problem in problems]
        stored = [answer for answer in answers if answer.status_code == 202]
        # There is some room in the pages that are there; then there is none.
        assert len(stored) < 100
        for answer in answers[len(stored) :]:
            come_again(answer)
        assert client.get(f"/v1/jobs/{job['id']}").json() == job
        assert client.get("/v1/jobs").json()["total"] == 1 + len(stored)
        limit_pages(engine_of(app), None)
        assert client.post("/v1/jobs", json=problems[-1]).status_code == 202


def test_a_worker_keeps_its_result_until_there_is_room_for_it(sqlite_url):
    database = Database(sqlite_url)
    jobs, sandbox = JobStore(database), Sandbox(1, preload=["tests.workers.chores"])
    runner = Runner(jobs, ChildrenPool(sandbox, CHORES, slots=1), name="worker", limits=LIMITS)
    collect = partial(runner.collect, refill=True)
    try:
        job = jobs.submit({"number": 1, "padding": "x" * 10_000}, "digest")
        runner.fill()
        # Its solution has a copy of the problem: there is no room for that.
        limit_pages(database.engine, page_count(database.engine))
        wait_until(lambda: is_away_at(collect))
        assert is_away_at(collect)
        assert (jobs.get(job.id).state, runner.is_busy) == (JobState.RUNNING, True)
        limit_pages(database.engine, None)
        assert collect() == [job.id]
        done = jobs.get(job.id)
        assert (done.state, done.attempt, runner.is_busy) == (JobState.SUCCEEDED, 1, False)
    finally:
        sandbox.close()
        database.close()


def is_away_at(act) -> bool:
    try:
        act()
    except exc.SQLAlchemyError as error:
        return is_away(error)
    return False


def test_a_worker_keeps_its_result_until_the_database_is_back(url):
    database = Database(url)
    jobs, sandbox = JobStore(database), Sandbox(1, preload=["tests.workers.chores"])
    runner = Runner(jobs, ChildrenPool(sandbox, CHORES, slots=1), name="worker", limits=LIMITS)
    collect = partial(runner.collect, refill=True)
    outage = Outage(url)
    try:
        submitted = jobs.submit({"chore": "sleep", "seconds": 0.2}, "digest")
        runner.fill()
        outage.begin(database.engine)
        try:
            wait_until(lambda: is_away_at(collect))
            assert is_away_at(collect)
        finally:
            outage.end()
        # Connections that were broken are noticed one by one.
        wait_until(lambda: not is_away_at(lambda: list_jobs(jobs)))
        assert collect() == [submitted.id]
        done = jobs.get(submitted.id)
        assert (done.state, done.attempt) == (JobState.SUCCEEDED, 1)
    finally:
        sandbox.close()
        database.close()


def test_a_postgres_that_has_become_read_only_is_away_for_writers(postgres_url):
    database = Database(postgres_url)
    name = make_url(postgres_url).database
    with database.engine.connect() as connection:
        connection.execute(text(f"ALTER DATABASE {name} SET default_transaction_read_only = on"))
        connection.commit()
    database.engine.dispose()
    jobs = JobStore(database)
    with pytest.raises(exc.SQLAlchemyError) as refused:
        jobs.submit(STATE, "digest")
    assert is_away(refused.value)
    assert list_jobs(jobs).total == 0
    database.close()


def wrapped(kind, original):
    return kind("SELECT 1", {}, original)


def with_state(state):
    return psycopg.errors.lookup(state)("said the server")


def sqlite_error(*statements):
    connection = sqlite3.connect(":memory:", isolation_level=None)
    *before, last = ("CREATE TABLE t (n INTEGER CHECK (n > 0))", *statements)
    for statement in before:
        connection.execute(statement)
    with pytest.raises(sqlite3.Error) as raised:
        connection.execute(last)
    connection.close()
    return raised.value


@pytest.mark.parametrize(
    "error",
    [
        wrapped(exc.OperationalError, psycopg.OperationalError("connection refused")),
        *(
            wrapped(exc.OperationalError, with_state(state))
            for state in (
                "53100",
                "53200",
                "53300",
                "57P01",
                "57P02",
                "57P03",
                "08006",
                "40001",
                "40P01",
                "58030",
            )
        ),
        wrapped(exc.InternalError, with_state("25006")),
        exc.InterfaceError("SELECT 1", {}, psycopg.InterfaceError("closed"), connection_invalidated=True),
        exc.TimeoutError("QueuePool limit reached"),
        exc.PendingRollbackError("the transaction was invalidated"),
        wrapped(exc.OperationalError, sqlite_error("PRAGMA query_only = ON", "INSERT INTO t VALUES (1)")),
        psycopg.OperationalError("not by way of SQLAlchemy"),
    ],
    ids=lambda error: f"{type(error).__name__} {getattr(getattr(error, 'orig', None), 'sqlstate', '')}",
)
def test_what_passes_by_itself_is_away(error):
    assert is_away(error)


@pytest.mark.parametrize(
    "error",
    [
        wrapped(exc.ProgrammingError, with_state("42601")),
        wrapped(exc.IntegrityError, with_state("23505")),
        wrapped(exc.DataError, with_state("22003")),
        wrapped(exc.InterfaceError, psycopg.InterfaceError("the cursor is closed")),
        wrapped(exc.IntegrityError, sqlite_error("INSERT INTO t VALUES (0)")),
        wrapped(exc.OperationalError, sqlite_error("SELECT nothing")),
        exc.StatementError("no JSON", "INSERT", {}, ValueError("NaN")),
        ValueError("a fault of ours"),
    ],
    ids=lambda error: f"{type(error).__name__} {getattr(getattr(error, 'orig', None), 'sqlstate', '')}",
)
def test_a_fault_that_would_repeat_itself_is_not(error):
    assert not is_away(error)
