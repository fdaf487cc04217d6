"""Ways to the same samples beside each other, and what each output adds, as they are shipped.

``python -m tests.benchmarks.whole.comparison`` measures them; so does the part ``tier-costs``
of ``make bench``.
"""

import json
import os
from collections.abc import Iterator

from service.schemas.replies.installation import ComparedWaysOut, OutputCostOut, Way, WayOut
from service.storage.solutions.shipped_accuracy import SHIPPED_COMPARISON
from tests.benchmarks import costs, precision
from tests.benchmarks.measuring import Effort
from tests.benchmarks.whole.shipped import when_and_where

WAYS: tuple[Way, ...] = ("compiled solver", "whole job", "DOP853", "heyoka")
TOLD = (
    "Ways: A = 2C, V = −γ₁ + 1/(20 γ₃²), 1000 samples over 10 periods, against certified enclosures; "
    "integrators start from the exact state rounded to doubles. Outputs: 1000 samples over 10 periods at the "
    "tier standard, jobs without the verdict. Processor time in one process, the structure of the problem "
    "being known."
)


def ship(effort: Effort) -> None:
    """Measure, and write what is shipped from now on."""
    text = json.dumps(measured(effort).model_dump(), indent=1, ensure_ascii=False)
    SHIPPED_COMPARISON.write_text(text + "\n", encoding="utf-8")


def measured(effort: Effort) -> ComparedWaysOut:
    """Measure on this machine."""
    load = os.getloadavg()[0]
    curves = precision.curves(effort)
    certified = precision.certified_job(effort)
    curves[precision.JOB].append(certified)
    return ComparedWaysOut(
        **when_and_where(load),
        problem=TOLD,
        ways=[
            WayOut(way=way, setting=point.name, seconds=_short(point.seconds), error=_short(point.error))
            for way in WAYS
            for point in curves[way]
        ],
        outputs=list(_outputs(effort)),
    )


def _outputs(effort: Effort) -> Iterator[OutputCostOut]:
    for name, problem in costs.PROBLEMS.items():
        before = None
        *found, _ = costs.seconds_of_outputs(problem, effort)
        for output, seconds in zip(costs.ASKED, found, strict=True):
            added = None if before is None else _short(seconds - before)
            yield OutputCostOut(problem=name, output=output, seconds=_short(seconds), added=added)
            before = seconds


def _short(value: float) -> float:
    return float(f"{value:.3g}")


if __name__ == "__main__":
    ship(Effort(is_quick=False))
