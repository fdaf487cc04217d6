"""``polhode keys``, and what ``polhode serve`` wants of them."""

import json
import os
import subprocess
import sys
import urllib.error
import urllib.request
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from typer.testing import CliRunner

from service.cli.commands import app
from service.cli.database import seconds_of
from service.jobs.keys import key_prefix
from tests.support.waiting import PATIENCE

pytestmark = pytest.mark.any_database

POLHODE = Path(sys.executable).with_name("polhode")


@pytest.fixture
def polhode(url, monkeypatch):
    """Run the command line in this process; other settings than the database's are those of nobody."""
    for name in [name for name in os.environ if name.startswith("POLHODE_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("POLHODE_DATABASE_URL", url)
    return lambda *arguments: CliRunner().invoke(app, arguments)


@pytest.fixture
def listed(polhode):
    return lambda: json.loads(polhode("keys", "list", "--json").stdout)


def made(polhode, *options: str) -> str:
    result = polhode("keys", "create", *options)
    assert result.exit_code == 0, result.stderr
    return result.stdout.removesuffix("\n")


def test_a_key_is_shown_once_and_alone_on_stdout(polhode):
    text = made(polhode, "--role", "submit", "--name", "bench")
    prefix = key_prefix(text)
    assert prefix is not None
    for shown in (polhode("keys", "list"), polhode("keys", "list", "--json")):
        assert prefix in shown.stdout
        assert text[13:] not in shown.output


def test_the_list_tells_everything_but_the_secret(polhode, listed):
    text = made(
        polhode, "--role", "operate", "--name", "night runs", "--expires", "90d",
        "--requests-per-second", "2.5", "--queued-jobs", "100", "--stored-megabytes", "7",
    )  # fmt: skip
    (key,) = listed()
    created, expires = (datetime.fromisoformat(key.pop(name)) for name in ("created_at", "expires_at"))
    assert expires - created == timedelta(days=90)
    assert key == {
        "prefix": key_prefix(text),
        "role": "operate",
        "state": "live",
        "name": "night runs",
        "revoked_at": None,
        "last_used_at": None,
        "requests_per_second": 2.5,
        "max_queued_jobs": 100,
        "max_stored_bytes": 7_000_000,
        "stored_bytes": 0,
    }
    header, row = polhode("keys", "list").stdout.splitlines()
    assert header.split()[:3] == ["PREFIX", "ROLE", "STATE"]
    assert row.split()[:3] == [key["prefix"], "operate", "live"]
    assert row.endswith("night runs")


def test_a_key_is_revoked_by_its_prefix_or_by_itself(polhode, listed):
    texts = [made(polhode, "--role", "read") for _ in range(2)]
    for name in (key_prefix(texts[0]), texts[1]):
        result = polhode("keys", "revoke", name)
        assert result.exit_code == 0
        assert texts[1][13:] not in result.output
    assert [key["state"] for key in listed()] == ["revoked", "revoked"]


def test_revoking_what_is_not_there_is_a_failure_with_a_reason(polhode):
    result = polhode("keys", "revoke", "plh_00000000")
    assert (result.exit_code, result.stdout) == (1, "")
    assert "there is no key plh_00000000" in result.stderr


@pytest.mark.parametrize(
    "options",
    [
        [],
        ["--role", "root"],
        ["--role", "read", "--expires", "soon"],
        ["--role", "read", "--expires", "0d"],
        ["--role", "read", "--requests-per-second", "0"],
        ["--role", "read", "--queued-jobs", "-1"],
        ["--role", "read", "--name", "x" * 129],
        ["--role", "read", "--name", "two\nlines"],
    ],
)
def test_wrong_usage_makes_no_key(polhode, listed, options):
    assert polhode("keys", "create", *options).exit_code == 2
    assert listed() == []


@pytest.mark.parametrize(("text", "seconds"), [("90d", 7_776_000), ("12h", 43_200), ("30m", 1800)])
def test_spans_are_days_hours_and_minutes(text, seconds):
    assert seconds_of(text) == seconds


def test_other_machines_are_served_by_a_live_key_alone(polhode):
    polhode("keys", "revoke", key_prefix(made(polhode, "--role", "admin")))
    result = polhode("serve", "--host", "0.0.0.0", "--port", "0")
    assert result.exit_code == 2
    assert "polhode keys create" in result.stderr


def status(address: str, **headers: str) -> int:
    try:
        with urllib.request.urlopen(
            urllib.request.Request(address, headers=headers), timeout=PATIENCE
        ) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        with error:
            return error.code


def test_with_a_key_the_service_listens_to_other_machines_and_asks_them_for_it(polhode, url, tmp_path):
    text = made(polhode, "--role", "read")
    process = subprocess.Popen(
        [POLHODE, "serve", "--host", "0.0.0.0", "--port", "0", "--workers", "0"],
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "POLHODE_DATABASE_URL": url, "POLHODE_LOG_FORMAT": "text"},
    )
    try:
        assert process.stderr is not None
        port = process.stderr.readline().split()[1].rstrip(",").rpartition(":")[2]
        address = f"http://127.0.0.1:{port}"
        assert status(f"{address}/livez") == 200
        assert status(f"{address}/v1/jobs") == 401
        assert status(f"{address}/v1/jobs", Authorization=f"Bearer {text}") == 200
    finally:
        process.terminate()
        _, said = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0
    assert text[13:] not in said
