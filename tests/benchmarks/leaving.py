"""Lists that leave the service: 100 000 stored solutions in every format, and its memory meanwhile."""

import json
import re
import tempfile
import time
import urllib.request
from pathlib import Path

from service.storage.database.database import Database
from service.storage.database.migration import migrate
from tests.benchmarks.many_solutions import fill, problems
from tests.benchmarks.measuring import Effort, Table, in_words
from tests.support.serving import serving
from workers.computation.compute import solve_document

COUNT = 100_000
SOLVED = 5
"""Problems that are solved; each is stored many times, with its numbers varied."""
FORMATS = ("csv", "arrow", "parquet", "ndjson")


def leaving(effort: Effort) -> Table:
    """Return seconds and memory of one download of all solutions, in each format."""
    count = effort.repeats(COUNT)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        url = f"sqlite:///{Path(folder) / 'polhode.db'}"
        migrate(url)
        database = Database(url)
        fill(database, _solutions(), count)
        database.close()
        with serving(Path(folder), workers=0, POLHODE_DATABASE_URL=url) as running:
            for name in FORMATS:
                before = _memory(running.process.pid, "VmRSS")
                began = time.perf_counter()
                size, lines = _read(f"{running.address}/v1/solutions?format={name}")
                took = time.perf_counter() - began
                assert name not in ("csv", "ndjson") or lines == count + (name == "csv"), (name, lines)
                grown = _memory(running.process.pid, "VmHWM") - before
                rows.append((name, in_words(took), f"{size / 1e6:.1f} MB", f"{grown:+.0f} MB"))
    remark = (
        f"{count:,} solutions on SQLite, all facts (NDJSON: whole items), from the request to the last byte;"
        " memory is the highest of the service since it began, beside what it had before the request."
    )
    return Table(
        "Lists that leave", remark, ("format", "seconds", "size", "memory of the service"), tuple(rows)
    )


def _solutions() -> list[tuple[dict, dict]]:
    """Return some problems with their summaries."""
    found = []
    for problem in problems():
        outcome = solve_document(json.dumps(problem), way="plain")
        if hasattr(outcome, "summary"):
            found.append((problem, dict(outcome.summary)))
        if len(found) == SOLVED:
            break
    return json.loads(json.dumps(found))


def _read(address: str) -> tuple[int, int]:
    """Read an answer to its end; return its bytes and the ends of its lines."""
    size = lines = 0
    with urllib.request.urlopen(address, timeout=600) as answer:
        while piece := answer.read(1 << 16):
            size, lines = size + len(piece), lines + piece.count(b"\n")
    return size, lines


def _memory(process: int, name: str) -> float:
    """Return a number of a process in MB."""
    status = Path(f"/proc/{process}/status").read_text()
    return int(re.search(rf"{name}:\s+(\d+) kB", status)[1]) / 1e3
