"""``python -m tests.benchmarks.honesty``: is any claimed error exceeded? Written to docs/honesty.md.

Random problems are solved in every tier, as the service does. Smooth ones and motions through poles are
compared with the certified motion in balls, motions from states with series in twice the digits, hostile ones
with what is true of them by their making. A claim is exceeded if the whole ball is further away than it. With
``--records FOLDER`` a run goes on where the last one with that folder stopped; what is asked no more of is
written as it was counted. ``--only smooth``, for example, runs and writes one section; the others stay
as they are on the page. To run in the background in bounded time, and go on later:
``--only smooth --seconds 3000 --processes 1 --records FOLDER``.
"""

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from math import inf
from pathlib import Path
from typing import Literal

from service.dynamics.numerics import NUMERICS
from service.dynamics.problem import Tier
from service.versions import version_of
from tests.benchmarks.honesty_counts import MOST, SUBJECTS, TIERS, Record, Tally, load, measure
from tests.benchmarks.honesty_page import (
    MEASURED,
    MOTIONS,
    NOT_COVERED,
    PASSAGES,
    PROVED,
    SMOOTH,
    STATES,
    TITLE,
)
from tests.benchmarks.hostile_counts import HostileRecord, faults_of, load_hostile, measure_hostile
from tests.benchmarks.hostile_report import hostile_section
from tests.support import random_motions, random_states
from tests.support.claims import BITS, CLAIMS, LATEST, PASSAGE_BITS
from tests.support.hostile_ways import ROUNDS
from tests.support.random_documents import SMALLEST_GAP

REPORT = Path(__file__).parents[2] / "docs" / "honesty.md"
Kind = Literal["smooth", "passages", "states", "motions", "hostile", "infinite", "cancellation"]
KINDS: Mapping[Kind, int] = {
    "smooth": 10_000,
    "passages": 2000,
    "states": 5000,
    "motions": 2000,
    "hostile": 2000,
    "infinite": 1000,
    "cancellation": 1000,
}
"""Numbers of problems of each that are asked; the last two are classes of hostile ones."""
HEADS: Mapping[Kind, str] = {
    "smooth": "## Smooth potentials\n",
    "passages": "## Motions through poles\n",
    "states": "## Motions from states next to unstable ones\n",
    "motions": "## Motions of every sort, attitudes and multipliers\n",
    "hostile": "## Hostile potentials\n",
    "infinite": "## Poles of G\n",
    "cancellation": "## Potentials written with cancellation\n",
}
"""Headings of the sections, in their order."""


def report(found: Mapping[Kind, str]) -> str:
    """Return the page with all of its sections."""
    return "\n".join(
        [
            TITLE.format(version=version_of("polhode"), numerics=NUMERICS),
            PROVED,
            MEASURED,
            NOT_COVERED.format(latest=10**LATEST, rounds=max(ROUNDS)),
            *(found[kind] for kind in HEADS if found[kind]),
        ]
    )


def sections(page: str) -> dict[Kind, str]:
    """Return the sections of a page as they were written."""
    places = {kind: page.find(head) for kind, head in HEADS.items()}
    ends = [*sorted(place for place in places.values() if place >= 0), len(page) + 1]
    return {
        kind: "" if place < 0 else page[place : ends[ends.index(place) + 1] - 1]
        for kind, place in places.items()
    }


def _section(record: Record) -> list[str]:
    """Return a section about motions that are compared with a reference."""
    text = {"smooth": SMOOTH, "passages": PASSAGES, "states": STATES, "motions": MOTIONS}[record.subject]
    numbers = {"seed": record.seed, "done": record.done, "minutes": record.seconds / 60, "numerics": NUMERICS}
    if record.subject == "states":
        numbers |= {"narrowest": random_states.NARROWEST, "passages": random_states.PASSAGES}
        numbers["latest"] = random_states.LAST
    elif record.subject == "motions":
        numbers |= {"radians": random_motions.MOST_RADIANS, "fastest": random_motions.FASTEST}
        numbers["latest"] = random_motions.LATEST
    else:
        bits = PASSAGE_BITS if record.subject == "passages" else BITS
        numbers |= {"bits": bits, "latest": 10**LATEST, "smallest": SMALLEST_GAP}
    what = "Motions" if record.subject in ("states", "motions") else "Problems by family and ends"
    return [text.format(**numbers), *_counted(record, f"{what}: {_listed(record.drawn)}.")]


