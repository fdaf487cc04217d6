"""Computations for the tests of the runner: what a job does is told by its problem."""

import json
import os
import signal
import time
from pathlib import Path

from service.jobs.outcome import SolveOutcome

SUMMARY: dict[str, object] = {
    "method": "quadrature",
    "tier": "standard",
    "energy": {"value": 1.0, "error": 0},
}


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
        return SolveOutcome(None, b"", b"", {"code": "no_motion", "detail": "there is none"})
    elif chore == "nan":
        return SolveOutcome({**SUMMARY, "error": float("nan")}, b"", b"", None)
    return SolveOutcome(SUMMARY, b"dense", b"samples", None)
