"""What became of the claims of many random problems: counted, kept in a file, and gone on with."""

import json
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import floor, inf, isnan, log10
from pathlib import Path

import numpy as np

from service.dynamics.errors import DynamicsError
from service.dynamics.problem import Tier
from tests.support.claims import CLAIMS, Case, claims_of, make_case
from tests.support.random_documents import FAMILIES, Family

TIERS: tuple[Tier, ...] = ("draft", "standard", "high")
MOST = 12
"""Powers of ten from which on ratios are counted together."""

ROTA: Mapping[int, Family] = {
    0: "rational",
    1: "homogeneous",
    2: "homogeneous",
    3: "formula",
    4: "formula",
}
"""Families of the first of every 80 problems; the others have three terms, and are solved fast."""


@dataclass
class Tally:
    """What became of one tier on one family."""

    solved: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    exceeded: Counter[str] = field(default_factory=Counter)
    """Claims, by their names."""
    smallest: dict[str, float] = field(default_factory=dict)
    """Smallest claimed/actual."""
    ratios: dict[str, Counter[str]] = field(default_factory=lambda: {name: Counter() for name in CLAIMS})
    """How often floor(log10(claimed/actual)) was seen."""

    def count(self, claim: str, claimed: float, actual: float) -> None:
        """Count one claim and what it claims the bound of."""
        if isnan(actual):
            return
        ratio = claimed / actual if actual else inf
        power = min(MOST, floor(log10(ratio))) if 0.0 < ratio < inf else MOST if ratio else -MOST
        self.ratios[claim][str(power)] += 1
        self.smallest[claim] = min(ratio, self.smallest.get(claim, inf))


@dataclass
class Record:
    """Everything counted since problem 0 of a seed."""

    seed: int
    done: int = 0
    seconds: float = 0.0
    drawn: Counter[str] = field(default_factory=Counter)
    """By family and ends."""
    unknown: Counter[str] = field(default_factory=Counter)
    """Problems without a reference, by family and code."""
    tallies: dict[str, Tally] = field(
        default_factory=lambda: {f"{tier} {family}": Tally() for tier in TIERS for family in FAMILIES}
    )
    documents: list[str] = field(default_factory=list)
    """Those with a claim that is exceeded, or that ended in something else than a refusal."""


def family_of(index: int) -> Family:
    """Return the family of a problem."""
    return ROTA.get(index % 80, "three-term")


def measure(record: Record, count: int, seconds: float) -> None:
    """Go on until problem ``count`` or until so many seconds have passed."""
    began = time.perf_counter()
    before = record.seconds
    while record.done < count and time.perf_counter() - began < seconds:
        index = record.done
        _measure_one(record, family_of(index), np.random.default_rng([record.seed, index]))
        record.done += 1
        record.seconds = before + time.perf_counter() - began


def _measure_one(record: Record, family: Family, draws: np.random.Generator) -> None:
    try:
        case = make_case(family, draws)
    except DynamicsError as refusal:
        record.unknown[f"{family}: {refusal.code}"] += 1
        return
    record.drawn[f"{family}: {' to '.join(case.drawn.window.ends)}"] += 1
    for tier in TIERS:
        tally = record.tallies[f"{tier} {family}"]
        try:
            claims = claims_of(case, tier)
        except DynamicsError as refusal:
            tally.refused[refusal.code] += 1
            continue
        except Exception as fault:
            # Nothing but a refusal with a code may end a problem: it is told, and the run goes on.
            tally.refused[type(fault).__name__] += 1
            _tell(record, f"{type(fault).__name__}: {fault}", case, tier)
            continue
        tally.solved += 1
        for claim in claims:
            tally.count(claim.name, claim.claimed, claim.actual)
            if claim.is_exceeded:
                tally.exceeded[claim.name] += 1
                told = f"{claim.name}: claimed {claim.claimed:.3e}, actual {claim.actual:.3e}"
                _tell(record, told, case, tier)


def _tell(record: Record, what: str, case: Case, tier: Tier) -> None:
    record.documents.append(f"{what}\n{json.dumps(case.document(tier))}")


def load(path: Path, seed: int) -> Record:
    """Return the record in a file, a new one if there is none.

    Raises
    ------
    ValueError
        It belongs to another seed.
    """
    if not path.exists():
        return Record(seed)
    read = json.loads(path.read_text())
    if read["seed"] != seed:
        raise ValueError(f"{path} belongs to the seed {read['seed']}")
    tallies = {
        name: Tally(
            tally["solved"],
            Counter(tally["refused"]),
            Counter(tally["exceeded"]),
            tally["smallest"],
            {claim: Counter(powers) for claim, powers in tally["ratios"].items()},
        )
        for name, tally in read.pop("tallies").items()
    }
    drawn, unknown = Counter(read.pop("drawn")), Counter(read.pop("unknown"))
    return Record(**read, drawn=drawn, unknown=unknown, tallies=tallies)
