"""``python -m tests.benchmarks.hard``: hard problems asked of a running service, written to docs/hard.md.

``--only families`` asks one kind; the others stay as they are on the page.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flint import arb, ctx

from tests.benchmarks.measuring import say
from tests.benchmarks.pages import framed, replaced
from tests.benchmarks.report import ROOT
from tests.support.hard_problems import KINDS, Document, Hard
from tests.support.serving import Service, serving

PAGE = ROOT / "docs" / "hard.md"
PATIENCE = 60.0
"""Processor seconds after which a job is cancelled, and counted as not answered."""
ENDED = ("succeeded", "failed", "cancelled")
SLOW, SLOWEST = {"standard": 1.0}, 5.0
"""Processor seconds from which on an answer is named, by tier and in others."""
COLUMNS = ("verdict", "draft", "standard", "high", "certified")
BITS = 400
STATE = ("p", "q", "r", "g1", "g2", "g3")


@dataclass
class Asked:
    """One question with its answer, or why there is none."""

    problem: Hard
    tier: str
    seconds: float
    code: str | None = None
    """Why there is no answer."""
    detail: str = ""
    faults: list[str] = field(default_factory=list)
    summary: Document = field(default_factory=dict)
    columns: dict[str, list[Any]] = field(default_factory=dict)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.hard", description=__doc__)
    parser.add_argument("--only", choices=list(KINDS), help="one kind")
    only = parser.parse_args().only
    if not PAGE.exists():
        PAGE.write_text(new_page(), encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder)) as running:
        for name in KINDS if only is None else (only,):
            write(name, [row for each in KINDS[name][1]() for row in asked(running, each)])
    return 0


def asked(running: Service, hard: Hard) -> Iterator[Asked]:
    """Ask everything of one problem, the best tier first: what it encloses is the truth about the others."""
    best: Asked | None = None
    verdict = timed(running, "/v1/validations", hard.document)
    checked = Asked(hard, "verdict", verdict[0])
    if verdict[1] != 200:
        told = verdict[2]
        checked.code = told.get("errors", [told])[0].get("code") or str(told["type"]).rpartition(":")[2]
        checked.detail = json.dumps(verdict[2])
    else:
        plan = verdict[2].get("plan") or {}
        kind = (plan.get("window") or {}).get("kind")
        if hard.window is not None and kind != hard.window:
            checked.faults.append(f"window: {kind}, which is {hard.window}")
        if hard.document["motion"]["type"] == "planar" and len(plan.get("tiers") or ()) != 4:
            checked.faults.append("plan: not of four tiers")
    yield checked
    if hard.same_as is not None:
        best = job_of(running, hard, hard.same_as, {"tier": "certified"})
    for accuracy in hard.accuracies[::-1]:
        row = job_of(running, hard, hard.document, accuracy)
        judge(row, best)
        if row.code is None and best is None:
            best = row
        yield row


def timed(running: Service, path: str, document: Document, **headers: str) -> tuple[float, int, Document]:
    """Return the processor seconds of an answer, its status and itself."""
    began = processor_seconds(running.process.pid)
    answer = running.call("POST", path, document, **headers)
    return processor_seconds(running.process.pid) - began, answer.status, answer.document


def job_of(running: Service, hard: Hard, document: Document, accuracy: Document) -> Asked:
    """Return the answer to a job, or why there is none."""
    wait = f"wait={PATIENCE:.0f}"
    seconds, status, job = timed(running, "/v1/jobs", {**document, "accuracy": accuracy}, Prefer=wait)
    # On a busy machine a minute by the clock may be a second of the processor.
    began = processor_seconds(running.process.pid) - seconds
    while status in (200, 202) and job["state"] not in ENDED and seconds < PATIENCE:
        time.sleep(0.5)
        job = running.call("GET", f"/v1/jobs/{job['id']}").document
        seconds = processor_seconds(running.process.pid) - began
    tier = accuracy.get("tier") or ", ".join(f"{name} {value}" for name, value in accuracy.items())
    row = Asked(hard, str(tier), seconds)
    if status not in (200, 202):
        row.code = job.get("errors", [job])[0].get("code") or str(job["type"]).rpartition(":")[2]
        row.detail = json.dumps(job)
    elif job["state"] == "failed":
        row.code, row.detail = job["error"]["code"], json.dumps(job["error"])
    elif job["state"] != "succeeded":
        running.call("POST", f"/v1/jobs/{job['id']}/cancel")
        row.code = "no answer"
    else:
        path = f"/v1/solutions/{job['solution']}"
        row.summary = running.call("GET", path).document
        trajectory = running.call("GET", path + "/trajectory")
        row.columns = trajectory.document["columns"]
    return row


def judge(row: Asked, best: Asked | None) -> None:
    """Write down which of its claims are exceeded."""
    hard = row.problem
    if row.code is not None:
        if hard.same_as is not None and best is not None and best.code != row.code:
            row.faults.append(f"refused: {row.code}, and not where it is written otherwise ({best.code})")
        return
    summary = row.summary
    with ctx.workprec(BITS):
        for name, digits in hard.truth.items():
            row.faults += claim(name, value_of(row, name), arb(digits()) * (1 + arb(0, "1e-20")))
        if hard.window is not None and summary["window"] is not None and summary["aperiodic"] != hard.window:
            row.faults.append(f"aperiodic: {summary['aperiodic']}, which is {hard.window}")
        if best is not None and best.code is None:
            for name in STATE:
                for mine, other in zip(row.columns[name], best.columns[name], strict=True):
                    allowed = summary["error"] + best.summary["error"]
                    if not abs(mine - other) <= allowed:
                        row.faults.append(f"{name}: {mine} beside {other} of {best.tier}, claimed {allowed}")
            if summary["period"] and best.summary["period"]:
                row.faults += claim("period", summary["period"], exact(best.summary["period"]))


def value_of(row: Asked, name: str) -> Document:
    """Return a value with its error."""
    if name == "period":
        return row.summary["period"] or {}
    if name == "end":
        return ((row.summary["asymptotes"] or {}).get("future") or {}).get("time") or {}
    return {"value": row.columns[name][-1], "error": row.summary["error"]}


def exact(told: Document) -> arb:
    """Return the ball of a number with its error or radius."""
    middle = told["value"]
    radius = arb(str(told.get("radius", told.get("error"))))
    return arb(middle if isinstance(middle, str) else float(middle)) + arb(0, 1) * radius


def claim(name: str, told: Document, true: arb) -> list[str]:
    if "value" not in told:
        return [f"{name}: none"]
    off = abs(arb(told["value"]) - true)
    claimed = arb(str(told.get("radius", told.get("error"))))
    if off.lower() <= claimed:
        return []
    return [f"{name}: claimed {claimed.str(3, radius=False)}, off by {off.str(3, radius=False)}"]


def processor_seconds(root: int) -> float:
    """Return what a process and all that it started have taken of a processor until now.

    What has ended counts to what waited for it. By a clock on the wall a busy machine would seem slow.
    """
    parents: dict[int, int] = {}
    spent: dict[int, float] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        number = int(path.parent.name)
        parents[number] = int(fields[1])
        spent[number] = sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")
    total, waiting = 0.0, [root]
    while waiting:
        number = waiting.pop()
        total += spent.get(number, 0.0)
        waiting += [child for child, parent in parents.items() if parent == number]
    return total


def line_of(name: str, rows: Sequence[Asked]) -> str:
    """Return the line of the table about one kind."""
    codes = Counter(row.code for row in rows if row.code)
    claims = sum(any(": claimed " in fault or ", claimed " in fault for fault in row.faults) for row in rows)
    wrong = sum(bool(row.faults) for row in rows) - claims
    by_tier = {tier: [row.seconds for row in rows if row.tier == tier] for tier in COLUMNS}
    cells = [
        KINDS[name][0],
        str(len(rows)),
        str(len(rows) - codes.total()),
        ", ".join(f"`{code}` {count}" for code, count in sorted(codes.items())) or "none",
        str(claims),
        str(wrong),
        *(f"{max(seconds):.1f}" if seconds else "" for seconds in by_tier.values()),
    ]
    return "| " + " | ".join(cells) + " |"


def notes_of(rows: Sequence[Asked]) -> Iterator[str]:
    """Yield what is refused, slow or wrong, a line for a problem and what became of it."""
    found: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        what = [f"`{row.code}`"] if row.code else []
        what += [f"{row.seconds:.1f} s"] if row.seconds > SLOW.get(row.tier, SLOWEST) else []
        what += [f"**{fault}**" for fault in row.faults]
        if what:
            key = row.problem.name, ", ".join(what)
            found.setdefault(key, []).append(row.tier)
    for (problem, what), tiers in found.items():
        told = problem.replace("|", "\\|")
        yield f"* `{told}` ({', '.join(tiers)}): {what}"


def write(name: str, rows: Sequence[Asked]) -> None:
    """Write the line of a kind into the table, and its notes below."""
    page = PAGE.read_text(encoding="utf-8")
    row, notes = line_of(name, rows), "".join(f"{note}\n" for note in notes_of(rows)) or "Nothing.\n"
    title = KINDS[name][0]
    lines = [row if line.startswith(f"| {title} |") else line for line in page.splitlines()]
    page = replaced("\n".join(lines) + "\n", name, notes)
    PAGE.write_text(page, encoding="utf-8")
    say(row)
    say(notes)


def new_page() -> str:
    """Return the page without any numbers."""
    heads = ("kind", "asked", "answered", "refused", "exceeded", "wrong", *COLUMNS)
    parts = [f"### {title[0].upper()}{title[1:]}\n\n{framed(name, '')}" for name, (title, _) in KINDS.items()]
    table = ["| " + " | ".join(heads) + " |", "| --- " * len(heads) + "|"]
    table += [f"| {title} |" + " |" * (len(heads) - 1) for title, _ in KINDS.values()]
    return "\n".join([HEAD.strip(), "", *table, "", TAIL.strip(), "", *parts])


HEAD = f"""
# Hard problems

Written by `python -m tests.benchmarks.hard`, which starts a service with one worker, and asks through HTTP
what was once answered wrongly, slowly or not at all, and every family at the ends of its range
(`tests/support/hard_problems.py`). Each problem is asked for its verdict, and for its motion in every tier. A
claim is *exceeded* if the truth is further away: digits of other programs, quadratures by mpmath and in
balls, the same problem in other words, and for the samples the most precise tier that answers. *Wrong* is a
window or an end of another kind, or a plan without all four tiers. The last columns have the largest
processor seconds of one answer or refusal, of the whole service; what takes {PATIENCE:.0f} s is
cancelled. Random problems by the thousand are in [docs/honesty.md](honesty.md).
A kind without numbers has not been asked; of V₁ that stays an integral [docs/performance.md](performance.md)
has a table.
"""
TAIL = f"""
## What is refused, and what is slow

A refusal has a code of [docs/errors.md](errors.md). Named are answers that take more than {SLOWEST:.0f} s,
and in the tier `standard` those above {SLOW["standard"]:.0f} s.
"""

if __name__ == "__main__":
    sys.exit(main())
