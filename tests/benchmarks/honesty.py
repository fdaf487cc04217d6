"""``python -m tests.benchmarks.honesty``: is any claimed error exceeded? Written to docs/honesty.md.

Random problems are solved in every tier, as the service does. Smooth ones and motions through poles are
compared with the certified motion in balls, hostile ones with what is true of them by
their making. A claim is exceeded if the whole ball is further away than it. With
``--record FILE``, ``--passages-record FILE`` and ``--hostile-record FILE`` a run goes on where the last one
with those files stopped; what is asked no more of is written as it was counted. ``--only smooth``,
``--only passages`` or ``--only hostile`` runs and writes one section; the others stay as they are.
To run in the background in bounded time, and to go on later: ``--only smooth --seconds 3000 --record
build/honesty.json``.
"""

import argparse
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from math import inf
from pathlib import Path
from typing import Literal

from service.dynamics.numerics import NUMERICS
from service.dynamics.problem import Tier
from service.versions import version_of
from tests.benchmarks.honesty_counts import MOST, TIERS, Record, Tally, load, measure
from tests.benchmarks.honesty_page import MEASURED, NOT_COVERED, PASSAGES, PROVED, SMOOTH, TITLE
from tests.benchmarks.hostile_counts import HostileRecord, faults_of, load_hostile, measure_hostile
from tests.benchmarks.hostile_report import hostile_section
from tests.support.claims import BITS, CLAIMS, LATEST
from tests.support.hostile_ways import ROUNDS
from tests.support.random_documents import FAMILIES, SMALLEST_GAP, Family

REPORT = Path(__file__).parents[2] / "docs" / "honesty.md"
Kind = Literal["smooth", "passages", "hostile"]
HEADS: Mapping[Kind, str] = {
    "smooth": "## Smooth potentials\n",
    "passages": "## Motions through poles\n",
    "hostile": "## Hostile potentials\n",
}
"""Of the sections."""


def report(found: Mapping[Kind, str]) -> str:
    """Return the page with all of its sections."""
    return "\n".join(
        [
            TITLE.format(version=version_of("polhode"), numerics=NUMERICS),
            PROVED,
            MEASURED,
            NOT_COVERED.format(latest=10**LATEST, rounds=max(ROUNDS)),
            *(found[kind] for kind in HEADS),
        ]
    )


def sections(page: str) -> dict[Kind, str]:
    """Return the sections of a page as they were written."""
    starts = {kind: page.find(head) for kind, head in HEADS.items()}
    found: dict[Kind, str] = {}
    for kind, start in starts.items():
        end = min((other for other in starts.values() if other > start), default=len(page))
        found[kind] = page[start:end].removesuffix("\n") if start >= 0 else HEADS[kind]
    return found


def smooth_section(record: Record, families: Sequence[Family], text: str) -> list[str]:
    tiers = {tier: {name: record.tallies[f"{tier} {name}"] for name in families} for tier in TIERS}
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
        *_table(tiers),
        "",
        f"Problems by family and ends: {_listed(record.drawn)}.",
        "",
        f"Drawn without a reference, and so not counted above: {_listed(record.unknown)}.",
        "",
        *(line for tier in TIERS for line in _histograms(tier, tiers[tier].values())),
        "",
        *(
            ["### Exceeded", "", *(f"```\n{text}\n```" for text in record.documents), ""]
            * bool(record.documents)
        ),
    ]


def _table(tiers: Mapping[Tier, Mapping[Family, Tally]]) -> list[str]:
    lines = []
    for tier, tallies in tiers.items():
        whole = {"all": _total(tallies.values())} if len(tallies) > 1 else {}
        for family, tally in {**tallies, **whole}.items():
            asked = tally.solved + tally.refused.total()
            exceeded = f"{tally.exceeded.total()}" + (
                f" ({_listed(tally.exceeded)})" if tally.exceeded else ""
            )
            lines.append(
                f"| {tier} | {family} | {asked} | {tally.solved} | {_listed(tally.refused)} | {exceeded} "
                f"| {tally.smallest.get('samples', inf):.2g} | {_median(tally)} |"
            )
    return lines


