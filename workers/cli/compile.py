"""``python -m workers compile``: compiles the fast solvers before a job has to wait for it."""

import json
import time

from rich.console import Console

from service.jobs.outcome import Refused
from service.terminal import answer, say
from workers.computation.compute import solve_document
from workers.sweeping.chunk import compute_chunk

_BASE = {
    "body": {"A": "2", "C": "1"},
    "potential": {
        "type": "expression",
        "expression": "a*g1 + b/g3^2",
        "parameters": {"a": "-1", "b": "1/20"},
    },
    "motion": {"type": "planar", "lambda": "1"},
    "time": {"stop": "1", "samples": 2},
    "accuracy": {"tier": "draft"},
}
_SWEEP = {"base": _BASE, "axes": [{"pointer": "/motion/lambda", "values": ["1", "2"]}], "keep": ["period"]}


def compile_solvers() -> int:
    """Solve a problem and a sweep that need all kernels; return 0 if both succeed."""
    began = time.monotonic()
    # Shows nothing where stderr is not a terminal.
    with Console(stderr=True).status("compiling the solvers …"):
        outcome = solve_document(json.dumps(_BASE))
        chunk = compute_chunk(json.dumps({"sweep": _SWEEP, "first": 0, "count": 2}))
    if isinstance(outcome, Refused) or chunk.refused:
        say(f"the solvers do not work here: {outcome}")
        return 1
    answer(f"the solvers are ready after {time.monotonic() - began:.1f} s\n")
    return 0
