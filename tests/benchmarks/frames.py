"""A sweep from POST to a pandas frame by the Python client, beside raw Arrow over HTTP.

``python -m tests.benchmarks.frames [--points 100000] [--repeats 5]``; at most 1.3 times are asked.
"""

import argparse
import statistics
import tempfile
import time
import urllib.request
from pathlib import Path

import polhode as ph
from tests.benchmarks.measuring import circumstances, say
from tests.support.serving import Service, serving

POINTS, REPEATS, WORKERS = 100_000, 5, 2
ASKED = 1.3
ENDS = "7/10", "7/5"
POLL_SECONDS = 0.02
ARROW = "application/vnd.apache.arrow.stream"
KEEP = ["period", "energy", "error"]
BASE = ph.problem(
    body=(2, 1), potential="a*g1 + b/g3^2", a=-1, b="1/50", lam=1, periods=1, samples=20, tolerance=1e-9
)


def main() -> None:
    """Measure both ways in turns, each time with points of its own, and print medians and their ratio."""
    options = argparse.ArgumentParser(prog="python -m tests.benchmarks.frames")
    options.add_argument("--points", type=int, default=POINTS)
    options.add_argument("--repeats", type=int, default=REPEATS)
    given = options.parse_args()
    for line in circumstances():
        say(line)
    raw, framed = [], []
    settings = {"POLHODE_LOG_LEVEL": "warning"}
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(Path(folder), workers=WORKERS, **settings) as running,
        ph.connect(running.address, cache=False, progress=False) as client,
    ):
        # What is compiled, imported and proved once.
        by_hand(running, given.points, 0)
        by_client(client, given.points, 1)
        for k in range(given.repeats):
            raw.append(by_hand(running, given.points, 2 * k + 2))
            framed.append(by_client(client, given.points, 2 * k + 3))
    ratio = statistics.median(framed) / statistics.median(raw)
    say(f"{given.points:,} points, from POST to the last byte or to the frame; {given.repeats} runs each")
    for name, seconds in (("raw Arrow over HTTP", raw), ("frame of the client", framed)):
        said = ", ".join(f"{each:.2f}" for each in seconds)
        say(f"{name:22}{statistics.median(seconds):8.2f} s   ({said})")
    say(f"ratio {ratio:.2f}, asked at most {ASKED}{'' if ratio <= ASKED else ': missed'}")


def by_hand(running: Service, points: int, seed: int) -> float:
    """Return the seconds of POST, waiting and the bytes of all points."""
    axis = {"pointer": "/motion/lambda", "uniform": [*ENDS, points], "seed": seed}
    began = time.perf_counter()
    submitted = running.call("POST", "/v1/sweeps", {"base": BASE, "axes": [axis], "keep": KEEP})
    path = f"/v1/sweeps/{submitted.document['id']}"
    while running.call("GET", path).document["state"] in ("queued", "running"):
        time.sleep(POLL_SECONDS)
    request = urllib.request.Request(f"{running.address}{path}/points", headers={"Accept": ARROW})
    with urllib.request.urlopen(request, timeout=120) as answer:
        content = answer.read()
    seconds = time.perf_counter() - began
    assert len(content) > 8 * len(KEEP) * points, len(content)
    return seconds


def by_client(client: ph.Client, points: int, seed: int) -> float:
    """Return the seconds from the arguments of the sweep to its frame."""
    began = time.perf_counter()
    frame = client.sweep(BASE, lam=ph.uniform(*ENDS, points, seed=seed), keep=KEEP).frame()
    seconds = time.perf_counter() - began
    assert frame.shape == (points, len(KEEP) + 3), frame.shape
    assert (frame.outcome == "solved").all()
    return seconds


if __name__ == "__main__":
    main()
