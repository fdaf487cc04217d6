"""A real service on a real disk that is full for a while. What needs no root is in tests/api."""

import contextlib
import json
import re
import subprocess
import time
from collections import Counter

import pytest

from service.logs import SECONDS_BETWEEN_LINES
from service.storage.database.database import Database
from service.storage.inspection.inspect import inspect
from tests.crash.client import problem
from tests.support.databases import url_of
from tests.support.serving import serving
from tests.support.waiting import wait_until


@pytest.fixture
def small_disk(tmp_path):
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", folder], capture_output=True)
    if mount.returncode != 0:
        pytest.skip("only root can mount a disk")
    yield folder
    # The last child of the worker may be about to end still.
    wait_until(lambda: subprocess.run(["umount", folder], capture_output=True).returncode == 0)


def lines(log):
    """Return how often something was said, whatever numbers and ids are in it."""
    entries = [json.loads(line) for line in log.read_text().splitlines() if line.startswith("{")]
    return Counter(re.sub(r"[0-9a-f-]*[0-9][0-9a-f-]*", "#", each["message"]) for each in entries)


def states(service):
    items = service.call("GET", "/v1/jobs?limit=200").document["items"]
    return Counter((job["state"], job["attempt"]) for job in items)


def test_what_is_running_is_stored_once_there_is_room_again(small_disk, tmp_path):
    log = tmp_path / "log"
    with log.open("wb") as stderr, serving(small_disk, workers=1, stderr=stderr) as service:
        service.solve(problem(1))
        # Heavy enough to be computed still when the disk is full.
        assert service.call("POST", "/v1/jobs", problem(8)).status == 202
        wait_until(lambda: states(service)["running", 1])
        ballast = small_disk / "ballast"
        with contextlib.suppress(OSError), ballast.open("wb", buffering=0) as file:
            while True:
                file.write(bytes(4096))
        began = time.monotonic()
        answers = [service.call("POST", "/v1/jobs", problem(number)) for number in range(20, 50)]
        assert {answer.status for answer in answers} <= {202, 503}
        refused = [answer for answer in answers if answer.status == 503]
        assert refused
        assert all("retry-after" in {name.lower() for name in answer.headers} for answer in refused)
        # What is stored can be read.
        assert sum(states(service).values()) == 2 + len(answers) - len(refused)
        full_seconds = time.monotonic() - began
        said = lines(log)
        # Each of these is tried again each second, or was asked for thirty times.
        assert any(text.startswith("unavailable") for text in said), said
        assert max(said.values()) <= 2 + full_seconds / SECONDS_BETWEEN_LINES, said
        ballast.unlink()
        assert service.call("POST", "/v1/jobs", problem(30)).status == 202
        wait_until(lambda: set(states(service)) == {("succeeded", 1)}, 60.0)
    database = Database(url_of(small_disk / "polhode.db"))
    assert [finding.code for finding in inspect(database) if finding.broken] == []
    database.close()
