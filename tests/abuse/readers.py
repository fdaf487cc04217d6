"""Clients that ask for much and read nothing, and what the others notice of them.

``python -m tests.abuse.readers [NAME ...]`` prints a table of the attacks: how long others wait, in the
median and at the 99th percentile, and the memory of the API. The tests use its parts, and assert no time.
"""

import argparse
import json
import os
import socket
import tempfile
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from service.storage.database.migration import migrate
from tests.benchmarks.measuring import say
from tests.support.api import PLANAR
from tests.support.databases import url_of
from tests.support.serving import Service, serving
from tests.support.sweeps import store_points

MB = 1e6


@dataclass(frozen=True)
class Attack:
    """So many clients that ask for one thing at the same time and read nothing of the answer."""

    path: str
    """With {solution}, {sweep} and {samples}."""
    clients: int
    accept_encoding: str = "identity"


TRAJECTORY = "/v1/solutions/{solution}/trajectory?stop=1000&samples={samples}"
ATTACKS = {
    "trajectories as CSV": Attack(f"{TRAJECTORY}&format=csv", 60),
    "many trajectories as CSV": Attack(f"{TRAJECTORY}&format=csv", 150),
    "trajectories as JSON, gzip": Attack(TRAJECTORY, 60, "gzip"),
    "points as NPZ": Attack("/v1/sweeps/{sweep}/points?format=npz", 60),
    "sorted points": Attack("/v1/sweeps/{sweep}/points?order=-period&limit=1", 60),
    "statistics of points": Attack("/v1/sweeps/{sweep}/points/statistics?of=period", 60),
    "packages": Attack("/v1/sweeps/{sweep}/package", 60),
    "lists with conditions": Attack("/v1/solutions?where=period<5&order=-energy", 150),
    "a static file": Attack("{static}", 1000),
    "/openapi.json": Attack("/openapi.json", 1000),
    "a file of /docs": Attack("/docs/swagger-ui-bundle.js", 1000),
}


def memory_of(process: int) -> int:
    """Return the bytes that a process has in memory."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def processor_seconds(process: int) -> float:
    """Return the processor time that a process has used."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@contextmanager
def mute_clients(service: Service, path: str, number: int, **headers: str) -> Iterator[list[socket.socket]]:
    """Send a GET by each of so many connections, and read nothing."""
    port = int(service.address.rpartition(":")[2])
    sent = {"Host": "127.0.0.1", **{name.replace("_", "-"): value for name, value in headers.items()}}
    head = f"GET {path} HTTP/1.1\r\n" + "".join(f"{name}: {value}\r\n" for name, value in sent.items())
    sockets: list[socket.socket] = []
    try:
        for _ in range(number):
            client = socket.socket()
            # A small window: what the kernel buffers is not read by the client either.
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
            client.settimeout(30)
            with suppress(OSError):
                client.connect(("127.0.0.1", port))
                client.sendall(f"{head}\r\n".encode())
            sockets.append(client)
        yield sockets
    finally:
        for client in sockets:
            client.close()


@dataclass
class Others:
    """Clients that go on with what they do; how long each of their requests takes."""

    service: Service
    seconds: dict[str, list[float]] = field(default_factory=dict)
    refused: int = 0
    peak: int = 0
    _is_over: threading.Event = field(default_factory=threading.Event)
    _threads: list[threading.Thread] = field(default_factory=list)

    def start(self) -> None:
        for name, pause, ask in (
            ("livez", 0.05, lambda _: self._get("/livez")),
            ("jobs", 0.1, lambda _: self._get("/v1/jobs")),
            ("solve", 0.3, self._solve),
        ):
            self.seconds[name] = []
            self._threads.append(threading.Thread(target=self._repeat, args=(name, pause, ask)))
        self._threads.append(threading.Thread(target=self._watch))
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        self._is_over.set()
        for thread in self._threads:
            thread.join()

    def cells(self) -> Iterator[str]:
        """Yield the median and the 99th percentile of each kind of request, in seconds, and their number."""
        for seconds in self.seconds.values():
            middle, late = np.quantile(seconds or [np.nan], [0.5, 0.99])
            yield f"{middle:.3f}, {late:.3f} ({len(seconds)})"

    def _repeat(self, name: str, pause: float, ask: Callable[[int], None]) -> None:
        number = 0
        while not self._is_over.wait(pause):
            began, number = time.monotonic(), number + 1
            ask(number)
            self.seconds[name].append(time.monotonic() - began)

    def _get(self, path: str, **further: object) -> None:
        request = urllib.request.Request(self.service.address + path, **further)  # type: ignore[arg-type]
        try:
            with urllib.request.urlopen(request, timeout=120) as answer:
                answer.read()
        except urllib.error.HTTPError as error:
            self.refused += 1
            error.close()

    def _solve(self, number: int) -> None:
        problem = {
            **PLANAR,
            "motion": {"type": "planar", "lambda": 1 + number * 1e-7},  # like no other
        }
        headers = {"Content-Type": "application/json", "Prefer": "wait=60"}
        self._get("/v1/jobs", data=json.dumps(problem).encode(), headers=headers, method="POST")

    def _watch(self) -> None:
        while not self._is_over.wait(0.1):
            self.peak = max(self.peak, memory_of(self.service.process.pid))


def paths(service: Service, sweep_id: str, samples: int = 100_000) -> dict[str, str]:
    """Return what the paths of attacks name: a solution, its samples, a sweep, the largest static file."""
    job = service.call("POST", "/v1/jobs", PLANAR, Prefer="wait=60").document
    with urllib.request.urlopen(service.address + "/sweep") as page:
        text = page.read().decode()
    start = text.index("static/page/")
    version = text[start:].split("/")[2]
    return {
        "solution": job["solution"],
        "samples": str(samples),
        "sweep": sweep_id,
        "static": f"/static/page/{version}/plotly.min.js",
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", choices=[[], *ATTACKS])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--after", type=float, default=30.0)
    asked = parser.parse_args()
    columns = "attack", "/livez", "GET /v1/jobs", "submit and wait", "503"
    columns += "MB idle, most, after", "s of work after", "load"
    say(f"| {' | '.join(columns)} |\n|{' --- |' * len(columns)}")
    for name in asked.names or ATTACKS:
        attack = ATTACKS[name]
        with tempfile.TemporaryDirectory() as there:
            url = url_of(Path(there) / "polhode.db")
            migrate(url)
            sweep_id = store_points(url, 600_000)
            settings = {"POLHODE_DATABASE_URL": url, "POLHODE_MAX_CONNECTIONS": "1100"}
            with serving(Path(there), workers=1, **settings) as service:
                path = attack.path.format(**paths(service, sweep_id))
                pid = service.process.pid
                idle, others = memory_of(pid), Others(service)
                headers = {"Accept_Encoding": attack.accept_encoding}
                with mute_clients(service, path, attack.clients, **headers):
                    others.start()
                    time.sleep(asked.seconds)
                    others.stop()
                    load = os.getloadavg()[0]
                ended = processor_seconds(pid)
                time.sleep(asked.after)
                spent = processor_seconds(pid) - ended
                memory = ", ".join(f"{each / MB:.0f}" for each in (idle, others.peak, memory_of(pid)))
                say(
                    f"| {attack.clients} clients, {name} | {' | '.join(others.cells())} | {others.refused} "
                    f"| {memory} | {spent:.1f} | {load:.0f} |"
                )


if __name__ == "__main__":
    main()
