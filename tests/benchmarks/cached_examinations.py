"""What it saves to keep verdicts and windows: whole jobs, in one run, without and with what is kept.

``python -m tests.benchmarks.cached_examinations`` prints a table. A whole job is the examination of a problem
and its solution, both in this process, from the document to the outcome; on a loaded machine the times of the
processor are steadier than those of the clock, so these are told.
"""

import json
import sys
import time
from collections.abc import Callable, Mapping

from service.dynamics.reduction import windows
from service.jobs.records import Solved
from service.verdicts.examination import examine_problems
from tests.benchmarks.measuring import in_turns, in_words
from tests.support.examinations import examination_of
from workers.computation.compute import solve_document

REPEATS = 25
PROBLEMS: Mapping[str, Mapping[str, object]] = {
    "gravity": {"body": {"A": 2, "C": 1}, "potential": {"type": "gravity", "a": -1}},
    "α = 1.7": {
        "body": {"A": "17/10", "C": 1},
        "potential": {"type": "expression", "expression": "(A*g1^2 + C*g3^2)*(g2^2 - 1/2)"},
    },
}
ACCURACIES: Mapping[str, Mapping[str, object]] = {
    "draft": {"tier": "draft"},
    "1e-9": {"tolerance": 1e-9},
    "standard": {"tier": "standard"},
    "high": {"tier": "high"},
}
MOTION = {"motion": {"type": "planar", "lambda": "6/5"}, "time": {"periods": 1, "samples": 101}}
HEADS = (
    "problem",
    "accuracy",
    "examined",
    "verdict kept",
    "both kept",
    "solved",
    "windows kept",
    "job",
    "kept",
)


def main() -> int:
    sys.stdout.write(f"| {' | '.join(HEADS)} | ratio |\n|{' --- |' * (len(HEADS) + 1)}\n")
    for name, problem in PROBLEMS.items():
        for accuracy, asked in ACCURACIES.items():
            times = measured({**problem, **MOTION, "accuracy": asked})
            examined, _, both, solved, handed = times
            before, after = examined + solved, both + handed
            cells = (name, accuracy, *map(in_words, (*times, before, after)), f"{before / after:.1f}")
            sys.stdout.write(f"| {' | '.join(cells)} |\n")
            sys.stdout.flush()
    return 0


def measured(document: Mapping[str, object]) -> tuple[float, ...]:
    """Return the seconds of examinations with nothing, the verdict, and all kept; and of both solutions."""
    asked = examination_of([document])
    found = json.loads(examine_problems(json.dumps(asked)))["found"]
    verdict, curve = (str(asked["problems"][0][part]) for part in ("verdict", "windows"))
    texts = [json.dumps({**asked, "cached": cached}) for cached in ({}, {verdict: found[verdict]}, found)]
    text = json.dumps(document)
    outcomes = [solve_document(text), solve_document(text, found[curve])]
    assert all(isinstance(outcome, Solved) for outcome in outcomes), outcomes
    ways: tuple[Callable[[], object], ...] = (
        *(lambda text=text: examine_problems(text) for text in texts),
        lambda: solve_document(text),
        lambda: solve_document(text, found[curve]),
    )
    return in_turns(tuple(map(forgetful, ways)), REPEATS, time.process_time)


def forgetful(way: Callable[[], object]) -> Callable[[], object]:
    """Return the way as a process takes it that has not found these windows yet."""

    def run() -> object:
        windows._KNOWN.clear()
        return way()

    return run


if __name__ == "__main__":
    sys.exit(main())
