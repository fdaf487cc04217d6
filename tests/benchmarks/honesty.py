"""``python -m tests.benchmarks.honesty``: is any claimed error exceeded? Written to docs/honesty.md.

Random problems are solved in every tier, as the service does; the reference is
the certified motion in balls. A claim is exceeded if the whole ball is further
away than it. With ``--record FILE`` a run goes on where the last one with that
file stopped.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from math import inf
from pathlib import Path

from service.dynamics.numerics import NUMERICS
from service.dynamics.problem import Tier
from tests.benchmarks.honesty_counts import MOST, TIERS, Record, Tally, load, measure
from tests.support.claims import BITS, CLAIMS, LATEST
from tests.support.random_documents import FAMILIES, SMALLEST_GAP

REPORT = Path(__file__).parents[2] / "docs" / "honesty.md"


def report(record: Record) -> str:
    """Return the page."""
    tiers = {tier: [record.tallies[f"{tier} {family}"] for family in FAMILIES] for tier in TIERS}
    return "\n".join(
        [
            INTRODUCTION.format(
                seed=record.seed,
                done=record.done,
                minutes=record.seconds / 60,
                version=version("polhode"),
                numerics=NUMERICS,
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
            NOT_COVERED,
            *(line for tier in TIERS for line in _histograms(tier, tiers[tier])),
            *(
                ["## Exceeded", "", *(f"```\n{text}\n```" for text in record.documents)]
                * bool(record.documents)
            ),
            "",
        ]
    )


INTRODUCTION = """# Are the claimed errors true?

Written by `python -m tests.benchmarks.honesty`: the first {done} problems of the seed {seed}, in
{minutes:.0f} minutes; version {version}, numerics {numerics}. Every problem is solved in each tier the way
the service does it, and compared with the certified motion in balls of {bits} bits. Bodies, coefficients,
curves, windows, starts and signs are random; gaps to separatrices, to the equator and to the pole go
down to 1e{smallest:.0f}; the times are 0, some within one period and some up to {latest:.0f} periods, one in
five times backwards. A claim is exceeded if the true number is proven to be further away; smallest is
the least claimed/actual of the samples. Samples that are rounded enclosures claim what they miss, a ratio
of 1; they are of 64 bits, and the reference is made anew in 128.

| tier | family | asked | solved | refused | exceeded | smallest |
| --- | --- | --- | --- | --- | --- | --- |"""

NOT_COVERED = """Not covered, for want of a reference: potentials given by an integral, motions that pass
a pole with A/C (or C/A) no whole number, aperiodic motions, motions from any state, the orientation.
The verdict is not asked: all potentials are admissible by their making."""


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
    lines = ["", f"## {tier}"]
    for claim, what in CLAIMS.items():
        powers = {int(power): number for power, number in total.ratios[claim].items()}
        lines += ["", f"Claimed/actual of {what} (least {total.smallest.get(claim, inf):.3g}):", "", "```"]
        for power in range(min(powers, default=0), max(powers, default=0) + 1):
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
    """Measure and write; 1 if a claim is exceeded."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.honesty", description=__doc__)
    parser.add_argument("--count", type=int, default=10_000, help="problems, each solved in every tier")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=inf, help="stop after them")
    parser.add_argument("--record", type=Path, help="file of what has been counted, to go on from")
    arguments = parser.parse_args()
    record = load(arguments.record, arguments.seed) if arguments.record else Record(arguments.seed)

    def keep(record: Record) -> None:
        if arguments.record:
            arguments.record.write_text(json.dumps(record, default=vars))

    measure(record, arguments.count, arguments.seconds, keep)
    REPORT.write_text(report(record))
    for text in record.documents:
        say(text)
    say(f"{record.done} problems in {record.seconds:.0f} s: {REPORT}")
    return 1 if record.documents else 0


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
