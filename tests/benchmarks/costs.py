"""What the tiers cost and reach, and what each output adds: whole jobs, from document to solution."""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from service.dynamics.motion import COLUMNS
from service.dynamics.problem import Output
from service.jobs.records import Solved, SolveOutcome
from tests.benchmarks.measuring import Effort, Table, in_turns, in_words
from tests.benchmarks.motions import FloatArray, Measured, elliptic, librations
from tests.benchmarks.stored import stored_solution
from workers.calibration.measurement import CASES, calibrate, whole_jobs
from workers.calibration.measurement import Effort as CalibrationEffort
from workers.computation.compute import solve_document

ASKED: tuple[Output, ...] = ("gamma", "omega", "invariants", "orientation", "stability")
"""In the order in which they are added."""
PROBLEMS: Mapping[str, Mapping[str, object]] = {
    "A = 2C": {
        "body": {"A": 2, "B": "3/2", "C": 1},
        "potential": {"type": "expression", "expression": "-g1 + 1/(20*g3^2)"},
        "motion": {"type": "planar", "nu": 1},
    },
    "α = 3": {
        "body": {"A": 3, "B": "5/2", "C": 1},
        "potential": {"type": "expression", "expression": "(3*g1^2+g3^2)*(g2^2-1/2+g2^3/5)"},
        "motion": {"type": "planar", "lambda": "4/5"},
    },
}
MEASURED_TIERS = (
    ("pole to equator", "three-term"),
    ("rest to equator", "three-term"),
    ("rest to rest", "three-term"),
    ("rest to equator", "general alpha"),
)


def tiers(effort: Effort) -> Table:
    """Return seconds and errors of every tier, as a calibration measures them."""
    cases = tuple(case for case in CASES if (case.kind, case.family) in MEASURED_TIERS)
    few = CalibrationEffort(cases[: 2 if effort.is_quick else None], effort.repeats(10), 2000)
    with whole_jobs() as seconds_of:
        table = calibrate(few, seconds_of)
    rows = [
        (
            row.kind,
            row.family,
            row.tier,
            in_words(row.seconds),
            f"{row.error:.1e}",
            f"{row.claimed_error:.1e}",
        )
        for row in table.rows
    ]
    rows += [(lack.kind, lack.family, lack.tier, lack.code, "", "") for lack in table.unavailable]
    heads = ("motion", "potential", "tier", "1000 samples", "error", "claimed")
    remark = (
        "Whole jobs without the verdict, from submission to stored solution, computed in a child process; "
        "the tiers take the cheapest solver that keeps what they promise."
    )
    return Table("The tiers", remark, heads, tuple(rows))


def outputs(effort: Effort) -> Table:
    """Return the seconds of a job as outputs are added one by one."""
    rows = []
    for name, problem in PROBLEMS.items():
        *seconds, single = seconds_of_outputs(problem, effort)
        rows.append((name, "gamma, one sample", in_words(single), ""))
        for k, output in enumerate(ASKED):
            more = seconds[k] - (seconds[k - 1] if k else 0.0)
            added = f"{1e3 * more:+.1f} ms" if k else ""
            rows.append((name, output if k == 0 else f"+ {output}", in_words(seconds[k]), added))
    heads = ("problem", "outputs", "job", "added")
    remark = (
        "1000 samples over 10 periods, tier standard, without the verdict; each row asks for one thing more. "
        "The series that is stored is built in any case, so one sample costs nearly as much as 1000."
    )
    return Table("What each output costs", remark, heads, tuple(rows))


def seconds_of_outputs(problem: Mapping[str, object], effort: Effort) -> Sequence[float]:
    """Return the seconds of jobs that ask for one output more each, and last those of a single sample."""
    jobs = [_job(problem, ASKED[: k + 1]) for k in range(len(ASKED))]
    return in_turns((*jobs, _job(problem, ASKED[:1], 1)), effort.repeats(20))


def parts(effort: Effort) -> Table:
    """Return what the parts of a solution cost where only some are asked for."""
    rows = []
    for motion in (elliptic(), librations()[-1]):
        found = motion.solved("standard")
        times = np.linspace(0.0, 10.0 * found.period.hi, 1000)
        actions: dict[str, Callable[[], object]] = {
            "period alone": partial(motion.solved, "standard"),
            "g1 alone": partial(_columns, motion, times, ("g1",)),
            "six variables": partial(_columns, motion, times, COLUMNS),
        }
        seconds = in_turns(tuple(actions.values()), effort.repeats(51))
        rows += [
            (motion.name, "compiled solver", name, in_words(taken))
            for name, taken in zip(actions, seconds, strict=True)
        ]
    rows += _stored_parts(effort)
    remark = "1000 samples over 10 periods. What is not asked for is not evaluated."
    return Table("What is asked alone", remark, ("motion", "by", "asked", "time"), tuple(rows))


def _stored_parts(effort: Effort) -> list[tuple[str, ...]]:
    dense = stored_solution()
    assert dense.period is not None
    times = np.linspace(0.0, 10.0 * dense.period.hi, 1000)
    ways: tuple[tuple[str, Callable[[Sequence[str]], object]], ...] = (
        ("stored series", lambda names: dense.only(names)(times)),
    )
    asked = {"g1 alone": ("g1",), "six variables": COLUMNS}
    actions = [(way, name, partial(act, names)) for way, act in ways for name, names in asked.items()]
    seconds = in_turns(tuple(action for _, _, action in actions), effort.repeats(201))
    return [
        ("A = 2C", way, name, in_words(taken)) for (way, name, _), taken in zip(actions, seconds, strict=True)
    ]


def _columns(motion: Measured, times: FloatArray, names: Sequence[str]) -> FloatArray:
    return motion.solved("standard").columns(times, names)


def _job(
    problem: Mapping[str, object], asked: tuple[str, ...], samples: int = 1000
) -> Callable[[], SolveOutcome]:
    document = json.dumps({**problem, "time": {"periods": 10, "samples": samples}, "outputs": asked})

    def solve() -> SolveOutcome:
        outcome = solve_document(document)
        assert isinstance(outcome, Solved), outcome
        return outcome

    return solve
