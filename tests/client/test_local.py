"""A service of one's own: started, used, and ended with the program that started it."""

import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import httpx
import pytest

import polhode as ph
from polhode.connecting import TellingCarrier, terms_of
from polhode.motions import Motion
from tests.support.waiting import wait_until

PROGRAM = """
import sys, polhode as ph
c = ph.local(workers=0)
print(c.url, flush=True)
sys.stdin.read()
"""


def answers(url: str) -> bool:
    try:
        return httpx.get(url + "/livez", timeout=60).is_success
    except (httpx.ConnectError, httpx.ReadError, httpx.RemoteProtocolError):
        return False


def test_it_ends_with_the_program_that_started_it():
    program = subprocess.Popen(
        [sys.executable, "-c", PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with program:
        url = program.stdout.readline().strip()
        assert answers(url)
        program.kill()
    wait_until(lambda: not answers(url))


def test_it_keeps_a_database_of_ones_own_and_deletes_a_temporary_one(tmp_path, base):
    database = tmp_path / "mine.db"
    with ph.local(database, workers=0) as client:
        folder = Path(client._keeper.args[4])
        job = client.submit(base).id
        assert folder.is_dir()
    assert not folder.exists()
    with closing(sqlite3.connect(database)) as kept:
        assert kept.execute("SELECT id FROM jobs WHERE state = 'queued'").fetchall() == [
            (job.replace("-", ""),)
        ]


@pytest.mark.parametrize("compiling", [None, {"done": 41, "of": 190, "seconds": 50.0, "waits": None}])
def test_that_a_faster_way_is_made_ready_is_told_once(capsys, compiling):
    answer = {"status": "ok"} | ({} if compiling is None else {"compiling": compiling})
    carrier = TellingCarrier(terms_of("http://127.0.0.1", cache=False))
    http = carrier.connections.of().http
    http._transport = httpx.MockTransport(lambda _: httpx.Response(200, json=answer))

    def solved(way):
        return Motion(carrier, {"provenance": {"way": way}})
        yield

    assert carrier.run(solved("compiled")).way == "compiled"
    assert capsys.readouterr().err == ""
    assert [carrier.run(solved("plain")).way for _ in range(2)] == ["plain", "plain"]
    how_far = "" if compiling is None else ", which are compiled in the background (41 of 190, about 50 s)"
    assert capsys.readouterr().err == f"polhode: solved without the fast solvers{how_far}\n"


def test_what_the_service_says_is_told_if_it_does_not_start(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(ph.PolhodeError, match="did not start"):
        ph.local(tmp_path / "no such folder" / "mine.db", workers=0)
    assert list(tmp_path.iterdir()) == []
