"""What clients send may be told in logs and on terminals; it forges no line and controls no terminal."""

import json
import logging
import sys
import threading
import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from service.app import create_app
from service.cli.commands import app
from service.jobs.keys import Role
from service.logs import about, announce, one_line, printable, start_logging
from service.settings import Settings
from service.storage.database.database import Database
from service.storage.keys import KeyLimits, KeyStore
from tests.support.api import TestClient

FORGED = "2026-01-01T00:00:00.000Z ERROR service: all jobs are lost"
NASTY = [
    f"line\n{FORGED}",
    f"line\r\n{FORGED}",
    f"line\x0b{FORGED}",
    f"next line \x85{FORGED}",
    f"line separator \u2028{FORGED}",
    f"paragraph separator \u2029{FORGED}",
    "erase \x1b[2J\x1b]0;title\x07",
    "one byte of it \x9b2J",
    "backspace \x08\x08\x7f",
    "from right \u202e to left \u2066 isolated \u061c",
    "hidden \u200b\ufeff",
    "half \ud800",
]


@pytest.fixture
def restored():
    """Put the process's logging back as it was."""
    root, ours = logging.getLogger(), logging.getLogger("service")
    before = root.handlers[:], root.level, ours.level, sys.excepthook, threading.excepthook
    yield
    root.handlers[:] = before[0]
    root.setLevel(before[1])
    ours.setLevel(before[2])
    sys.excepthook, threading.excepthook = before[3:]
    logging.captureWarnings(False)


def is_harmless(character):
    return character == " " or unicodedata.category(character)[0] not in "CZ"


@given(st.text(st.characters()))
def test_one_line_is_one_line_and_controls_nothing(text):
    assert all(map(is_harmless, one_line(text)))


@given(st.text(st.characters(categories=["L", "N", "P", "S", "M"])))
def test_what_is_printed_as_it_is_stays_as_it_is(text):
    assert one_line(text) == text


@given(st.text(st.characters()))
def test_lines_of_ours_stay_lines(text):
    lines = printable(text).split("\n")
    assert lines == [one_line(line) for line in text.split("\n")]


@pytest.mark.parametrize("nasty", NASTY, ids=ascii)
def test_a_record_is_one_line_whatever_is_in_it(nasty, restored, capsys):
    start_logging("text", "info")
    with about(job=nasty):
        logging.getLogger("service.test").info("said %s", nasty, extra={"fields": {"path": nasty}})
    announce(nasty)
    record, announced = capsys.readouterr().err.removesuffix("\n").split("\n")
    assert all(map(is_harmless, record + announced))
    assert f"job={one_line(nasty)} path={one_line(nasty)}" in record
    assert announced == one_line(nasty)


def test_no_line_of_an_exception_looks_like_a_record(restored, capsys):
    start_logging("text", "info")
    try:
        raise ValueError(f"bad\n{FORGED}\x1b[2J")
    except ValueError:
        logging.getLogger("service.test").exception("failed")
    first, *below = capsys.readouterr().err.removesuffix("\n").split("\n")
    assert first.endswith("failed")
    assert below
    assert all(line.startswith("    ") for line in below)
    assert f"    {FORGED}\\x1b[2J" in below


def test_a_path_with_escapes_is_logged_in_one_line(sqlite_url, verdicts, restored, capsys):
    with TestClient(create_app(Settings(database_url=sqlite_url), sandbox=verdicts)) as client:
        start_logging("text", "info")
        assert client.get(f"/v1/%0A{FORGED.replace(' ', '%20')}%1B[2J%E2%80%A8").status_code == 404
    written = capsys.readouterr().err
    (line,) = (line for line in written.split("\n") if "all jobs are lost" in line)
    assert not line.startswith(FORGED)
    assert all(map(is_harmless, line))


def test_stored_names_do_not_reach_the_terminal_as_they_are(sqlite_url):
    database = Database(sqlite_url)
    # Our own commands refuse such a name; whoever can write to the database may have put it there.
    KeyStore(database).create(Role.READ, name="me\x1b[2J\nplh_forged", seconds=None, limits=KeyLimits())
    database.close()
    listed = CliRunner().invoke(app, ["keys", "list", "--database-url", sqlite_url])
    assert listed.stdout.count("\n") == 2
    assert "me\\x1b[2J\\nplh_forged" in listed.stdout


def test_a_document_is_quoted_without_its_controls(tmp_path):
    document = {
        "body": {"A": 2, "C": 1},
        "potential": {"type": "expression", "expression": "g1"},
        "x\x1b[2J": 1,
    }
    (tmp_path / "problem.json").write_text(json.dumps(document))
    refused = CliRunner().invoke(app, ["validate", str(tmp_path / "problem.json")])
    assert refused.exit_code == 1
    assert "\x1b" not in refused.stderr
    assert "x\\x1b[2J" in refused.stderr
