"""What a tier costs a user: a job, a request that waits for it, a problem of a list, a point of a sweep."""

import json
import os
import statistics
import tempfile
import time
from pathlib import Path

from service.dynamics.accuracy import TIERS
from service.schemas.replies.installation import TierCostOut, TierCostsOut, Use
from service.storage.solutions.shipped_accuracy import SHIPPED_COSTS
from tests.benchmarks.lists import seconds_of_list
from tests.benchmarks.measuring import Effort, Table, in_words, median
from tests.benchmarks.whole.client import Line
from tests.benchmarks.whole.jobs import job_of
from tests.benchmarks.whole.requests import PROBLEM, wait_until_warm, waiting_job
from tests.benchmarks.whole.shipped import when_and_where
from tests.support.serving import Service, serving

WORKERS = 2
FEWER = 10
"""Divisor of the numbers that are measured together, for the tier certified."""
_PAUSE = 0.01
WHAT: tuple[Use, ...] = ("job", "request", "problem of a list", "point of a sweep")
PROBLEM_TOLD = (
    "Gravity, A = 2C, 101 samples over a period, each motion with its own λ, by the clock; a job alone is "
    f"processor time in one process. The service has {WORKERS} workers on SQLite; a list and a sweep are "
    "timed from the POST to the last result, and divided by their number."
)


def tiers(effort: Effort) -> Table:
    """Return the seconds of each at every tier; but for a quick run, they are what is shipped from now on."""
    costs = measured(effort)
    if not effort.is_quick:
        SHIPPED_COSTS.write_text(json.dumps(costs.model_dump(), indent=1) + "\n", encoding="utf-8")
    return table(costs)


def table(costs: TierCostsOut) -> Table:
    """Return the costs as a table."""
    rows = [(row.what, *(in_words(row.seconds[tier]) for tier in TIERS)) for row in costs.rows]
    return Table("What a tier costs a user", costs.problem, ("what", *TIERS), tuple(rows))


def measured(effort: Effort) -> TierCostsOut:
    """Measure each at every tier, through a service, but for the job alone."""
    load = os.getloadavg()[0]
    costs = {tier: [_job(tier, effort)] for tier in TIERS}
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(Path(folder), workers=WORKERS) as service,
    ):
        wait_until_warm(service)
        for number, tier in enumerate(TIERS):
            few = FEWER if tier == "certified" else 1
            listed = effort.repeats(500) // few
            first = 10_000 * number
            with Line(service.address) as line:  # one for each tier: an idle one is closed
                waits = [line.seconds(waiting_job(line, first + k, tier)) for k in range(effort.repeats(40))]
            costs[tier] += [
                statistics.median(waits),
                seconds_of_list(service, PROBLEM, tier, 101_000 + first, listed) / listed,
                _sweep(service, tier, effort.repeats(1000) // few),
            ]
    rows = [
        TierCostOut(what=what, seconds={tier: float(f"{costs[tier][place]:.3g}") for tier in TIERS})
        for place, what in enumerate(WHAT)
    ]
    return TierCostsOut(
        **when_and_where(load),
        problem=PROBLEM_TOLD,
        rows=rows,
    )


def _job(tier: str, effort: Effort) -> float:
    motion = {"type": "planar", "lambda": "11/10"}
    return median(job_of({**PROBLEM, "motion": motion, "accuracy": {"tier": tier}}), effort.repeats(15))


def _sweep(service: Service, tier: str, points: int) -> float:
    document = {
        "base": {**PROBLEM, "motion": {"type": "planar", "lambda": 1}, "accuracy": {"tier": tier}},
        "axes": [{"pointer": "/motion/lambda", "linspace": ["6/10", "2", points]}],
        "keep": ["period", "energy", "error"],
    }
    began = time.perf_counter()
    answer = service.call("POST", "/v1/sweeps", document)
    assert answer.status == 202, json.dumps(answer.document)
    path = f"/v1/sweeps/{answer.document['id']}"
    while service.call("GET", path).document["state"] in ("queued", "running"):
        time.sleep(_PAUSE)
    return (time.perf_counter() - began) / points
