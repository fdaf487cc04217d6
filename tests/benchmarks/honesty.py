"""``python -m tests.benchmarks.honesty``: is any claimed error exceeded? Written to docs/honesty.md.

Random problems are solved in every tier, as the service does. Smooth ones and motions through poles are
compared with the certified motion in balls, motions from states with series in long integers, hostile ones
with what is true of them by their making. A claim is exceeded if the whole ball is further away than it. With
``--record FILE``, ``--passages-record FILE``, ``--states-record FILE``, ``--motions-record FILE`` and
``--hostile-record FILE`` a run
goes on where the last one with those files stopped; what is asked no more of is written as it was counted.
``--only smooth``, for example, runs and writes one section; the others stay as they are on the page. To run
in the background in bounded time, and go on later: ``--only smooth --seconds 3000 --record F``.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from math import inf
from pathlib import Path
from typing import Literal

from service.dynamics.numerics import NUMERICS
from service.dynamics.problem import Tier
from service.versions import version_of
from tests.benchmarks.honesty_counts import MOST, SUBJECTS, TIERS, Record, Subject, Tally, load, measure
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
from tests.support.claims import BITS, CLAIMS, LATEST
from tests.support.hostile_documents import ONLY
from tests.support.hostile_ways import ROUNDS
from tests.support.random_documents import SMALLEST_GAP

REPORT = Path(__file__).parents[2] / "docs" / "honesty.md"
Kind = Literal["smooth", "passages", "states", "motions", "hostile"]
HEADS: Mapping[Kind, str] = {
    "smooth": "## Smooth potentials\n",
    "passages": "## Motions through poles\n",
    "states": "## Motions from states next to unstable ones\n",
    "motions": "## Motions of every sort, attitudes and multipliers\n",
    "hostile": "## Hostile potentials\n",
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


def smooth_section(record: Record, text: str) -> list[str]:
    """Return a section about planar motions that are compared with enclosures."""
    return [
        text.format(
            seed=record.seed,
            done=record.done,
            minutes=record.seconds / 60,
            bits=BITS,
            latest=10**LATEST,
            smallest=SMALLEST_GAP,
            numerics=NUMERICS,
        ),
        *_counted(record, f"Problems by family and ends: {_listed(record.drawn)}."),
    ]


def states_section(record: Record) -> list[str]:
    """Return the section about motions from states."""
    return [
        STATES.format(
            seed=record.seed,
            done=record.done,
            minutes=record.seconds / 60,
            narrowest=random_states.NARROWEST,
            passages=random_states.PASSAGES,
            latest=random_states.LAST,
            numerics=NUMERICS,
        ),
        *_counted(record, f"Motions: {_listed(record.drawn)}."),
    ]


def motions_section(record: Record) -> list[str]:
    """Return the section about motions of every sort."""
    return [
        MOTIONS.format(
            seed=record.seed,
            done=record.done,
            minutes=record.seconds / 60,
            latest=random_motions.LATEST,
            radians=random_motions.MOST_RADIANS,
            fastest=random_motions.FASTEST,
            numerics=NUMERICS,
        ),
        *_counted(record, f"Motions: {_listed(record.drawn)}."),
    ]


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
                f"| {_smallest(tally):.2g} | {_median(tally)} |"
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
    parser.add_argument("--count", type=int, default=10_000, help="smooth problems, each in every tier")
    parser.add_argument("--passages", type=int, default=2000, help="motions through poles, in every tier")
    parser.add_argument("--states", type=int, default=5000, help="motions from states, each in every tier")
    parser.add_argument("--motions", type=int, default=2000, help="motions of every sort, in every tier")
    parser.add_argument("--hostile", type=int, default=2000, help="hostile problems, each in every tier")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=inf, help="stop after them, of each kind")
    parser.add_argument("--record", type=Path, help="file of what has been counted, to go on from")
    parser.add_argument("--passages-record", type=Path, help="the same of motions through poles")
    parser.add_argument("--states-record", type=Path, help="the same of motions from states")
    parser.add_argument("--motions-record", type=Path, help="the same of motions of every sort")
    parser.add_argument("--processes", type=int, help="of all kinds but hostile ones; all processors")
    parser.add_argument("--hostile-record", type=Path, help="the same of hostile problems")
    parser.add_argument("--only", choices=HEADS, help="run this kind; other sections are kept")
    parser.add_argument("--class", dest="only_class", choices=ONLY, help="of hostile problems")
    parser.add_argument("--page", type=Path, default=REPORT, help="written there; the default is in docs")
    arguments = parser.parse_args()
    asked: set[Kind] = {arguments.only} if arguments.only else set(HEADS)
    files: dict[Subject, Path | None] = {
        "smooth": arguments.record,
        "passages": arguments.passages_record,
        "states": arguments.states_record,
        "motions": arguments.motions_record,
    }
    records = {
        subject: load(path, arguments.seed, subject) if path else Record(arguments.seed, subject)
        for subject, path in files.items()
    }
    hostile = HostileRecord(arguments.seed)
    if arguments.hostile_record:
        hostile = load_hostile(arguments.hostile_record, arguments.seed)

    def keep(record: Record) -> None:
        path = files[record.subject]
        if path:
            path.write_text(json.dumps(record, default=vars))

    def keep_hostile(hostile: HostileRecord) -> None:
        if arguments.hostile_record:
            arguments.hostile_record.write_text(json.dumps(vars(hostile)))

    found = sections(REPORT.read_text(encoding="utf-8"))
    if "smooth" in asked:
        measure(records["smooth"], arguments.count, arguments.seconds, keep, arguments.processes)
        found["smooth"] = "\n".join(smooth_section(records["smooth"], SMOOTH))
    if "passages" in asked:
        measure(records["passages"], arguments.passages, arguments.seconds, keep, arguments.processes)
        found["passages"] = "\n".join(smooth_section(records["passages"], PASSAGES))
    if "states" in asked:
        measure(records["states"], arguments.states, arguments.seconds, keep, arguments.processes)
        found["states"] = "\n".join(states_section(records["states"]))
    if "motions" in asked:
        measure(records["motions"], arguments.motions, arguments.seconds, keep, arguments.processes)
        found["motions"] = "\n".join(motions_section(records["motions"]))
    if "hostile" in asked:
        measure_hostile(hostile, arguments.hostile, arguments.seconds, keep_hostile, arguments.only_class)
        found["hostile"] = "\n".join(hostile_section(hostile))
    arguments.page.write_text(report(found), encoding="utf-8")
    exceeded = [text for record in records.values() for text in record.documents]
    for text in exceeded:
        say(text)
    wrong = [row for row in hostile.rows if faults_of(row)]
    for row in wrong:
        say(f"{row['kind']}: {faults_of(row)}")
    for subject, record in records.items():
        say(f"{record.done} problems about {subject} in {record.seconds:.0f} s")
    say(f"{len(hostile.rows)} hostile problems in {hostile.seconds:.0f} s: {arguments.page}")
    return 1 if exceeded or wrong else 0


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
