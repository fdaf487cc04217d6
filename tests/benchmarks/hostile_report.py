"""The part of docs/honesty.md about hostile problems."""

from collections import Counter
from collections.abc import Mapping, Sequence
from math import inf, isnan

from service.dynamics.numerics import NUMERICS
from tests.benchmarks.hostile_counts import (
    BOTH,
    EVERY,
    SECONDS,
    SLOWEST,
    TIERS,
    HostileRecord,
    Row,
    faults_of,
)
from tests.support.claims import UNSEEN

EFFECTS = ("wall", "well", "small")
TIER_COLUMNS = (
    "tier",
    "class",
    "asked",
    "solved",
    "refused",
    "exceeded",
    "window wrong",
    "other faults",
    "smallest",
    "seconds",
)


def group_of(kind: str) -> str:
    """Return the class without what the feature does to p²."""
    words = kind.split()
    return " ".join(words[:-1] if words[-1] in EFFECTS else words)


def hostile_section(record: HostileRecord, kind: str = "hostile") -> list[str]:
    """Return the lines of the section about hostile problems, or about a class of them."""
    rows = record.rows
    wrong = [row for row in rows if faults_of(row)]
    effects = Counter(row["kind"].split()[-1] for row in rows if row["kind"].split()[-1] in EFFECTS)
    unknown = Counter(row["unknown"] for row in rows if row["unknown"])
    return [
        INTRODUCTIONS[kind].format(
            count=len(rows),
            seed=record.seed,
            minutes=record.seconds / 60,
            numerics=NUMERICS,
            every=EVERY,
            limit=SECONDS["standard"],
            walls=effects["wall"],
            wells=effects["well"],
            small=effects["small"],
            wrong=len(wrong),
        ),
        "### Verdicts and windows",
        "",
        "| class | asked | admissible | inadmissible | undecided | refused | verdict wrong | windows wrong |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
        *(_verdict_line(name, part) for name, part in _groups(rows)),
        "",
        f"Problems without a complete reference, whose verdicts are judged all the same: {_listed(unknown)}.",
        "",
        "### Motions",
        "",
        f"| {' | '.join(TIER_COLUMNS)} |",
        "|" + " --- |" * len(TIER_COLUMNS),
        *(
            _tier_line(tier, name, part)
            for tier in (*TIERS, BOTH)
            for name, part in _groups([row for row in rows if tier in row["stages"]])
        ),
        "",
        f"The {SLOWEST} slowest answers: {_slowest(rows)}.",
        *_wrong(wrong),
        "",
    ]


_HOSTILE = """## Hostile potentials

The first {count} problems of the seed {seed}, in {minutes:.0f} minutes. A smooth admissible potential
gets a feature at a random place, of a width from 1e-1 to 1e-8: gaussians, rational bumps, steps,
packets of waves, spikes, flat holes, kinks, caps that are 0 elsewhere, poles beside the sphere, two
features at once, zeros of infinite order; some are smooth but for a kink, and written in a formula of which
most cancels on the sphere, or hides there. {walls} are walls that part a window, {wells} are wells that open
one, and {small} change p² by a part of itself, down to 1e-6 of it. Kinks lie on circles of g2, on
curves, and across curves, where some cancel. What is not admissible is so by its making: another factor
than A g1² + C g3², a feature of an angle, a kink across the curves; some of it is 0, or less than
1e-1000, nearly everywhere.

What is true of a problem follows from its making, by code that shares nothing with the service
(`tests/support/hostile_*.py`): zeros of p² are isolated by subdivision in balls of 192 bits with cells that
end at the features, times are integrals with a rigorous bound, and states are asked at times at
which they are known. A window is wrong if one is missed or invented, or if an end differs by more
than 1e-11. A verdict is wrong if it says the contrary of the truth; undecided is counted, and is not wrong. A
claim is exceeded as above. One problem in {every} is cross-checked too (`"method": "both"`); to agree with a
wrong motion is a fault there. What takes longer than {limit:.0f} s of processor time
is stopped and counted as refused (time limit). All tiers of a problem are solved in one process, which
remembers its verdict, windows and time map, as the service does: what is the same is not computed twice.

**Problems with a fault: {wrong}.**
"""
_INFINITE = """## Poles of G

The first {count} problems of this class of the seed {seed}, in {minutes:.0f} minutes, numerics {numerics}:
a smooth admissible potential, and at one place of the sphere, or two, p² is infinite like 1/t, 1/t² or 1/t³,
with residues from walls down to 1e-6 of p². Motions end there in a collision, whose time is asked for. The
truth is found as that of hostile potentials, and what is counted is the same.

**Problems with a fault: {wrong}.**
"""
_CANCELLATION = """## Potentials written with cancellation

The first {count} problems of this class of the seed {seed}, in {minutes:.0f} minutes, numerics {numerics}:
a smooth admissible potential, three in ten with a kink, in a formula of which most cancels on the sphere (up
to 1e9 times what is left), or hides there under a root, a power, a sine or a logarithm. The truth is found as
that of hostile potentials, and what is counted is the same.

**Problems with a fault: {wrong}.**
"""
INTRODUCTIONS = {"hostile": _HOSTILE, "infinite": _INFINITE, "cancellation": _CANCELLATION}
"""The first words of each section."""


