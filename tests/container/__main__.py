"""``python -m tests.container``: build the image and run every role of ``docker/compose.yaml`` from it.

Needs root, ``buildah`` and ``debootstrap``, and no daemon. What runs has a
network of its own, where the ports of the compose file are free.
"""

import argparse
import json
import os
import secrets
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Mapping
from typing import Any

from tests.container.containers import Container, Project, project, wait_until
from tests.container.images import POLHODE, build_all
from tests.container.test_compose import EXAMPLE
from tests.support.api import PLANAR

ADDRESS = "http://127.0.0.1:8000"
INSIDE = "--inside"


def main() -> None:
    """Build, then run inside a network of its own."""
    parser = argparse.ArgumentParser(prog="python -m tests.container", description=__doc__)
    parser.add_argument("--keep-image", action="store_true", help="run the image that there is")
    parser.add_argument(INSIDE, action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.inside:
        subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
        run_roles()
        run_alone()
        return
    if not options.keep_image:
        build_all()
    again = [sys.executable, "-m", "tests.container", INSIDE]
    sys.exit(subprocess.run(["unshare", "--net", *again], check=False).returncode)


def run_roles() -> None:
    """Go the way of the compose file: Postgres, migration, a key, the API, workers, a job, the end."""
    with project(POSTGRES_PASSWORD=secrets.token_urlsafe()) as ours:
        postgres = ours.start("postgres")
        wait_until("Postgres is healthy", lambda: ours.is_healthy(postgres, "postgres"))
        migrate(ours)
        key = make_a_key(ours)
        api = ours.start("api")
        wait_until("the API is healthy", lambda: ours.is_healthy(api))
        workers = [ours.start("worker") for _ in range(int(EXAMPLE["WORKERS"]))]
        wait_until("the workers are seen", lambda: workers_seen(key) == len(workers))
        solve(key, 1)
        outlive_a_killed_worker(ours, workers, key)
        back_up(ours)
        for container in [*workers, api, postgres]:
            code = container.stop()
            assert code == 0, f"{container.log.name} ended with {code}"
            ours.running.remove(container)
        say("every container stopped in order")


def run_alone() -> None:
    """Run the image as it is, with SQLite and a worker of its own."""
    with project() as ours:
        alone = ours.start_image(POLHODE)
        wait_until("the image serves by itself", lambda: ours.is_healthy(alone))
        solve(None, 1)
        assert alone.stop() == 0
        ours.running.remove(alone)
        say("the image alone serves and solves, on SQLite")


def migrate(ours: Project) -> None:
    code, written = ours.run("migrate")
    assert code == 0, written
    code, written = ours.run("api")
    assert code == 2, "without a key the API must not listen to the world"
    assert "polhode keys create" in written
    say("migrated; without a key the API refuses to start")


def make_a_key(ours: Project) -> str:
    code, written = ours.run("api", "keys", "create", "--role", "admin", "--name", "me")
    assert code == 0, written
    return next(line for line in written.splitlines() if line.startswith("plh_"))


def solve(key: str | None, mass: int) -> None:
    problem = {**PLANAR, "potential": {"type": "gravity", "a": -mass, "b": 0, "c": 0}}
    job = call("/v1/jobs", key, problem, Prefer="wait=120")
    assert job["state"] == "succeeded", job
    solution = call(f"/v1/solutions/{job['solution']}", key)
    assert solution["error"] <= 1e-10
    say(f"solved: period {solution['period']['value']}")


def outlive_a_killed_worker(ours: Project, workers: list[Container], key: str) -> None:
    jobs = [
        call("/v1/jobs", key, {**PLANAR, "potential": {"type": "gravity", "a": -mass, "b": 0, "c": 0}})
        for mass in range(2, 22)
    ]
    killed = workers.pop(0)
    killed.kill()
    ours.running.remove(killed)
    workers.append(ours.start("worker"))  # "restart: unless-stopped"

    def is_done(job: Mapping[str, Any]) -> bool:
        return call(f"/v1/jobs/{job['id']}", key)["state"] == "succeeded"

    for job in jobs:
        wait_until("every job has succeeded", lambda job=job: is_done(job))
    say(f"{len(jobs)} jobs outlived a killed worker")


def back_up(ours: Project) -> None:
    code, written = ours.run("api", "backup", "/var/cache/polhode/backup")
    assert code == 0, written
    code, written = ours.run("api", "doctor", "--sample", "1")
    assert code == 0, written
    say("backed up by pg_dump, and the doctor found nothing")


def workers_seen(key: str) -> int:
    for line in text("/metrics", key).splitlines():
        if line.startswith("polhode_workers{"):
            return int(float(line.rpartition(" ")[2]))
    return 0


def call(path: str, key: str | None, document: object = None, **headers: str):
    return json.loads(text(path, key, document, **headers))


def text(path: str, key: str | None, document: object = None, **headers: str) -> str:
    body = None if document is None else json.dumps(document).encode()
    sent = {"Content-Type": "application/json", **headers}
    if key is not None:
        sent["Authorization"] = f"Bearer {key}"
    request = urllib.request.Request(ADDRESS + path, data=body, headers=sent)
    try:
        with urllib.request.urlopen(request, timeout=150) as answer:
            return str(answer.read().decode())
    except urllib.error.HTTPError as error:
        with error:
            raise AssertionError(f"{path}: {error.code} {error.read().decode()}") from error


def say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    assert os.geteuid() == 0, "containers without a daemon need root here"
    main()
