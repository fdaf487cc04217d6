"""What the containers run, in their order and with their settings, as processes on one Postgres."""

import json
import os
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from tests.container.test_compose import COMPOSE, EXAMPLE, OURS, interpolated
from tests.support.api import PLANAR
from tests.support.waiting import wait_until

POLHODE = str(Path(sys.executable).with_name("polhode"))


@pytest.fixture
def environment(postgres):
    """Give the containers' environment, with the tests' server and an empty database."""
    name = postgres.create_database()
    kept = {key: value for key, value in os.environ.items() if not key.startswith("POLHODE_")}
    given = {**EXAMPLE, "POSTGRES_PASSWORD": "any"}
    ours = {key: interpolated(value, given) for key, value in OURS["api"]["environment"].items()}
    yield {**kept, **EXAMPLE, **ours, "POLHODE_DATABASE_URL": postgres.url(name)}
    postgres.drop_database(name)


@pytest.fixture
def start(environment, tmp_path):
    """Start what a service of the compose file runs; stop it as its container is stopped."""
    running = []

    def begin(name, *, port=None):
        command = [str(port) if word == "8000" else word for word in OURS[name]["command"]]
        with (tmp_path / f"{name}{len(running)}.log").open("wb") as log:
            process = subprocess.Popen([POLHODE, *command], env=environment, cwd=tmp_path, stderr=log)
        running.append(process)
        return process

    yield begin
    for process in running:
        process.terminate()
    for process in running:
        try:
            process.wait(30)
        finally:
            process.kill()


def run(environment, *arguments):
    return subprocess.run(
        [POLHODE, *arguments], env=environment, capture_output=True, text=True, timeout=60, check=False
    )


def call(address, path, key=None, document=None, **headers):
    body = None if document is None else json.dumps(document).encode()
    sent = {"Content-Type": "application/json", **headers}
    if key is not None:
        sent["Authorization"] = f"Bearer {key}"
    request = urllib.request.Request(address + path, data=body, headers=sent)
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read()
    except OSError:
        return 0, b""


def test_the_first_steps_lead_to_a_solution(environment, start, tmp_path):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    assert run(environment, *OURS["migrate"]["command"]).returncode == 0
    # Without a key the API does not listen to the world.
    assert start("api", port=port).wait(60) == 2
    made = run(environment, "keys", "create", "--role", "admin", "--name", "me")
    assert made.returncode == 0
    key, address = made.stdout.strip(), f"http://127.0.0.1:{port}"
    start("api", port=port)
    for _ in range(int(interpolated(COMPOSE["services"]["worker"]["deploy"]["replicas"], EXAMPLE))):
        start("worker")
    wait_until(lambda: call(address, "/readyz")[0] == 200, 60.0)
    assert call(address, "/v1/jobs")[0] == call(address, "/metrics")[0] == 401
    status, answer = call(address, "/v1/jobs", key, PLANAR, Prefer="wait=50")
    assert (status, json.loads(answer)["state"]) == (200, "succeeded")

    def metrics():
        return call(address, "/metrics", key)[1].decode()

    wait_until(lambda: 'polhode_workers{engine="postgres"} 2.0' in metrics())
    assert 'polhode_worker_slots{engine="postgres"} 4.0' in metrics()
    wait_until(lambda: 'polhode_attempts_total{outcome="succeeded"} 1.0' in metrics())
    for log in tmp_path.glob("worker*.log"):
        for line in log.read_text().splitlines():
            json.loads(line)