def _median(tally: Tally) -> str:
    """Return the power of ten in which the median of claimed/actual of the samples lies."""
    powers = sorted(int(power) for power in tally.ratios["samples"].elements())
    return _range(powers[(len(powers) - 1) // 2]) if powers else "none"


def _total(tallies: Iterable[Tally]) -> Tally:
    total = Tally()
    for tally in tallies:
        total.add(tally)
    return total


def _histograms(tier: Tier, tallies: Iterable[Tally]) -> list[str]:
    total = _total(tallies)
    lines = ["", f"### {tier}"]
    for claim, what in CLAIMS.items():
        powers = {int(power): number for power, number in total.ratios[claim].items()}
        lines += ["", f"Claimed/actual of {what} (least {total.smallest.get(claim, inf):.3g}):", "", "```"]
        for power in range(min(powers), max(powers) + 1) if powers else ():
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
    parser.add_argument("--hostile", type=int, default=2000, help="hostile problems, each in every tier")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=inf, help="stop after them, of each kind")
    parser.add_argument("--record", type=Path, help="file of what has been counted, to go on from")
    parser.add_argument("--passages-record", type=Path, help="the same of motions through poles")
    parser.add_argument("--hostile-record", type=Path, help="the same of hostile problems")
    parser.add_argument("--only", choices=HEADS, help="run this kind; the section of the other one is kept")
    parser.add_argument("--page", type=Path, default=REPORT, help="written there; the default is in docs")
    arguments = parser.parse_args()
    asked: set[Kind] = {arguments.only} if arguments.only else set(HEADS)
    record = load(arguments.record, arguments.seed) if arguments.record else Record(arguments.seed)
    passages = Record(arguments.seed)
    if arguments.passages_record:
        passages = load(arguments.passages_record, arguments.seed)
    hostile = HostileRecord(arguments.seed)
    if arguments.hostile_record:
        hostile = load_hostile(arguments.hostile_record, arguments.seed)

    def keep(record: Record) -> None:
        if arguments.record:
            arguments.record.write_text(json.dumps(record, default=vars))

    def keep_passages(passages: Record) -> None:
        if arguments.passages_record:
            arguments.passages_record.write_text(json.dumps(passages, default=vars))

    def keep_hostile(hostile: HostileRecord) -> None:
        if arguments.hostile_record:
            arguments.hostile_record.write_text(json.dumps(vars(hostile)))

    found = sections(REPORT.read_text(encoding="utf-8"))
    if "smooth" in asked:
        measure(record, arguments.count, arguments.seconds, keep)
        found["smooth"] = "\n".join(smooth_section(record, FAMILIES, SMOOTH))
    if "passages" in asked:
        measure(passages, arguments.passages, arguments.seconds, keep_passages, "passage")
        found["passages"] = "\n".join(smooth_section(passages, ("passage",), PASSAGES))
    if "hostile" in asked:
        measure_hostile(hostile, arguments.hostile, arguments.seconds, keep_hostile)
        found["hostile"] = "\n".join(hostile_section(hostile))
    arguments.page.write_text(report(found), encoding="utf-8")
    told = [*record.documents, *passages.documents]
    for text in told:
        say(text)
    wrong = [row for row in hostile.rows if faults_of(row)]
    for row in wrong:
        say(f"{row['kind']}: {faults_of(row)}")
    say(f"{record.done} smooth problems in {record.seconds:.0f} s")
    say(f"{passages.done} motions through poles in {passages.seconds:.0f} s")
    say(f"{len(hostile.rows)} hostile problems in {hostile.seconds:.0f} s: {arguments.page}")
    return 1 if told or wrong else 0


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
