"""What became of the claims of many random problems: counted, kept in a file, and gone on with."""

import json
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, field
from math import floor, inf, isnan, log10
from pathlib import Path
from typing import Literal

import numpy as np

from service.dynamics.errors import DynamicsError
from service.dynamics.problem import Tier
from tests.support import random_motions, random_states
from tests.support.claims import CLAIMS, Case, Claim, claims_of, make_case
from tests.support.random_documents import EVERY, FAMILIES, Family
from tests.support.random_motions import MotionCase, draw_motion
from tests.support.random_states import StateCase, claims_of_state, draw_state
from workers.computation.compiled_code import keep_compiled_code

TIERS: tuple[Tier, ...] = ("draft", "standard", "high")
TOGETHER = 20
"""Problems that one process takes at a time."""
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
    seconds: float = 0.0
    """Time of the processor that it took, comparing included."""

    def count(self, claim: str, claimed: float, actual: float) -> None:
        """Count one claim and what it claims the bound of."""
        if isnan(actual):
            return
        ratio = claimed / actual if actual else inf
        power = min(MOST, floor(log10(ratio))) if 0.0 < ratio < inf else MOST if ratio else -MOST
        self.ratios[claim][str(power)] += 1
        self.smallest[claim] = min(ratio, self.smallest.get(claim, inf))

    def add(self, other: "Tally") -> None:
        """Count what another has counted."""
        self.solved += other.solved
        self.seconds += other.seconds
        self.refused += other.refused
        self.exceeded += other.exceeded
        for name, ratio in other.smallest.items():
            self.smallest[name] = min(ratio, self.smallest.get(name, inf))
        for name, powers in other.ratios.items():
            # Records of an earlier form know fewer claims.
            self.ratios[name] = self.ratios.get(name, Counter[str]()) + powers


AnyCase = Case | StateCase | MotionCase
Subject = Literal["smooth", "passages", "states", "motions"]
SUBJECTS: Mapping[Subject, tuple[str, ...]] = {
    "smooth": FAMILIES,
    "passages": ("passage",),
    "states": random_states.KINDS,
    "motions": random_motions.KINDS,
}
"""What problems are about, and their families."""


@dataclass
class Record:
    """Everything counted since problem 0 of a seed."""

    seed: int
    subject: Subject = "smooth"
    done: int = 0
    seconds: float = 0.0
    drawn: Counter[str] = field(default_factory=Counter)
    """Numbers of problems by family and ends."""
    unknown: Counter[str] = field(default_factory=Counter)
    """Problems without a reference, by family and code."""
    tallies: dict[str, Tally] = field(default_factory=dict)
    documents: list[str] = field(default_factory=list)
    """Problems with a claim that is exceeded, or that ended in something else than a refusal."""

    def __post_init__(self) -> None:
        for name in (f"{tier} {family}" for tier in TIERS for family in SUBJECTS[self.subject]):
            self.tallies.setdefault(name, Tally())

    def add(self, part: "Record") -> None:
        """Go on by the problems that were counted next."""
        self.done += part.done
        self.drawn += part.drawn
        self.unknown += part.unknown
        for name, tally in part.tallies.items():
            self.tallies[name].add(tally)
        self.documents += part.documents


def family_of(index: int) -> Family:
    """Return the family of a problem."""
    return ROTA.get(index % 80, "three-term")


def measure(
    record: Record, count: int, seconds: float, keep: Callable[[Record], None], processes: int
) -> None:
    """Go on, in so many processes, until problem ``count`` or until so many seconds have passed.

    ``keep`` is called with the record whenever some more are counted.
    """
    began, before, asked = time.perf_counter(), record.seconds, record.done
    running: deque[Future[Record]] = deque()
    with ProcessPoolExecutor(processes) as pool:
        while True:
            while len(running) < 2 * processes and asked < count:
                if time.perf_counter() - began > seconds:
                    break
                following = min(count, asked + TOGETHER)
                running.append(pool.submit(measured, record.subject, record.seed, asked, following))
                asked = following
            if not running:
                break
            # In their order: what is kept is always the first so many.
            record.add(running.popleft().result())
            record.seconds = before + time.perf_counter() - began
            keep(record)


def measured(subject: Subject, seed: int, first: int, last: int) -> Record:
    """Count the problems of a seed from number ``first`` to before ``last``."""
    # References ask kernels before any solver does: without this they are compiled in every process anew.
    keep_compiled_code()
    part = Record(seed, subject)
    for index in range(first, last):
        _measure_one(part, index, np.random.default_rng([seed, index]))
        part.done += 1
    return part


def _measure_one(record: Record, index: int, draws: np.random.Generator) -> None:
    families = SUBJECTS[record.subject]
    family = family_of(index) if record.subject == "smooth" else families[index % len(families)]
    try:
        case = _drawn(family, draws)
    except DynamicsError as refusal:
        record.unknown[f"{family}: {refusal.code}"] += 1
        return
    except Exception as fault:
        record.unknown[f"{family}: {type(fault).__name__}"] += 1
        record.documents.append(f"no reference for a problem of {family}: {fault!r}")
        return
    record.drawn[f"{family}: {case.about}"] += 1
    for tier in TIERS:
        tally = record.tallies[f"{tier} {family}"]
        began = time.process_time()
        try:
            claims = _claims(case, tier)
        except DynamicsError as refusal:
            tally.refused[refusal.code] += 1
            continue
        except Exception as fault:
            # Nothing but a refusal with a code may end a problem: it is told, and the run goes on.
            tally.refused[type(fault).__name__] += 1
            _tell(record, f"{type(fault).__name__}: {fault}", case, tier)
            continue
        finally:
            tally.seconds += time.process_time() - began
        tally.solved += 1
        for claim in claims:
            tally.count(claim.name, claim.claimed, claim.actual)
            if claim.is_exceeded:
                tally.exceeded[claim.name] += 1
                told = f"{claim.name}: claimed {claim.claimed:.3e}, actual {claim.actual:.3e}"
                _tell(record, told, case, tier)


def _drawn(family: str, draws: np.random.Generator) -> AnyCase:
    for name in EVERY:
        if name == family:
            return make_case(name, draws)
    for kind in random_states.KINDS:
        if kind == family:
            return draw_state(kind, draws)
    return draw_motion(next(kind for kind in random_motions.KINDS if kind == family), draws)


def _claims(case: AnyCase, tier: Tier) -> list[Claim]:
    if isinstance(case, MotionCase):
        return case.claims(tier)
    return claims_of(case, tier) if isinstance(case, Case) else claims_of_state(case, tier)


def _tell(record: Record, what: str, case: AnyCase, tier: Tier) -> None:
    record.documents.append(f"{what}\n{json.dumps(case.document(tier))}")


def load(path: Path, seed: int, subject: Subject) -> Record:
    """Return the record in a file, a new one if there is none.

    Raises
    ------
    ValueError
        It belongs to another seed.
    """
    if not path.exists():
        return Record(seed, subject)
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
            tally["seconds"],
        )
        for name, tally in read.pop("tallies").items()
    }
    drawn, unknown = Counter(read.pop("drawn")), Counter(read.pop("unknown"))
    return Record(**read, drawn=drawn, unknown=unknown, tallies=tallies)
