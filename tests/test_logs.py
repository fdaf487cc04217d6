"""Logs: one JSON object a line, with what it is about and without secrets."""

import json
import logging
import os
import subprocess
import sys
import threading
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from service.app import create_app
from service.local.workers import worker_environment
from service.logs import about, call_about, current_logging, mask, start_logging
from service.sandbox import Sandbox
from service.settings import Settings
from service.storage.database.database import Database
from service.storage.jobs.job_store import JobStore
from tests.support.api import TestClient
from tests.support.waiting import PATIENCE, wait_until

TOP = Path(__file__).parents[1]
KEY = "plh_abcd1234_" + "0aZ" * 14 + "9"
ID = "0198c0de-0000-7000-8000-000000000000"


@pytest.fixture
def restored():
    """Put the process's logging back as it was."""
    root = logging.getLogger()
    names = ("service", "workers")
    before = root.handlers[:], root.level, [logging.getLogger(name).level for name in names]
    hooks = sys.excepthook, threading.excepthook
    yield
    root.handlers[:], root.level = before[:2]
    for name, level in zip(names, before[2], strict=True):
        logging.getLogger(name).setLevel(level)
    sys.excepthook, threading.excepthook = hooks
    logging.captureWarnings(False)


@pytest.fixture
def lines(restored, capsys):
    """Log as JSON at the level info; return what has been written since the last call."""
    start_logging("json", "info")
    return lambda: [json.loads(line) for line in capsys.readouterr().err.splitlines()]


logger = logging.getLogger("service.test")


def test_a_record_is_one_object_on_one_line(lines):
    before = datetime.now(UTC)
    logger.info("two\nlines of %s", "text")
    after = datetime.now(UTC)
    (line,) = lines()
    assert list(line) == ["time", "level", "logger", "message"]
    assert (line["level"], line["logger"], line["message"]) == ("info", "service.test", "two\nlines of text")
    assert line["time"].endswith("Z")
    # Written in whole milliseconds.
    assert before - timedelta(milliseconds=1) <= datetime.fromisoformat(line["time"]) <= after


def test_what_it_is_about_is_said_once(lines):
    with about(job="j1", attempt=2):
        logger.info("a")
        with about(attempt=3, worker="w"):
            logger.info("b", extra={"fields": {"seconds": 0.5}})
    logger.info("c")
    a, b, c = ({k: v for k, v in line.items() if k not in ("time", "level", "logger")} for line in lines())
    assert a == {"message": "a", "job": "j1", "attempt": 2}
    assert b == {"message": "b", "job": "j1", "attempt": 3, "worker": "w", "seconds": 0.5}
    assert c == {"message": "c"}


def test_an_exception_is_a_field(lines):
    try:
        raise ValueError("bad thing")
    except ValueError:
        logger.exception("failed")
    (line,) = lines()
    assert line["level"] == "error"
    assert line["exception"].startswith("Traceback")
    assert line["exception"].endswith("ValueError: bad thing")


def test_half_a_surrogate_pair_can_be_logged(lines):
    record = logger.makeRecord(logger.name, logging.ERROR, "", 0, "bad \ud800 thing", (), None)
    # To our handler alone: reports of tests, which keep what is logged, are sent as UTF-8.
    (ours,) = (each for each in logging.getLogger().handlers if type(each).__module__ == "service.logs")
    ours.handle(record)
    assert [line["message"] for line in lines()] == ["bad \ud800 thing"]


def test_the_level_holds_for_ours_and_libraries_only_warn(lines):
    logger.debug("no")
    logging.getLogger("sqlalchemy.engine").info("no")
    logging.getLogger("alembic").warning("yes")
    assert [line["message"] for line in lines()] == ["yes"]


@pytest.mark.parametrize(
    ("said", "written"),
    [
        ("postgresql+psycopg://me:s3cr:et@db:5432/x?a=b", "postgresql+psycopg://me:***@db:5432/x?a=b"),
        ("sqlite:////var/lib/polhode.db", "sqlite:////var/lib/polhode.db"),
        (f"Authorization: Bearer {KEY}", "Authorization: Bearer plh_abcd1234_***"),
        (f"'{KEY}' is no id", "'plh_abcd1234_***' is no id"),
        ("bearer of.another_kind", "bearer ***"),
    ],
)
def test_passwords_and_keys_are_masked_wherever_they_come_from(said, written, lines):
    assert mask(said) == written
    with about(job=said):
        try:
            raise RuntimeError(said)
        except RuntimeError:
            logger.exception("%s", said)
    (line,) = lines()
    assert line["message"] == line["job"] == written
    assert line["exception"].endswith(f"RuntimeError: {written}")


def test_text_is_for_people(restored, capsys):
    start_logging("text", "warning")
    with about(job="j1"):
        logger.warning("slow: %s", f"x://u:p@h {KEY}")
        logger.info("no")
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("WARNING service.test: slow: x://u:***@h plh_abcd1234_*** job=j1")


def test_json_is_the_choice_where_nobody_sits_at_a_terminal(restored):
    assert start_logging(None, "info").format == "json"


def log_in_child():
    logger.warning("from the child")
    how = current_logging()
    return None if how is None else (how.format, how.level)


