"""Times how long ``polhode`` takes to start, for several installations side by side.

``python -m tests.benchmarks.starting POLHODE ... [--rounds N]`` runs each command in turn, so that whatever
else the machine does hits all of them alike, and prints the medians and their ratios to the first.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from statistics import median

from service.local.workers import FOLDER_VARIABLE
from tests.benchmarks.measuring import Effort, Table, in_words
from tests.support.serving import free_port

PATIENCE = 300.0
PROBLEM = {
    "body": {"A": 2, "C": 1},
    "potential": {
        "type": "expression",
        "expression": "a*g1 + b/g3^2",
        "parameters": {"a": -1, "b": "1/20"},
    },
    "motion": {"type": "planar", "lambda": 1},
    "time": {"stop": 10, "samples": 101},
    "accuracy": {"tier": "draft"},
}
STATE = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "gravity", "a": -1},
    "motion": {"type": "state", "gamma": ["0.6", "0", "0.8"], "omega": ["0", "1", "0.1"]},
    "time": {"stop": 10, "samples": 101},
}
KINDS = ("draft", "standard", "high", "certified", "integration", "sweep")
"""What is used for the first time, and again, when the workers are warm. A service that does not tell of its
workers is asked as soon as it is ready."""
_USES = ("first", "warm")
ROWS = (
    "polhode --help",
    "serve: until /readyz answers 200",
    "serve: until the first solution, draft",
    "serve: until the workers are warm",
    *(f"{which} {kind}" for kind in KINDS for which in _USES),
)


OURS = Path(sys.executable).with_name("polhode")
AGAINST: dict[str, float] = {"polhode --help": 0.5, "serve: until the first solution, draft": 0.45}
"""Shares of what another revision takes that are asked of ours."""
WARM = 2.0
"""The first use of anything, when the workers are said to be warm, may take so many times a later one."""


def starting(effort: Effort) -> Table:
    """Return how long this installation takes to start, and first uses beside later ones."""
    seconds = medians([OURS], effort.repeats(5))[0]
    rows = [(name, in_words(seconds[name]), "", "") for name in ROWS if name.split(" ")[0] not in _USES]
    for kind in KINDS:
        first, warm = (seconds[f"{use} {kind}"] for use in _USES)
        ratio = f"{first / warm:.1f}×"
        told = ratio if first <= WARM * warm else f"**{ratio}, missed**"
        rows.append((f"first use: {kind}", in_words(first), in_words(warm), told))
    remark = (
        "By the clock, medians, each round with a new database; a first use comes after `/readyz` has said "
        f"that the workers are warm, and is asked to take at most {WARM:g} times a later one."
    )
    return Table(
        "From nothing to an answer", remark, ("what", "first", "later", "first / later"), tuple(rows)
    )


def new_machine(effort: Effort) -> Table:
    """Return how long first answers take where nothing is compiled yet."""
    rows = []
    for what, (asked, seconds_once) in ON_A_NEW_MACHINE.items():
        seconds = median(seconds_once() for _ in range(effort.repeats(3)))
        told = in_words(seconds)
        rows.append((what, told if seconds <= asked else f"**{told}, missed**", f"≤ {asked:g} s"))
    remark = (
        "By the clock, medians; all is installed and nothing compiled: the plain way, beside the task that"
        " compiles. What the installation itself takes depends on the network: some 25 s of processor time."
    )
    return Table("On a new machine", remark, ("what", "seconds", "asked"), tuple(rows))


@contextmanager
def nothing_compiled() -> Iterator[dict[str, str]]:
    """Yield an environment with an empty folder for compiled code, and no cache of the client."""
    with tempfile.TemporaryDirectory() as folder:
        yield {**os.environ, FOLDER_VARIABLE: folder, "POLHODE_CACHE": f"{folder}/client"}


def seconds_of_command(*command: str) -> float:
    """Return what a command takes."""
    with nothing_compiled() as environment:
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        return seconds_of(lambda: subprocess.run(command, check=True, env=environment, **quiet))


def seconds_from_serve(kind: str) -> float:
    """Return what it takes from ``polhode serve`` to the end of the first thing of this kind."""
    with nothing_compiled() as environment, serving(OURS, environment) as (address, began):
        wait_until_ready(address)
        use(address, kind, 1)
        return time.monotonic() - began


LOCAL = """
import polhode as ph
with ph.local() as c:
    c.solve(body=(2, 1), potential="-g1 + 1/(20*g3^2)", lam=1)
