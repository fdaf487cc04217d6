"""Whole jobs of ours beside those of another revision, which is checked out in a folder: one run, in turns.

Each revision computes in processes of its own, by its own code and the packages of this installation. The
potential is known to them, the curve of each job is new: λ differs from job to job. Our jobs come with their
windows, as our workers get them; a revision that knows no such thing gets the document alone.
"""

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from service.verdicts.examination import examine_problems
from tests.benchmarks.measuring import Effort, Table, in_words
from tests.benchmarks.motions import LIBRATION
from tests.support.examinations import examination_of

ROOT = Path(__file__).parents[2]
PROGRAM = Path(__file__).with_name("timed_jobs.py")
PROBLEMS: Mapping[str, Mapping[str, object]] = {
    "gravity": {"body": {"A": 2, "C": 1}, "potential": {"type": "gravity", "a": -1}},
    "α = 1.7": {"body": {"A": "17/10", "C": 1}, "potential": {"type": "expression", "expression": LIBRATION}},
}
ASKED: Mapping[tuple[str, str], int] = {
    ("gravity", "draft"): 15,
    ("gravity", "standard"): 10,
    ("gravity", "high"): 6,
    ("α = 1.7", "draft"): 15,
    ("α = 1.7", "standard"): 30,
    ("α = 1.7", "high"): 30,
}
"""So many times faster than revision 3d77e05."""
ROUNDS = 3


class NotSolvedError(Exception):
    """A revision did not solve the jobs."""


def against(folder: Path, effort: Effort) -> Table:
    """Return the medians of both revisions, and how many times faster ours is.

    Raises
    ------
    NotSolvedError
        A process of one of the revisions failed: what it printed is told.
    """
    rows = []
    for (name, tier), asked in ASKED.items():
        jobs = [_job(name, tier, k) for k in range(effort.repeats(25))]
        ours, theirs = [], []
        for _ in range(effort.repeats(ROUNDS)):
            ours.append(_median(ROOT, jobs))
            theirs.append(_median(folder.resolve(), jobs))
        ratio = min(theirs) / min(ours)
        reached = f"{ratio:.3g}×"
        rows.append(
            (
                name,
                tier,
                in_words(min(theirs)),
                in_words(min(ours)),
                reached if ratio >= asked else f"**{reached}, missed**",
                f"≥ {asked}×",
            )
        )
    remark = (
        "101 samples over a period, processor time from the document to the outcome in a process that has "
        "solved others of this potential; medians, the best of the rounds, in which the revisions take turns."
    )
    heads = ("problem", "tier", f"in {folder.name}", "here", "faster", "asked")
    return Table("Whole jobs of two revisions", remark, heads, tuple(rows))


def _job(name: str, tier: str, number: int) -> tuple[str, str]:
    """Return a document and the windows of its curve, as the store keeps them."""
    document = {
        **PROBLEMS[name],
        "motion": {"type": "planar", "lambda": f"{80_000 + number}/100000"},
        "time": {"periods": 1, "samples": 101},
        "accuracy": {"tier": tier},
    }
    asked = examination_of([document])
    found = json.loads(examine_problems(json.dumps(asked)))["found"]
    return json.dumps(document), found[asked["problems"][0]["windows"]]


def _median(folder: Path, jobs: Sequence[tuple[str, str]]) -> float:
    # Its packages before ours: what is installed in place is found after the paths of the environment. The
    # folder of the program is none of them (-P), for a module beside it is called as a package of theirs.
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    done = subprocess.run(
        [sys.executable, "-P", str(PROGRAM)],
        input=json.dumps(jobs),
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env=environment,
    )
    if done.returncode:
        raise NotSolvedError(f"{folder}: {done.stderr or done.stdout}")
    answer = json.loads(done.stdout)
    if Path(answer["code"]) != folder / "workers":
        raise NotSolvedError(f"{folder}: the code came from {answer['code']}")
    return float(answer["seconds"])
