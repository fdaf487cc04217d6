"""``python -m tests.benchmarks.honesty``: is any claimed error exceeded? Written to docs/honesty.md.

Random problems are solved in every tier, as the service does. Smooth ones are
compared with the certified motion in balls, hostile ones with what is true of them by
their making. A claim is exceeded if the whole ball is further away than it. With
``--record FILE`` and ``--hostile-record FILE`` a run goes on where the last one with
those files stopped; what is asked no more of is written as it was counted.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from math import inf
from pathlib import Path

from service.dynamics.numerics import NUMERICS
from service.dynamics.problem import Tier
from service.versions import version_of
from tests.benchmarks.honesty_counts import MOST, TIERS, Record, Tally, load, measure
from tests.benchmarks.honesty_page import MEASURED, NOT_COVERED, PROVED, SMOOTH, TITLE
from tests.benchmarks.hostile_counts import HostileRecord, faults_of, load_hostile, measure_hostile
from tests.benchmarks.hostile_report import hostile_section
from tests.support.claims import BITS, CLAIMS, LATEST
from tests.support.hostile_ways import ROUNDS
from tests.support.random_documents import FAMILIES, SMALLEST_GAP

REPORT = Path(__file__).parents[2] / "docs" / "honesty.md"


def report(record: Record, hostile: HostileRecord) -> str:
    """Return the page."""
    return "\n".join(
        [
            TITLE.format(version=version_of("polhode"), numerics=NUMERICS),
            PROVED,
            MEASURED,
            NOT_COVERED.format(latest=10**LATEST, rounds=max(ROUNDS)),
            *_smooth_section(record),
            *hostile_section(hostile),
        ]
    )


def _smooth_section(record: Record) -> list[str]:
    tiers = {tier: [record.tallies[f"{tier} {family}"] for family in FAMILIES] for tier in TIERS}
    return [
        SMOOTH.format(
            seed=record.seed,
            done=record.done,
            minutes=record.seconds / 60,
            bits=BITS,
            latest=10**LATEST,
            smallest=SMALLEST_GAP,
        ),
        *_table(tiers),
        "",
        f"Problems by family and ends: {_listed(record.drawn)}.",
        "",
        f"Drawn without a reference, and so not counted above: {_listed(record.unknown)}.",
        "",
        *(line for tier in TIERS for line in _histograms(tier, tiers[tier])),
        "",
        *(
            ["### Exceeded", "", *(f"```\n{text}\n```" for text in record.documents), ""]
            * bool(record.documents)
        ),
    ]


def _table(tiers: Mapping[Tier, Sequence[Tally]]) -> list[str]:
    lines = []
    for tier, tallies in tiers.items():
        for family, tally in zip((*FAMILIES, "all"), (*tallies, _total(tallies)), strict=True):
            asked = tally.solved + tally.refused.total()
            exceeded = f"{tally.exceeded.total()}" + (
                f" ({_listed(tally.exceeded)})" if tally.exceeded else ""
            )
            lines.append(
                f"| {tier} | {family} | {asked} | {tally.solved} | {_listed(tally.refused)} | {exceeded} "
                f"| {tally.smallest.get('samples', inf):.2g} |"
            )
    return lines


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
    parser.add_argument("--hostile", type=int, default=2000, help="hostile problems, each in every tier")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=inf, help="stop after them, of each kind")
    parser.add_argument("--record", type=Path, help="file of what has been counted, to go on from")
    parser.add_argument("--hostile-record", type=Path, help="the same of hostile problems")
    arguments = parser.parse_args()
    record = load(arguments.record, arguments.seed) if arguments.record else Record(arguments.seed)
    hostile = HostileRecord(arguments.seed)
    if arguments.hostile_record:
        hostile = load_hostile(arguments.hostile_record, arguments.seed)

    def keep(record: Record) -> None:
        if arguments.record:
            arguments.record.write_text(json.dumps(record, default=vars))

    def keep_hostile(hostile: HostileRecord) -> None:
        if arguments.hostile_record:
            arguments.hostile_record.write_text(json.dumps(vars(hostile)))

    measure(record, arguments.count, arguments.seconds, keep)
    measure_hostile(hostile, arguments.hostile, arguments.seconds, keep_hostile)
    REPORT.write_text(report(record, hostile))
    for text in record.documents:
        say(text)
    wrong = [row for row in hostile.rows if faults_of(row)]
    for row in wrong:
        say(f"{row['kind']}: {faults_of(row)}")
    say(f"{record.done} smooth problems in {record.seconds:.0f} s")
    say(f"{len(hostile.rows)} hostile problems in {hostile.seconds:.0f} s: {REPORT}")
    return 1 if record.documents or wrong else 0


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
