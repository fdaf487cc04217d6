"""The parts of ``make bench``: each measures, prints, and writes its own place in the pages."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from tests.benchmarks import (
    atlases,
    certified,
    cluster,
    compiling,
    costs,
    discovery,
    estimates,
    examined,
    fast,
    leaving,
    lists,
    pages,
    precision,
    report,
    service,
    starting,
    stored,
    sweep,
    sweep_service,
    throughput,
)
from tests.benchmarks.measuring import Effort, Result, Row, Table, in_words, say
from tests.benchmarks.whole import comparison, jobs, points, requests, states, tiers

Part = Callable[[Effort, Sequence[str]], None]
"""Measures under circumstances that are told; a quick one prints and writes nothing."""
TARGETS: tuple[Callable[[Effort], list[Row]], ...] = (
    fast.against_scipy,
    fast.against_heyoka,
    fast.any_time,
    fast.near_the_separatrix,
    stored.evaluation,
    certified.periods,
    certified.samples,
    certified.steps,
    sweep.sweep,
    sweep.known_structure,
    fast.general_alpha,
    sweep_service.through_the_service,
)
REACHED = {
    "draft": "{}",
    "standard": "{}",
    "high": "{}, the same after 1e8 periods",
    "certified": "{}, proven",
}
PROMISED = {
    "draft": "1e-6",
    "standard": "1e-10",
    "high": "1e-13",
    "certified": "a proven radius of 64, 128 or 333 bits",
}
"""On the front page of the documentation, by tier."""
RIVALS = {precision.SCIPY: "1e-10", precision.HEYOKA: "1e-16"}
"""Other programs by their tolerance."""


def targets(effort: Effort, known: Sequence[str]) -> None:
    """Measure what is asked, beside rivals."""
    rows: list[Row] = []
    for target in TARGETS:
        found = target(effort)
        say(report.text_of_rows(found))
        rows += found
    if not effort.is_quick:
        pages.write_part(report.REPORT, "targets", report.section_of_rows(rows, known))
    missed = sum(not row.is_reached for row in rows)
    say(f"{missed} of {len(rows)} rows miss what was asked")


def work_against_precision(effort: Effort, known: Sequence[str]) -> None:
    """Measure kernels, whole jobs and rivals, draw them, and write the table of the front page."""
    curves = precision.curves(effort)
    table, proven = precision.table(curves), precision.certified_job(effort)
    say(report.text_of_table(table))
    if effort.is_quick:
        return
    precision.draw(curves, report.PICTURE)
    caption = "Error against time: kernels and whole jobs at each tier, DOP853, heyoka"
    picture = f"\n![{caption}]({report.PICTURE.name})\n"
    pages.write_part(report.REPORT, "precision", report.section_of_tables([table], known, picture))
    pages.write_part(report.FRONT_PAGE, "accuracy", accuracy_in_brief(curves, proven))


def accuracy_in_brief(curves: precision.Curves, proven: Result) -> str:
    """Return the front page's table: what tiers promise, what whole jobs reach, and two integrations."""
    by_tier = {point.name: point for point in (*curves[precision.JOB], proven)}
    rows = [
        (f"`{tier}`", promised, REACHED[tier].format(_short(point.error)), in_words(point.seconds))
        for tier, promised in PROMISED.items()
        for point in (by_tier[tier],)
    ]
    for name, tolerance in RIVALS.items():
        point = next(each for each in curves[name] if each.name == tolerance)
        told = f"for comparison: a bare integration by {name}, tolerance {tolerance}"
        rows.append((told, "", _short(point.error), in_words(point.seconds)))
    return report.markdown(("", "promised", "reached", "whole job"), rows)


def _short(error: float) -> str:
    """Return an error as people write it: 2e-9."""
    return f"{error:.0e}".replace("e-0", "e-")


def tables(
    name: str, measures: Sequence[Callable[[Effort], Table]], effort: Effort, known: Sequence[str]
) -> None:
    """Measure tables, and write them into their part of docs/performance.md."""
    found = []
    for measure in measures:
        found.append(measure(effort))
        say(report.text_of_table(found[-1]))
    if not effort.is_quick:
        pages.write_part(report.REPORT, name, report.section_of_tables(found, known))


def tier_costs(effort: Effort, known: Sequence[str]) -> None:
    """Measure what a tier costs a user: shipped, and shown by the front page; then the comparison."""
    table = tiers.tiers(effort)
    say(report.text_of_table(table))
    if effort.is_quick:
        return
    pages.write_part(report.REPORT, "tier-costs", report.section_of_tables([table], known))
    pages.write_part(report.FRONT_PAGE, "tier-costs", costs_in_brief(table))
    comparison.ship(effort)


def costs_in_brief(table: Table) -> str:
    """Return the table of the front page: what one of each costs, at every tier."""
    return report.markdown(table.heads, table.rows)


PARTS: Mapping[str, Part] = {
    "targets": targets,
    "precision": work_against_precision,
    "whole-jobs": partial(tables, "whole-jobs", (jobs.jobs,)),
    "points": partial(tables, "points", (points.points, states.states, states.kinds)),
    "estimates": partial(tables, "estimates", (estimates.estimates,)),
    "atlases": partial(tables, "atlases", (atlases.atlases,)),
    "discovery": partial(tables, "discovery", (discovery.discovery,)),
    "requests": partial(tables, "requests", (requests.requests,)),
    "tier-costs": tier_costs,
    "tiers": partial(tables, "tiers", (costs.tiers, costs.outputs, costs.parts)),
    "certified": partial(tables, "certified", (certified.others, certified.integrals, certified.long_steps)),
    "starting": partial(tables, "starting", (starting.starting, starting.new_machine)),
    "compiling": partial(tables, "compiling", (compiling.compiling,)),
    "service": partial(tables, "service", (service.around,)),
    "leaving": partial(tables, "leaving", (leaving.leaving,)),
    "throughput": partial(
        tables,
        "throughput",
        (throughput.engines, examined.examined, lists.lists, throughput.service, throughput.growth),
    ),
    "cluster": partial(tables, "cluster", (cluster.beside_children, cluster.carried)),
}
"""In the order of docs/performance.md."""
