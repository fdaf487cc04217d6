"""The unit of systemd in docker/: systemd reads it, and its command runs with its environment."""

import os
import shlex
import shutil
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from service.settings import Settings
from tests.support.waiting import wait_until

UNIT = Path(__file__).parents[2] / "docker" / "polhode.service"
ANALYZE = shutil.which("systemd-analyze")
POLHODE = Path(sys.executable).with_name("polhode")


def options(text: str) -> dict[str, list[str]]:
    """Return the options of the service; some come several times."""
    found: dict[str, list[str]] = {}
    for line in text.partition("[Service]")[2].partition("[Install]")[0].splitlines():
        if line and not line.startswith("#"):
            name, _, value = line.partition("=")
            found.setdefault(name, []).append(value)
    return found


def here(tmp_path: Path) -> str:
    """Return the unit with the folders of this test."""
    text = UNIT.read_text(encoding="utf-8")
    for written, own in (
        ("/var/lib/polhode", tmp_path / "state"),
        ("/var/cache/polhode", tmp_path / "cache"),
        ("/opt/polhode/bin/polhode", POLHODE),
    ):
        assert written in text
        text = text.replace(written, str(own))
    return text


@pytest.mark.skipif(ANALYZE is None, reason="not installed: apt-get install systemd")
def test_systemd_reads_it_without_a_word_and_finds_little_exposed(tmp_path):
    unit = tmp_path / "polhode.service"
    unit.write_text(here(tmp_path), encoding="utf-8")
    assert ANALYZE is not None
    # Without the manager of this machine, of which a container has none.
    read = subprocess.run([ANALYZE, "verify", "--man=no", unit], capture_output=True, text=True)
    assert (read.returncode, read.stderr) == (0, "")
    exposed = subprocess.run(
        # 10 is without any protection; systemd calls what is below 3 OK, in tenths.
        [ANALYZE, "security", "--offline=true", "--threshold=30", unit],
        capture_output=True,
        text=True,
    )
    assert exposed.returncode == 0, exposed.stdout


def test_a_stop_gives_jobs_their_time_and_reaches_no_child():
    service = options(UNIT.read_text(encoding="utf-8"))
    assert service["KillMode"] == ["mixed"]
    assert service["OOMPolicy"] == ["continue"]
    # A service waits five seconds longer for its worker.
    assert float(service["TimeoutStopSec"][0]) > Settings.model_fields["grace_seconds"].default + 5.0
    # Kernels are compiled in memory.
    assert "MemoryDenyWriteExecute" not in service


def test_its_command_serves_with_its_environment_and_ends_in_order(tmp_path, free_port):
    service = options(here(tmp_path))
    for folder in ("state", "cache"):
        (tmp_path / folder).mkdir(mode=0o700)
    environment = dict(line.split("=", 1) for line in service["Environment"])
    assert {name for name in environment if name.startswith("POLHODE_")} <= {
        f"POLHODE_{name.upper()}" for name in Settings.model_fields
    }
    (command,) = service["ExecStart"]
    # systemd gives a service little more than this.
    given = {"PATH": os.defpath, "POLHODE_PORT": str(free_port), "POLHODE_WORKERS": "0"}
    folder = service["WorkingDirectory"][0]
    with subprocess.Popen(
        shlex.split(command), env={**environment, **given}, cwd=folder, stderr=subprocess.DEVNULL
    ) as process:

        def answers() -> bool:
            assert process.poll() is None
            try:
                with urllib.request.urlopen(f"http://127.0.0.1:{free_port}/readyz", timeout=5) as answer:
                    return answer.status == 200
            except OSError:
                return False

        wait_until(answers)
        process.terminate()
        # Systemd counts an end by SIGTERM that it asked for as a success.
        assert process.wait(timeout=60) in (0, -15)
    assert (tmp_path / "state" / "polhode.db").exists()


@pytest.fixture
def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