"""
FIRST = Path(__file__).parents[2] / "examples" / "first.json"
ON_A_NEW_MACHINE: dict[str, tuple[float, Callable[[], float]]] = {
    **{
        f"`polhode serve` to the first solution, `{tier}`": (6.0, partial(seconds_from_serve, tier))
        for tier in KINDS[:4]
    },
    "`polhode serve` to the end of a sweep of 200 points": (15.0, partial(seconds_from_serve, "long sweep")),
    "`polhode solve`": (8.0, partial(seconds_of_command, str(OURS), "solve", str(FIRST))),
    "`ph.local()`, one `solve` and the end": (10.0, partial(seconds_of_command, sys.executable, "-c", LOCAL)),
}
"""What is asked, in seconds, and how it is measured."""


def starting_against(command: Path, effort: Effort) -> Table:
    """Return the same for another installation and this one, in turns, with what is asked of ours."""
    theirs, ours = medians([command, OURS], effort.repeats(5))
    rows = []
    for name in ROWS:
        ratio, asked = ours[name] / theirs[name], AGAINST.get(name)
        told = f"{ratio:.2f}×"
        if asked is not None and not ratio <= asked:
            told = f"**{told}, missed**"
        rows.append(
            (name, in_words(theirs[name]), in_words(ours[name]), told, f"≤ {asked}×" if asked else "")
        )
    heads = ("what", "there", "here", "here / there", "asked")
    return Table("Starts of two revisions", "By the clock, medians, in turns.", heads, tuple(rows))


def medians(commands: Sequence[Path], rounds: int) -> list[dict[str, float]]:
    """Return the median seconds of each row for each command, which are run in turns."""
    for command in commands:
        measure(command)  # not counted: Python keeps what it compiles of the modules, as an installation does
    measured = [measure(command) for _ in range(rounds) for command in commands]
    count = len(commands)
    return [
        {name: median(each[row] for each in measured[k::count]) for row, name in enumerate(ROWS)}
        for k in range(count)
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("commands", nargs="+", type=absolute, metavar="POLHODE")
    parser.add_argument("--rounds", type=int, default=5)
    asked = parser.parse_args()
    found = medians(asked.commands, asked.rounds)
    for name in ROWS:
        ratios = " ".join(f"{each[name] / found[0][name]:.2f}x" for each in found[1:])
        print(f"{name:<40}", *(f"{each[name]:8.3f} s" for each in found), ratios)  # noqa: T201


def absolute(text: str) -> Path:
    """Return the path; each run has a working folder of its own."""
    return Path(text).absolute()


def measure(command: Path) -> list[float]:
    """Return the seconds of each row, once."""
    helped = seconds_of(lambda: subprocess.run([command, "--help"], check=True, stdout=subprocess.DEVNULL))
    with serving(command, os.environ) as (address, began):
        wait_until_ready(address)
        ready = time.monotonic() - began
        use(address, "draft", 0)
        solved = time.monotonic() - began
        while state_of_workers(address) == "starting":
            time.sleep(0.02)
        warm = time.monotonic() - began
        uses = []
        for kind in KINDS:
            first, *later = (seconds_of(lambda k=k: use(address, kind, k)) for k in range(1, 5))  # noqa: B023
            uses += [first, median(later)]
    return [helped, ready, solved, warm, *uses]


@contextmanager
def serving(command: Path, environment: Mapping[str, str]) -> Iterator[tuple[str, float]]:
    """Yield the address of a service with a new database, and when it was started."""
    port = free_port()
    with tempfile.TemporaryDirectory() as folder:
        began = time.monotonic()
        service = subprocess.Popen(
            [command, "serve", "--port", str(port)],
            cwd=folder,
            stderr=subprocess.DEVNULL,
            env={name: text for name, text in environment.items() if name != "PYTHONDONTWRITEBYTECODE"},
            start_new_session=True,
        )
        try:
            yield f"http://127.0.0.1:{port}", began
        finally:
            service.send_signal(signal.SIGTERM)
            try:
                service.wait(60.0)
            finally:
                if service.poll() is None:
                    os.killpg(service.pid, signal.SIGKILL)


def seconds_of(call: Callable[[], object]) -> float:
    began = time.monotonic()
    call()
    return time.monotonic() - began


def wait_until_ready(address: str) -> None:
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        try:
            with urllib.request.urlopen(f"{address}/readyz", timeout=PATIENCE):
                return
        except OSError:
            time.sleep(0.02)
    raise TimeoutError(address)


def state_of_workers(address: str) -> str:
    with urllib.request.urlopen(f"{address}/readyz", timeout=PATIENCE) as answer:
        return str(json.load(answer).get("workers", "not told"))


def use(address: str, kind: str, number: int) -> None:
    """Submit what was not computed before, and wait for its end."""
    motion = {"type": "planar", "lambda": 1 + number / 100}
    path, document = "jobs", {**PROBLEM, "accuracy": {"tier": kind}, "motion": motion}
    if kind == "integration":
        document = {**STATE, "time": {"stop": 10 + number, "samples": 101}}
    elif kind in ("sweep", "long sweep"):
        path, base, count = "sweeps", {**PROBLEM, "motion": motion}, 10 if kind == "sweep" else 200
        axis = {"pointer": "/motion/lambda", "linspace": [f"{number}.1", f"{number}.2", count]}
        document = {"base": base, "axes": [axis], "keep": ["period"]}
    request = urllib.request.Request(
        f"{address}/v1/{path}",
        data=json.dumps(document).encode(),
        headers={"Content-Type": "application/json", "Prefer": "wait=60"},
    )
    with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
        job = json.load(answer)
    while job["state"] in ("queued", "running"):  # of jobs only on a busy machine
        time.sleep(0.002)
        with urllib.request.urlopen(f"{address}/v1/{path}/{job['id']}", timeout=PATIENCE) as answer:
            job = json.load(answer)
    if job["state"] != "succeeded":
        raise RuntimeError(f"{kind}: {job['state']}")


if __name__ == "__main__":
    main()
