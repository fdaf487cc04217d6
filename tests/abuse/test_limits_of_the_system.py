"""A limit of processes or of memory that leaves no room to start is one plain line."""

import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from service.sandbox import lack_of_room
from tests.support.databases import copy_of

POLHODE = Path(sys.executable).with_name("polhode")
UNUSED = "61734"
"""A user who has no process, so that nobody else's are counted."""
AS_SOMEBODY = (
    *("setpriv", "--clear-groups", f"--reuid={UNUSED}", "--ambient-caps=+dac_override"),
    *("--inh-caps=-all,+dac_override", "--bounding-set=-all,+dac_override"),
)
"""Root is not limited. Somebody else who may read the files of root is."""


@pytest.mark.parametrize("command", [["serve", "--port", "0"], ["worker"]], ids=["serve", "worker"])
@pytest.mark.parametrize(
    ("limit", "most", "said"),
    [
        (resource.RLIMIT_NPROC, 12, "the limit of 12 processes and threads (ulimit -u) is too low: "),
        (resource.RLIMIT_AS, 600 * 10**6, "the limit of 600 MB of address space (ulimit -v) is too low: "),
    ],
    ids=["processes", "memory"],
)
def test_a_limit_that_is_too_low_is_told_in_one_line(tmp_path, sqlite_template, command, limit, most, said):
    begins_with = ()
    if limit == resource.RLIMIT_NPROC and os.geteuid() == 0:
        if shutil.which("setpriv") is None:
            pytest.skip("root is not limited, and cannot become somebody else here")
        begins_with = AS_SOMEBODY
    ended = subprocess.run(
        [*begins_with, POLHODE, *command],
        preexec_fn=lambda: resource.setrlimit(limit, (most, most)),
        env={**os.environ, "POLHODE_DATABASE_URL": copy_of(sqlite_template, tmp_path)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert (ended.returncode, ended.stdout) == (1, "")
    assert ended.stderr.startswith(said)
    assert ended.stderr.count("\n") == 1


def test_there_is_room_without_limits_and_with_those_that_suffice(monkeypatch):
    limits = {resource.RLIMIT_NPROC: resource.RLIM_INFINITY, resource.RLIMIT_AS: resource.RLIM_INFINITY}
    monkeypatch.setattr("service.sandbox.resource.getrlimit", lambda which: (limits[which], 0))
    monkeypatch.setattr("service.sandbox.os.geteuid", lambda: 1000)
    assert lack_of_room(tasks=10**6, megabytes=10**6) is None
    limits |= {resource.RLIMIT_NPROC: 50, resource.RLIMIT_AS: 10**9}
    assert lack_of_room(tasks=50, megabytes=1000) is None
    assert "ulimit -u" in lack_of_room(tasks=51, megabytes=1000)
    assert "ulimit -v" in lack_of_room(tasks=50, megabytes=1001)
    monkeypatch.setattr("service.sandbox.os.geteuid", lambda: 0)
    assert lack_of_room(tasks=51, megabytes=1000) is None
