"""Queries over many stored solutions: conditions, order and page, as the store answers them.

``python -m tests.benchmarks.queries [--rows 1000000] [--database URL]`` fills an empty database and prints
the times of each query: one of SQLite and one of Postgres, both made for it, or the one that is named, which
is filled once. It is not part of ``make bench``: filling takes minutes.
"""

import argparse
import random
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from sqlalchemy import func, insert, select, text

from service.schemas.query.facts import facts_of
from service.schemas.query.list_query import ListQuery
from service.schemas.query.order import read_order
from service.schemas.query.where import read_where
from service.storage.codecs.summary import summary_columns
from service.storage.database.database import Database
from service.storage.database.ids import new_id
from service.storage.database.migration import migrate
from service.storage.searching.sources import SOLUTIONS
from service.storage.solutions.solution_store import SolutionStore
from service.storage.tables.base import table_of
from service.storage.tables.solutions import SolutionRow
from tests.benchmarks.measuring import say
from tests.support.postgres import postgres_server

BATCH = 5000
REPEATS = 15
QUERIES = (
    ("", "-created_at"),
    ("period<5,/motion/lambda>=1", "-energy"),
    ("family=rational,tier in (draft,high)", "period"),
    ("/motion/lambda>=1.999", "-energy"),
    ("/motion/lambda>=1.9999,family=rational", "-created_at"),
    ("period<0.001", "energy"),
    ("stability.verdict=unstable,trace>3", "-trace"),
    ("/potential/parameters/a<0", "-created_at"),
    ("error<1e-12,created_at>=2026-01-01", "error"),
    ("method!=quadrature,energy>0.9", "period,-energy"),
)


def rows(count: int) -> Iterator[dict[str, object]]:
    """Yield solutions of about the size and the variety of real ones."""
    draw = random.Random(7)
    now = time.time()
    for place in range(count):
        problem = {
            "body": {"A": str(draw.randint(2, 9)), "B": "3/2", "C": "1"},
            "potential": {
                "type": draw.choice(("expression", "gravity", "rational", "homogeneous", "general")),
                "expression": "a*g1 + b/g3^2",
                "parameters": {"a": draw.uniform(-2, 2), "b": "1/20"},
            },
            "motion": {"type": "planar", "lambda": draw.uniform(0.1, 2)},
            "time": {"start": "0", "stop": "10", "samples": 101},
        }
        summary = {
            "method": draw.choice(("quadrature", "integration")),
            "tier": draw.choice(("draft", "standard", "high", "certified")),
            "period": {"value": draw.expovariate(0.2), "error": 1e-15} if draw.random() < 0.9 else None,
            "energy": {"value": draw.uniform(-1, 1), "error": 0.0},
            "error": 10.0 ** draw.uniform(-16, -6),
            "stability": {
                "trace": draw.uniform(-4, 4),
                "verdict": draw.choice(("stable", "unstable", "marginal")),
            },
            "cost": {"compute_seconds": draw.expovariate(100)},
            "evidence": {f"number_{k}": draw.random() for k in range(20)},
        }
        yield {
            "id": new_id(),
            "job_id": new_id(),
            "digest": f"{place:064x}",
            "created_at": now - count + place,
            "problem": problem,
            "summary": summary,
            **summary_columns(problem, summary),
            "facts": facts_of(problem),
        }


def fill(database: Database, count: int) -> None:
    """Store ``count`` solutions, unless the database has some."""
    with database.read() as session:
        if session.scalar(select(func.count()).select_from(SolutionRow)):
            return
    batch: list[dict[str, object]] = []
    for row in rows(count):
        batch.append(row)
        if len(batch) == BATCH:
            _store(database, batch)
            batch = []
    if batch:
        _store(database, batch)
    with database.write() as session:
        # As Postgres does by itself after a while, and as the retention of SQLite does.
        session.execute(text("ANALYZE"))


def _store(database: Database, batch: list[dict[str, object]]) -> None:
    with database.write_rows() as connection:
        connection.execute(insert(table_of(SolutionRow)), batch)


def measure(database: Database, where: str, order: str) -> tuple[list[float], int]:
    """Return the milliseconds of pages by cursor, one after the other, and the rows of the first."""
    store = SolutionStore(database)
    conditions, faults = read_where([where] if where else [], SOLUTIONS)
    keys, more = read_order(order, SOLUTIONS)
    assert not faults + more
    took, after, first = [], None, None
    for _ in range(REPEATS):
        began = time.perf_counter()
        page = store.find(ListQuery(conditions, keys, after=after, is_counted=False))
        took.append(1e3 * (time.perf_counter() - began))
        first = len(page.solutions) if first is None else first
        after = page.next
    return took, first or 0


def main() -> int:
    """Fill, measure, print."""
    options = argparse.ArgumentParser(prog="python -m tests.benchmarks.queries")
    options.add_argument("--rows", type=int, default=1_000_000)
    options.add_argument("--database", help="URL of an empty database, or of one that was filled before")
    asked = options.parse_args()
    if asked.database:
        _report(asked.database, asked.rows)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        _report(f"sqlite:///{Path(folder) / 'queries.db'}", asked.rows)
    with postgres_server() as server:
        _report(server.url(server.create_database()), asked.rows)
    return 0


def _report(url: str, count: int) -> None:
    migrate(url)
    database = Database(url)
    fill(database, count)
    say(f"{database.engine.dialect.name}, {count} solutions")
    everything: list[float] = []
    for where, order in QUERIES:
        took, found = measure(database, where, order)
        everything += took
        times = f"{statistics.median(took):8.1f} ms, at most {max(took):8.1f} ms"
        say(f"{times}, {found:3d} rows: {order} {where}")
    ranked = sorted(everything)
    say(f"all: median {statistics.median(ranked):.1f} ms, p95 {ranked[int(0.95 * len(ranked))]:.1f} ms")
    database.close()


if __name__ == "__main__":
    sys.exit(main())