def test_children_log_as_their_parent_does_and_about_the_same(restored, capfd):
    start_logging("json", "error")
    sandbox = Sandbox(1)
    try:
        told = sandbox.run(call_about, {"job": "j1"}, log_in_child, seconds=PATIENCE)
        start_logging("json", "info")
        told_later = sandbox.run(call_about, {"job": "j1"}, log_in_child, seconds=PATIENCE)
    finally:
        sandbox.close()
    assert told == told_later == ("json", "error")
    assert capfd.readouterr().err == ""


def test_warnings_and_what_nobody_catches_are_records_too():
    code = (
        "import threading, warnings\n"
        "from service.logs import start_logging\n"
        "start_logging(None, 'info')\n"
        "warnings.warn('odd')\n"
        "thread = threading.Thread(target=lambda: 1 / 0, name='keeper')\n"
        "thread.start(); thread.join()\n"
        "raise RuntimeError('postgresql://me:secret@db/x')\n"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert result.returncode == 1
    warned, thread, ended = (json.loads(line) for line in result.stderr.splitlines())
    assert warned["logger"] == "py.warnings"
    assert (thread["level"], thread["message"]) == ("critical", "the thread keeper ends")
    assert thread["exception"].endswith("ZeroDivisionError: division by zero")
    assert ended["message"] == "the process ends: RuntimeError"
    assert ended["exception"].endswith("postgresql://me:***@db/x")


@pytest.fixture
def request_lines(sqlite_url, lines):
    """Ask the application, and return the answer with what was logged."""
    with TestClient(create_app(Settings(database_url=sqlite_url)), raise_server_exceptions=False) as client:
        lines()

        def ask(path, **headers):
            answer = client.get(path, headers={name.replace("_", "-"): v for name, v in headers.items()})
            return answer, lines()

        yield ask


def test_a_request_keeps_its_id_from_end_to_end(request_lines):
    answer, (line,) = request_lines(f"/v1/jobs/{ID}", X_Request_ID="trace:7f.A-1")
    assert answer.headers["x-request-id"] == answer.json()["request_id"] == "trace:7f.A-1"
    assert line["message"] == "request"
    assert line["request_id"] == "trace:7f.A-1"
    assert (line["method"], line["path"], line["status"]) == ("GET", f"/v1/jobs/{ID}", 404)
    assert line["seconds"] > 0


@pytest.mark.parametrize("sent", ["", "a b", "x" * 129, "né", 'a"}{"b'])
def test_an_id_that_is_not_sane_is_replaced(request_lines, sent):
    answer, (line,) = request_lines("/v1/accuracy", X_Request_ID=sent.encode())
    assert answer.status_code == 200
    assert answer.headers["x-request-id"] == line["request_id"]
    assert line["request_id"] not in ("", sent)


def test_ids_that_are_made_differ(request_lines):
    ids = {request_lines("/v1/accuracy")[0].headers["x-request-id"] for _ in range(3)}
    assert len(ids) == 3


def test_a_fault_of_ours_can_be_found_in_the_log(request_lines, monkeypatch):
    monkeypatch.setattr("service.api.routes.installation.json_response", lambda _: 1 / 0)
    answer, logged = request_lines("/livez", X_Request_ID="abc")
    assert answer.status_code == 500
    assert answer.headers["x-request-id"] == answer.json()["request_id"] == "abc"
    (error,) = [line for line in logged if line["level"] == "error"]
    assert error["request_id"] == "abc"
    assert error["exception"].endswith("ZeroDivisionError: division by zero")


def test_a_worker_and_its_children_say_which_job_they_speak_of(sqlite_url):
    database = Database(sqlite_url)
    jobs = JobStore(database)
    job = jobs.submit({"x": 1}, "digest")
    command = [sys.executable, "-c", "from tests.support.complaining import run; run()"]
    environment = {**os.environ, "POLHODE_DATABASE_URL": sqlite_url}
    worker = subprocess.Popen(command, cwd=TOP, env=environment, stderr=subprocess.PIPE, text=True)
    try:
        wait_until(lambda: jobs.get(job.id).is_finished)
    finally:
        worker.terminate()
        written = worker.communicate(timeout=PATIENCE)[1]
        database.close()
    started, warned, failed = (json.loads(line) for line in written.splitlines())
    assert warned["message"].endswith('UserWarning: odd\n  warnings.warn("odd", stacklevel=1)\n')
    assert failed["exception"].endswith("RuntimeError: a fault of ours")
    for line in (warned, failed):
        assert (line["job"], line["attempt"], line["worker"]) == (job.id, 1, started["worker"])


def test_what_machines_ask_all_the_time_is_not_logged(request_lines):
    for path in ("/livez", "/metrics"):
        assert request_lines(path)[1] == []


def test_the_url_of_the_database_goes_to_workers_by_the_environment_with_how_to_log():
    told = worker_environment(Settings(database_url="sqlite:///x.db", log_format="json", log_level="debug"))
    names = ("POLHODE_DATABASE_URL", "POLHODE_LOG_FORMAT", "POLHODE_LOG_LEVEL")
    assert [told[name] for name in names] == ["sqlite:///x.db", "json", "debug"]
    unset = worker_environment(Settings(log_format=None, log_level=None))
    assert unset.get("POLHODE_LOG_LEVEL") == os.environ.get("POLHODE_LOG_LEVEL")
