"""What a request takes on a kept connection, beside a bare FastAPI route on the same server."""

import json
import statistics
import tempfile
import time
from pathlib import Path

from tests.benchmarks.measuring import Effort, Table, in_words
from tests.benchmarks.whole.client import Line, bare_route
from tests.support.serving import Service, serving
from tests.support.waiting import wait_until

PROBLEM = {
    "body": {"A": 2, "C": 1},
    "potential": {"type": "gravity", "a": -1},
    "time": {"periods": 1, "samples": 101},
}
WAIT = {"Prefer": "wait=60"}
WAITED_SECONDS = 15e-3
"""A request that waits for its job may take so long, or 12 times a bare route."""
ASKED = {"GET /livez": "≤ 2×", "GET /v1/solutions/{id}": "≤ 4×"}
PATIENCE = 300.0


def requests(effort: Effort) -> Table:
    """Return medians of requests that come one after the other, in turns with the bare route."""
    rounds = effort.repeats(1000)
    with (
        tempfile.TemporaryDirectory() as folder,
        bare_route() as bare_address,
        serving(Path(folder)) as service,
        Line(bare_address) as bare,
        Line(service.address) as ours,
    ):
        wait_until_warm(service)
        solution = json.loads(ours.exchange(waiting_job(ours, 0, "draft"))[1])["solution"]
        gets = {
            "GET /livez": ours.request("GET", "/livez"),
            "GET /v1/solutions/{id}": ours.request("GET", f"/v1/solutions/{solution}"),
        }
        bare_get = bare.request("GET", "/")
        times: dict[str, list[float]] = {name: [] for name in ("bare", *gets)}
        for _ in range(rounds):
            times["bare"].append(bare.seconds(bare_get))
            for name, request in gets.items():
                times[name].append(ours.seconds(request))
        number = 1
        for tier in ("draft", "standard", "high"):
            name = f"POST /v1/jobs, Prefer: wait, {tier}"
            times[name] = []
            for _ in range(max(5, rounds // 20)):
                times[name].append(ours.seconds(waiting_job(ours, number, tier)))
                number += 1
    least = statistics.median(times["bare"])
    rows = tuple(
        (
            "GET of a bare FastAPI route" if name == "bare" else name,
            in_words(median := statistics.median(taken)),
            f"{median / least:.1f}×",
            "" if name == "bare" else ASKED.get(name, f"≤ {max(12 * least, WAITED_SECONDS) / least:.0f}×"),
        )
        for name, taken in times.items()
    )
    remark = (
        f"Medians of {rounds} requests on one kept connection, by the clock, one after the other; a job "
        "that is waited for is new each time: gravity, 101 samples over a period, examined, queued, computed "
        "in a child, stored. The bare route has the same server, with its gate and deadlines, and nothing "
        "around it."
    )
    return Table("Whole requests", remark, ("request", "median", "of the bare route", "asked"), rows)


def waiting_job(line: Line, number: int, tier: str) -> bytes:
    """Return the request of a job that nobody has asked for, whose client waits."""
    motion = {"type": "planar", "lambda": f"{100_000 + number}/100000"}
    document = {**PROBLEM, "motion": motion, "accuracy": {"tier": tier}}
    return line.request("POST", "/v1/jobs", json.dumps(document).encode(), WAIT)


def wait_until_warm(service: Service) -> float:
    """Wait until the workers are warm; return the seconds."""
    began = time.monotonic()
    wait_until(lambda: service.call("GET", "/readyz").document["workers"] == "warm", PATIENCE)
    return time.monotonic() - began