def _counted(record: Record, drawn: str) -> list[str]:
    """Return tables of what became of problems."""
    families = SUBJECTS[record.subject]
    tiers = {tier: [record.tallies[f"{tier} {family}"] for family in families] for tier in TIERS}
    unknown = f"Drawn without a reference, and so not counted above: {_listed(record.unknown)}."
    return [
        *_table(tiers, families),
        "",
        drawn,
        "",
        *([unknown, ""] if record.unknown else []),
        *(line for tier in TIERS for line in _histograms(tier, tiers[tier])),
        "",
        *(
            ["### Exceeded", "", *(f"```\n{text}\n```" for text in record.documents), ""]
            * bool(record.documents)
        ),
    ]


def _table(tiers: Mapping[Tier, Sequence[Tally]], families: Sequence[str]) -> list[str]:
    lines = []
    for tier, tallies in tiers.items():
        whole = {"all": _total(tallies)} if len(families) > 1 else {}
        for family, tally in {**dict(zip(families, tallies, strict=True)), **whole}.items():
            asked = tally.solved + tally.refused.total()
            exceeded = f"{tally.exceeded.total()}" + (
                f" ({_listed(tally.exceeded)})" if tally.exceeded else ""
            )
            lines.append(
                f"| {tier} | {family} | {asked} | {tally.solved} | {_listed(tally.refused)} | {exceeded} "
                f"| {_smallest(tally):.2g} | {_median(tally)} "
                f"| {tally.seconds / max(1, asked):.2g} |"
            )
    return lines


def _smallest(tally: Tally) -> float:
    return tally.smallest.get("samples", tally.smallest.get("trace", inf))


def _median(tally: Tally) -> str:
    """Return the power of ten in which the median of claimed/actual of the samples lies."""
    counted = tally.ratios["samples"] or tally.ratios["trace"]
    powers = sorted(int(power) for power in counted.elements())
    return _range(powers[(len(powers) - 1) // 2]) if powers else "none"


def _total(tallies: Sequence[Tally]) -> Tally:
    total = Tally()
    for tally in tallies:
        total.add(tally)
    return total


def _histograms(tier: Tier, tallies: Sequence[Tally]) -> list[str]:
    total = _total(tallies)
    lines = ["", f"### {tier}"]
    for claim, what in CLAIMS.items():
        powers = {int(power): number for power, number in total.ratios[claim].items()}
        if not powers:
            continue
        lines += ["", f"Claimed/actual of {what} (least {total.smallest.get(claim, inf):.3g}):", "", "```"]
        for power in range(min(powers), max(powers) + 1):
            number = powers.get(power, 0)
            bar = "#" * round(60 * number / max(powers.values())) or "." * bool(number)
            lines.append(f"{_range(power):>14} {number:6d} {bar}".rstrip())
        lines.append("```")
    return lines


def _range(power: int) -> str:
    return f"1e{power} and more" if power == MOST else f"1e{power} to 1e{power + 1}"


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {number}" for name, number in sorted(counts.items())) or "none"


def main() -> int:
    """Measure and write; 1 if anything is wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.honesty", description=__doc__)
    parser.add_argument("--only", choices=KINDS, help="run this kind; other sections are kept")
    parser.add_argument("--count", type=int, help="problems of each kind, each in every tier")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=inf, help="stop after them, of each kind")
    parser.add_argument("--records", type=Path, help="folder of what has been counted, to go on from")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1, help="that run at a time")
    parser.add_argument("--page", type=Path, default=REPORT, help="written there; the default is in docs")
    arguments = parser.parse_args()
    asked: Sequence[Kind] = [arguments.only] if arguments.only else list(KINDS)
    found = sections(REPORT.read_text(encoding="utf-8"))
    wrong: list[str] = []
    for kind in asked:
        path = arguments.records / f"{kind}.json" if arguments.records else None
        seed, count = arguments.seed, arguments.count or KINDS[kind]

        def keep(record: Record | HostileRecord, path: Path | None = path) -> None:
            if path:
                path.write_text(json.dumps(record, default=vars))

        if kind == "hostile" or kind == "infinite" or kind == "cancellation":
            hostile = load_hostile(path, seed) if path else HostileRecord(seed)
            only = None if kind == "hostile" else kind
            measure_hostile(hostile, count, arguments.seconds, keep, only, arguments.processes)
            found[kind] = "\n".join(hostile_section(hostile, kind))
            wrong += [f"{row['kind']}: {faults_of(row)}" for row in hostile.rows if faults_of(row)]
            done, took = len(hostile.rows), hostile.seconds
        else:
            record = load(path, seed, kind) if path else Record(seed, kind)
            measure(record, count, arguments.seconds, keep, arguments.processes)
            found[kind] = "\n".join(_section(record))
            wrong += record.documents
            done, took = record.done, record.seconds
        say(f"{done} problems of the kind {kind} in {took:.0f} s: {arguments.page}")
    arguments.page.write_text(report(found), encoding="utf-8")
    for text in wrong:
        say(text)
    return 1 if wrong else 0


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
