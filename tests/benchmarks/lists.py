"""Lists of real problems, from the POST to the last solution, beside the bare engine in the same run."""

import statistics
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

from tests.benchmarks.measuring import Effort, Table
from tests.benchmarks.motions import LIBRATION
from tests.benchmarks.throughput import PATIENCE, PLACES, bare_seconds, sqlite_url
from tests.benchmarks.whole.requests import PROBLEM, wait_until_warm
from tests.support.serving import Service, serving
from tests.support.waiting import wait_until

GENERAL = {
    **PROBLEM,
    "body": {"A": "17/10", "C": 1},
    "potential": {"type": "expression", "expression": LIBRATION},
}
LISTS = (
    ("gravity, A = 2C", "draft", 100_000, 0.6),
    ("gravity, A = 2C", "standard", 200_000, 0.6),
    ("gravity, A = 2C", "high", 300_000, 0.4),
    ("α = 1.7", "standard", 80_000, 0.3),
)
"""The problem, its tier, the first λ in units of 1e-5, and the ratio to the bare engine that is asked."""
ROUNDS = 3


def lists(effort: Effort) -> Table:
    """Return how many problems of a list a second are examined, queued, computed and stored."""
    number = effort.repeats(500)
    rounds = 1 if effort.is_quick else ROUNDS
    ours: dict[int, list[float]] = {place: [] for place in range(len(LISTS))}
    bare = []
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder), workers=PLACES) as running:
        wait_until_warm(running)
        for turn in range(rounds):
            # In turns, so that whatever else the machine does hits all of them alike.
            seconds = bare_seconds(sqlite_url(Path(folder), f"bare-{turn}"), number)
            bare.append(number / seconds)
            for place, (name, tier, first, _) in enumerate(LISTS):
                base = PROBLEM if name.startswith("gravity") else GENERAL
                ours[place].append(
                    number / seconds_of_list(running, base, tier, first + turn * number, number)
                )
    least = statistics.median(bare)
    rows = tuple(
        (name, tier, f"{rate:,.0f}", f"{rate / least:.2f}", f"≥ {asked}")
        for place, (name, tier, _, asked) in enumerate(LISTS)
        for rate in [statistics.median(ours[place])]
    )
    remark = (
        f"{number} planar motions in one POST, each with its own λ, 101 samples over a period; {PLACES} "
        "workers, SQLite. From the POST to the last solution: examined, queued, computed in children that "
        f"can be killed, stored. The bare engine: two plain statements an empty job, {least:,.0f} jobs/s."
    )
    heads = ("problem", "tier", "jobs/s", "of the bare engine", "asked")
    return Table("Lists of problems", remark, heads, rows)


_OF_A_POST = 1000
"""Problems of a list at most, which is below the longest body that is accepted."""


def seconds_of_list(
    running: Service, base: Mapping[str, object], tier: str, first: int, number: int
) -> float:
    """Return the seconds from the POST of a list to its last solution; its λ begin at ``first``/100000."""
    problems = [
        {
            **base,
            "motion": {"type": "planar", "lambda": f"{first + k}/100000"},
            "accuracy": {"tier": tier},
        }
        for k in range(number)
    ]
    began = time.perf_counter()
    for start in range(0, number, _OF_A_POST):
        answer = running.call("POST", "/v1/jobs", problems[start : start + _OF_A_POST])
        refused = [item for item in answer.document.get("items", ()) if item["job"] is None]
        if answer.status != 202 or refused:
            raise RuntimeError(f"{answer.status}: {refused[:1] or str(answer.document)[:500]}")
    wait_until(lambda: not _is_any_left(running), PATIENCE)
    return time.perf_counter() - began


def _is_any_left(running: Service) -> bool:
    return any(
        running.call("GET", f"/v1/jobs?state={state}&limit=1").document["total"]
        for state in ("queued", "running")
    )
