"""Computations for the tests of the runner: what a job does is told by its problem."""

import json
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from service.jobs.records import ChunkOutcome, JobKind, JobResult, Refused, Solved, SolveOutcome
from service.storage.codecs.packing import SOLVED, ChunkPoints, chunk_outcome, encode_document
from workers.process.tasks import WorkerTasks

SUMMARY: dict[str, object] = {
    "method": "quadrature",
    "tier": "standard",
    "energy": {"value": 1.0, "error": 0},
}

SOURCE = {
    **{"host": "here", "version": "1", "numerics": 1, "processor": "p", "libraries": "l", "threads": 1},
    "way": "compiled",
}
"""The provenance of every chunk."""


def do_chore(document: str) -> SolveOutcome:
    """Write the child's id into the job's log, then do the job's chore."""
    problem = json.loads(document)
    if "log" in problem:
        with Path(problem["log"]).open("a") as log:
            log.write(f"{os.getpid()}\n")
    chore = problem.get("chore", "succeed")
    if chore == "spin":
        # In C, without a chance for a Python signal handler.
        sum(range(10**12))
    elif chore == "sleep":
        time.sleep(problem["seconds"])
    elif chore == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    elif chore == "hog":
        _ = [bytes(1024) * 1024 for _ in range(100_000)]
    elif chore == "raise":
        raise RuntimeError("a fault of ours")
    elif chore == "refuse":
        return Refused({"code": "no_motion", "detail": "there is none"})
    elif chore == "nan":
        return Solved({**SUMMARY, "error": float("nan")}, b"", b"")
    return Solved(SUMMARY, b"dense", b"samples")


def do_chunk(document: str) -> ChunkOutcome:
    """Say of every point that its period is its index; the sweep tells which points make trouble."""
    payload = json.loads(document)
    first, count, sweep = payload["first"], payload["count"], payload["sweep"]
    time.sleep(sweep.get("pause", 0.0))
    bad = [index for index in sweep.get("bad", ()) if first <= index < first + count]
    if bad and sweep["chore"] != "stop":
        do_chore(json.dumps({"chore": sweep["chore"]}))
    elif bad and bad[0] > first:
        count = bad[0] - first
    indices = np.arange(first, first + count, dtype=np.float64)
    points = ChunkPoints([SOLVED] * count, {"period": indices})
    return chunk_outcome(points, sweep["seconds"] * count, SOURCE)


def do_telling(document: str, tell: Callable[[float], None]) -> JobResult:
    """Tell the shares that the problem has; go on after each when the file of its number is there."""
    problem = json.loads(document)
    for number, share in enumerate(problem["shares"]):
        tell(share)
        while not Path(f"{problem['goes_on']}{number}").exists():
            time.sleep(0.01)
    return JobResult(encode_document({}))


CHORES = {JobKind.SOLVE: do_chore, JobKind.CHUNK: do_chunk, JobKind.STUDY: do_telling}
TASKS = WorkerTasks(CHORES, "tests.workers.chores:TASKS")
