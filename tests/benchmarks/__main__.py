"""``make bench``: what things cost, rivals side by side, each with its error.

Prints all tables and writes docs/performance.md with its picture; ``--quick``
measures less, prints, and writes nothing.
"""

import argparse
import sys
import time
from collections.abc import Callable

from tests.benchmarks import (
    atlases,
    certified,
    costs,
    fast,
    precision,
    report,
    service,
    stored,
    sweep,
    sweep_service,
    throughput,
)
from tests.benchmarks.measuring import Effort, Row, Table, circumstances, say
from tests.benchmarks.whole import jobs, points, requests, tiers
from workers.computation.compiled_code import keep_compiled_code

TARGETS: tuple[Callable[[Effort], list[Row]], ...] = (
    fast.against_scipy,
    fast.against_heyoka,
    fast.any_time,
    fast.near_the_separatrix,
    stored.evaluation,
    certified.periods,
    certified.samples,
    sweep.sweep,
    sweep.known_structure,
    fast.general_alpha,
    sweep_service.through_the_service,
)
TABLES: tuple[Callable[[Effort], Table], ...] = (
    costs.tiers,
    costs.outputs,
    costs.parts,
    atlases.atlases,
    certified.others,
    jobs.jobs,
    requests.requests,
    points.points,
    tiers.tiers,
    service.around,
    throughput.engines,
    throughput.service,
    throughput.growth,
)


def main() -> int:
    """Measure, print, write; 0 whether the targets are reached or not."""
    keep_compiled_code()
    options = argparse.ArgumentParser(prog="python -m tests.benchmarks")
    options.add_argument("--quick", action="store_true", help="fewer and shorter runs; nothing is written")
    effort = Effort(options.parse_args().quick)
    began, known = time.perf_counter(), circumstances()
    for line in known:
        say(line)
    rows: list[Row] = []
    for target in TARGETS:
        found = target(effort)
        say(report.text_of_rows(found))
        rows += found
    curves = precision.curves(effort)
    tables = [precision.table(curves)]
    say(report.text_of_table(tables[0]))
    for measure in TABLES:
        tables.append(measure(effort))
        say(report.text_of_table(tables[-1]))
    if not effort.is_quick:
        precision.draw(curves, report.PICTURE)
        report.REPORT.write_text(report.document(rows, tables, known), encoding="utf-8")
    missed = sum(not row.is_reached for row in rows)
    say(f"{time.perf_counter() - began:.0f} s; {missed} of {len(rows)} rows miss what was asked")
    return 0


if __name__ == "__main__":
    sys.exit(main())
