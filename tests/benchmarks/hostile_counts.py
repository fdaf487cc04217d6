"""What became of many hostile problems: counted, kept in a file, and gone on with."""

import json
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from queue import Queue
from typing import Any

from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from tests.support.hostile_judgement import TIME_LIMIT, facts_of, judged_tier, judged_verdict, limited

TIERS = ("draft", "standard", "high", "certified")
BOTH = "standard both"
"""The tier with a cross-check, of every so many problems."""
EVERY = 8
SECONDS = {"facts": 60.0, **dict.fromkeys(("verdict", *TIERS, BOTH), 20.0)}
"""Seconds of the processor after which a stage is stopped; it is counted as a refusal."""
BY_THE_CLOCK = 100
"""Times as long, by the clock, after which the child is killed: it is stuck, or hardly ever has its turn."""
ENDS = {SandboxTimeoutError: TIME_LIMIT, SandboxMemoryError: "memory limit", SandboxCrashError: "crash"}
SLOWEST = 10
PRELOAD = ("tests.support.hostile_judgement", "workers.solvers.compiled.solve")

Row = dict[str, Any]


@dataclass
class HostileRecord:
    """One row for every problem since number 0 of a seed."""

    seed: int
    seconds: float = 0.0
    rows: list[Row] = field(default_factory=list)


def measure_hostile(
    record: HostileRecord,
    count: int,
    seconds: float,
    keep: Callable[[HostileRecord], None],
    only: str | None = None,
    processes: int = 2,
) -> None:
    """Go on until problem ``count`` or until so many seconds have passed; ``keep`` is called now and then.

    ``only`` is a class of problems, ``processes`` the number of problems that are judged at a time.
    """
    began, before = time.perf_counter(), record.seconds
    # All stages of a problem in one child, which remembers what it has found of it.
    free: Queue[Sandbox] = Queue()
    for _ in range(processes):
        free.put(Sandbox(1, preload=PRELOAD))

    def row(index: int) -> Row:
        sandbox = free.get()
        try:
            return measured_row(sandbox, record.seed, index, only)
        finally:
            free.put(sandbox)

    try:
        with ThreadPoolExecutor(processes) as threads:
            while len(record.rows) < count and time.perf_counter() - began < seconds:
                first = len(record.rows)
                indices = range(first, min(count, first + 8 * processes))
                record.rows += threads.map(row, indices)
                record.seconds = before + time.perf_counter() - began
                keep(record)
    finally:
        while not free.empty():
            free.get().close()


def measured_row(sandbox: Sandbox, seed: int, index: int, only: str | None = None) -> Row:
    """Return what became of one problem."""

    def run(stage: str, function: Callable[..., str], *arguments: object) -> Row:
        own, clock = SECONDS[stage], SECONDS[stage] * BY_THE_CLOCK
        try:
            answer: Row = json.loads(sandbox.run(limited, own, function, *arguments, seconds=clock))
        except (SandboxTimeoutError, SandboxMemoryError, SandboxCrashError) as end:
            answer = {"code": ENDS[type(end)], "faults": [], "claims": {}, "seconds": own}
        except Exception as fault:
            # Nothing but a refusal with a code may end a problem.
            code, faults = type(fault).__name__, [f"exception: {fault!r}"]
            answer = {"code": code, "faults": faults, "claims": {}, "seconds": 0.0}
        return answer

    facts = run("facts", facts_of, seed, index, only)
    row: Row = {"index": index, "kind": facts.get("kind", "?"), "stages": {}, "unknown": None}
    if "kind" not in facts:
        return row | {"unknown": f"{facts['code']} of the reference"}
    row |= {"truth": facts["truth"], "reason": facts["reason"], "unknown": facts["unknown"]}
    text = json.dumps(facts)
    row["stages"]["verdict"] = run("verdict", judged_verdict, text)
    if facts["motion"] is not None:
        for tier in (*TIERS, BOTH) if index % EVERY == 0 else TIERS:
            row["stages"][tier] = run(tier, judged_tier, text, tier)
    if any(stage["faults"] for stage in row["stages"].values()):
        document = facts["document"]
        if facts["motion"] is not None:
            document = {**facts["motion"]["document"], "time": {"times": facts["motion"]["times"]}}
        row["document"] = json.dumps(document)
    return row


def load_hostile(path: Path, seed: int) -> HostileRecord:
    """Return the record in a file, a new one if there is none.

    Raises
    ------
    ValueError
        It belongs to another seed.
    """
    if not path.exists():
        return HostileRecord(seed)
    record = HostileRecord(**json.loads(path.read_text()))
    if record.seed != seed:
        raise ValueError(f"{path} belongs to the seed {record.seed}")
    return record


def faults_of(row: Row) -> list[tuple[str, str]]:
    """Return the stages and what is wrong in them."""
    return [(stage, fault) for stage, answer in row["stages"].items() for fault in answer["faults"]]