def _groups(rows: Sequence[Row]) -> list[tuple[str, list[Row]]]:
    names = sorted({group_of(row["kind"]) for row in rows})
    parts = [(name, [row for row in rows if group_of(row["kind"]) == name]) for name in names]
    return [*parts, ("all", list(rows))] if parts else []


def _verdict_line(name: str, rows: Sequence[Row]) -> str:
    stages = [row["stages"]["verdict"] for row in rows if "verdict" in row["stages"]]
    said = Counter(stage.get("verdict") for stage in stages)
    codes = Counter(stage["code"] for stage in stages if stage["code"])
    faults = _kinds(stages)
    return (
        f"| {name} | {len(stages)} | {said['admissible']} | {said['inadmissible']} | {said['undecided']} "
        f"| {_listed(codes)} | {faults['verdict'] + faults['exception']} | {faults['windows']} |"
    )


def _tier_line(tier: str, name: str, rows: Sequence[Row]) -> str:
    stages = [row["stages"][tier] for row in rows]
    codes = Counter(stage["code"] for stage in stages if stage["code"])
    faults = _kinds(stages)
    window, exceeded = faults.pop("window", 0), sum(any(map(_is_claim, s["faults"])) for s in stages)
    others = Counter({kind: n for kind, n in faults.items() if kind in ("exception", "cross-check")})
    return (
        f"| {tier} | {name} | {len(stages)} | {len(stages) - codes.total()} | {_listed(codes)} | {exceeded} "
        f"| {window} | {_listed(others)} | {min(map(_smallest, stages), default=inf):.2g} "
        f"| {sum(stage['seconds'] for stage in stages) / max(1, len(stages)):.2g} |"
    )


def _is_claim(fault: str) -> bool:
    return ": claimed " in fault


def _kinds(stages: Sequence[Row]) -> Counter[str]:
    return Counter(fault.partition(":")[0] for stage in stages for fault in stage["faults"])


def _smallest(stage: Row) -> float:
    """Return claimed/actual of the samples."""
    if "samples" not in stage["claims"]:
        return inf
    claimed, actual = stage["claims"]["samples"]
    return 0.0 if isnan(actual) else float(claimed / max(actual, UNSEEN))


def _slowest(rows: Sequence[Row]) -> str:
    took = [(stage["seconds"], name, row["kind"]) for row in rows for name, stage in row["stages"].items()]
    took.sort(reverse=True)
    return ", ".join(f"{seconds:.1f} s ({kind}, {name})" for seconds, name, kind in took[:SLOWEST])


def _wrong(rows: Sequence[Row]) -> list[str]:
    lines = []
    for row in rows:
        faults = "\n".join(f"{stage}: {fault}" for stage, fault in faults_of(row))
        lines += ["", f"```\n{row['kind']}\n{faults}\n{row['document']}\n```"]
    return ["", "### Wrong", *lines] if lines else []


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {number}" for name, number in sorted(counts.items())) or "none"
