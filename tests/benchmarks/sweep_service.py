"""Target 10: a sweep through the whole service against a pool of integrators."""

import multiprocessing
import tempfile
import time
import urllib.request
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np
from pyarrow import Table, ipc
from scipy.integrate import solve_ivp

from service.dynamics.problem import PlanarMotion
from tests.benchmarks.measuring import Effort, Result, Row, faster
from tests.benchmarks.motions import DOUBLE, FloatArray, Measured
from tests.support.planar import formula
from tests.support.serving import Service, serving

POINTS, SAMPLES = 10_000, 200
COMPARED = 40
"""Points that the pool integrates; the time of the others is taken in proportion."""
WANTED = 1e-9
STEPS = (1e-9, 3e-10, 1e-10, 3e-11, 1e-11, 3e-12, 1e-12, 3e-13)
ARROW = "application/vnd.apache.arrow.stream"
VARIABLES = ("p", "q", "r", "g1", "g2", "g3")
A, B, LAMBDA = "/potential/parameters/a", "/potential/parameters/b", "/motion/lambda"
PROCESSES = 2
POLL_SECONDS = 0.03
Job = tuple[float, float, FloatArray, FloatArray]


def through_the_service(effort: Effort) -> list[Row]:
    """Submit, wait, download as Arrow: the median of a few runs, each with points of its own."""
    points = POINTS // 5 if effort.is_quick else POINTS
    settings = {"POLHODE_LOG_LEVEL": "warning"}
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(Path(folder), workers=PROCESSES, **settings) as running,
    ):
        # What is compiled, imported and proved once.
        _download(running, sweep_document(points, seed=1))
        runs = [_timed(running, sweep_document(points, seed=2 + k)) for k in range(effort.repeats(5))]
        seconds, table = sorted(runs, key=lambda run: run[0])[len(runs) // 2]
    grid = np.array(table["t"][0].as_py())
    places = range(0, points, points // COMPARED)
    motions = [measured(*(table[name][place].as_py() for name in (A, B, LAMBDA))) for place in places]
    samples = [np.array([table[name][place].as_py() for name in VARIABLES]).T for place in places]
    error = max(motion.error(grid, found) for motion, found in zip(motions, samples, strict=True))
    jobs = [
        (table[A][place].as_py(), table[B][place].as_py(), found[0], grid)
        for place, found in zip(places, samples, strict=True)
    ]
    rival = _pool(motions, jobs, grid, points)
    claimed = np.nanmax(table["error"].to_numpy())
    solved = table["outcome"].to_pylist().count("solved")
    ours = Result(
        f"POST to Arrow file, {PROCESSES} workers",
        seconds,
        error,
        f"{solved:,} solved, claimed {claimed:.0e}",
    )
    what = f"{points:,} points, {SAMPLES} samples of six variables each, through HTTP and SQLite"
    return [faster(10, what, 100, WANTED, ours, rival)]


def sweep_document(points: int, seed: int) -> dict[str, object]:
    """Return a sweep over a, b and λ of one structure, with its series."""
    return {
        "base": {
            "body": {"A": 2, "B": "3/2", "C": 1},
            "potential": {
                "type": "expression",
                "expression": "a*g1 + b/g3^2",
                "parameters": {"a": -1, "b": "1/50"},
            },
            "motion": {"type": "planar", "lambda": 1},
            "time": {"stop": 20, "samples": SAMPLES},
            "accuracy": {"tolerance": WANTED},
        },
        "axes": [
            {"pointer": A, "uniform": [-2, "-1/2", points], "seed": seed},
            {"pointer": B, "uniform": ["1/100", "1/25", points], "seed": seed},
            {"pointer": LAMBDA, "uniform": ["7/10", "7/5", points], "seed": seed},
        ],
        "combine": "zip",
        "keep": ["period", "energy", "error"],
        "series": True,
    }


def _timed(running: Service, sweep: dict[str, object]) -> tuple[float, Table]:
    began = time.perf_counter()
    content = _download(running, sweep)
    seconds = time.perf_counter() - began
    return seconds, ipc.open_stream(content).read_all()


def _download(running: Service, sweep: dict[str, object]) -> bytes:
    """Return the Arrow stream of a sweep that has been submitted and waited for."""
    submitted = running.call("POST", "/v1/sweeps", sweep)
    assert submitted.status == 202, submitted
    path = f"/v1/sweeps/{submitted.document['id']}"
    while (state := running.call("GET", path).document["state"]) in ("queued", "running"):
        time.sleep(POLL_SECONDS)
    assert state == "succeeded", state
    request = urllib.request.Request(running.address + path + "/points", headers={"Accept": ARROW})
    with urllib.request.urlopen(request, timeout=120) as answer:
        content: bytes = answer.read()
    return content


def measured(a: float, b: float, lambda_: float) -> Measured:
    """Return the motion of a point of the sweep."""
    # The points are the shortest decimals of these doubles.
    text = f"({Fraction(repr(a))})*g1 + ({Fraction(repr(b))})/g3^2"
    return Measured(text, DOUBLE, formula(text, DOUBLE), PlanarMotion(Fraction(repr(lambda_))))


def _pool(motions: list[Measured], jobs: list[Job], grid: FloatArray, points: int) -> Result:
    """Return what the pool takes at the loosest rtol that reaches the wanted error at these points."""
    with multiprocessing.get_context("fork").Pool(PROCESSES) as pool:
        pool.map(partial(integrate, 1e-6), jobs[:PROCESSES])
        for rtol in STEPS:
            began = time.perf_counter()
            found = pool.map(partial(integrate, rtol), jobs, chunksize=5)
            seconds = time.perf_counter() - began
            error = max(motion.error(grid, samples) for motion, samples in zip(motions, found, strict=True))
            if error <= WANTED:
                break
    name = f"pool of {PROCESSES}, DOP853 {rtol:.0e}"
    return Result(name, seconds * points / len(jobs), error, f"from {len(jobs)} points")


def integrate(rtol: float, job: Job) -> FloatArray:
    """Integrate one point, its equations written out by hand."""
    a, b, state, grid = job

    def rhs(_: float, y: FloatArray) -> tuple[float, ...]:
        p, q, r, g1, g2, g3 = y.tolist()
        V_3 = -2.0 * b / (g3 * g3 * g3)
        return (
            (0.5 * q * r + g2 * V_3) / 2.0,
            (-p * r + g3 * a - g1 * V_3) / 1.5,
            0.5 * p * q - g2 * a,
            r * g2 - q * g3,
            p * g3 - r * g1,
            q * g1 - p * g2,
        )

    span = (0.0, float(grid[-1]))
    return np.asarray(solve_ivp(rhs, span, state, "DOP853", grid, rtol=rtol, atol=rtol / 10).y.T)
