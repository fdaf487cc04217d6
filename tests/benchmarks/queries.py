"""A database of many solutions, asked by HTTP: pages with their bodies, facets, statistics, cold and warm.

``python -m tests.benchmarks.queries [--rows 1000000] [--folder F] [--only sqlite]`` makes a database of
SQLite and one of Postgres in the folder, unless they are there, serves them, and prints what requests take.
It is not part of ``make bench``: the databases take a quarter of an hour and 8 GB each.

Cold is a request before which the system has forgotten the files of the database; the caches of the service
and of Postgres itself, a hundredth of the files, are as they were.
"""

import argparse
import json
import math
import os
import random
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus
from itertools import islice
from pathlib import Path
from urllib.parse import quote

from service.storage.database.database import Database
from service.storage.database.migration import migrate
from tests.benchmarks.many_solutions import answers, fill, rows
from tests.benchmarks.measuring import say
from tests.benchmarks.whole.client import Line
from tests.support.postgres import PostgresServer
from tests.support.serving import serving

SEED = 11
PAGES, COLD = 150, 60
"""Random queries that are asked, warm and cold."""
SAMPLE = 3000
NUMBERS = ("period", "energy", "error", "drift", "trace", "seconds", "/motion/lambda")
A = "/potential/parameters/a"
POINTERS = (A, "/potential/parameters/k", "/potential/a", "/potential/A/0", "/time/stop")
WORDS = (
    "family=rational", "family!=gravity", "tier in (draft,high)", "tier=standard", "method=integration",
    "stability.verdict=stable", "aperiodic is null", "period is not null",
)  # fmt: skip
NAMED = (
    ("the newest", "order=-created_at"),
    ("a narrow range, in the order of another", "order=-period&where=/potential/parameters/a>{a}"),
    ("two narrow ranges", "order=energy&where=period<{period},error<{error}"),
    ("none of both", "order=-energy&where=period>{late},energy>{high}"),
    ("order of a number of the problem", "order=-/potential/parameters/a&where=tier=draft,energy<{energy}"),
    ("two words", "order=period,-energy&where=family=rational,tier in (draft,high)"),
)
STATISTICS = (
    ("statistics of all", "/statistics?of=period"),
    ("statistics with two conditions", "/statistics?of=period,energy&where=energy<{energy},tier=draft"),
    ("statistics by family, 20 bins", "/statistics?of=period&by=family&bins=20&where=energy<{energy}"),
    ("facets of all", "/facets?by=family"),
    ("facets with two conditions", "/facets?by=family,tier&where=energy<{energy},period>{period}"),
)


class Quantiles:
    """The numbers of a sample of the rows: where a condition on one of them cuts off a share of all."""

    def __init__(self, found: Sequence[tuple[dict[str, object], dict[str, object]]], count: int) -> None:
        sample = list(islice(rows(found, count), SAMPLE))
        self._sorted = {
            name: sorted(filter(None, map(partial(_value, name), sample))) for name in NUMBERS + POINTERS
        }

    def at(self, name: str, share: float) -> float:
        known = self._sorted[name]
        return float(known[min(len(known) - 1, int(share * len(known)))])

    def condition(self, draw: random.Random) -> str:
        """Return a condition that 0.03 % to all rows meet, as likely of one size as of another."""
        if draw.random() < 0.25:
            return draw.choice(WORDS)
        name = draw.choice(NUMBERS if draw.random() < 0.75 else POINTERS)
        share = math.exp(draw.uniform(math.log(1 / SAMPLE), 0.0))
        start = draw.uniform(0.0, 1.0 - share)
        match draw.randrange(3):
            case 0:
                return f"{name}<{self.at(name, share)!r}"
            case 1:
                return f"{name}>{self.at(name, 1.0 - share)!r}"
        return f"{name}>={self.at(name, start)!r},{name}<={self.at(name, start + share)!r}"

    def query(self, draw: random.Random) -> str:
        order = draw.choice(("", "-")) + draw.choice(
            (*NUMBERS, "created_at") if draw.random() < 0.85 else POINTERS
        )
        return f"order={order}&where={self.condition(draw)},{self.condition(draw)}"

    def named(self, text: str) -> str:
        """Return one of the queries above with its numbers."""
        return text.format(
            a=self.at(A, 0.9995), period=self.at("period", 0.001), error=self.at("error", 0.001),
            late=self.at("period", 0.95), high=self.at("energy", 0.95), energy=self.at("energy", 0.3),
        )  # fmt: skip


def _value(name: str, row: dict[str, dict[str, float]]) -> object:
    column = "lambda_" if name == "/motion/lambda" else name
    return row[column] if column in row else row["facts"].get(name)


@contextmanager
def sqlite(folder: Path) -> Iterator[tuple[str, Callable[[], None]]]:
    """Yield the URL of the database, and what makes the system forget its file."""
    yield f"sqlite:///{folder / 'many.db'}", partial(_forget, folder, "many.db*")


@contextmanager
def postgres(folder: Path) -> Iterator[tuple[str, Callable[[], None]]]:
    """Yield the same of Postgres."""
    place = folder / "postgres"
    place.mkdir(exist_ok=True)
    folder.chmod(0o711)  # a temporary folder lets nobody but its owner through, and Postgres is somebody else
    is_new = not (place / "data").exists()
    server = PostgresServer(place)
    server.start()
    try:
        name = server.create_database() if is_new else "polhode_1"
        yield server.url(name), partial(_forget, place, "data/base/**/*")
    finally:
        server.stop("fast")


def _forget(folder: Path, pattern: str) -> None:
    os.sync()
    for path in folder.glob(pattern):
        if path.is_file():
            descriptor = os.open(path, os.O_RDONLY)
            os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
            os.close(descriptor)


def _asked(line: Line, path: str) -> bytes:
    place, _, query = path.partition("?")
    parts = (part.partition("=") for part in query.split("&"))
    return line.request("GET", f"/v1/solutions{place}?" + "&".join(f"{k}={quote(v)}" for k, _, v in parts))


def _seconds(line: Line, request: bytes) -> float:
    """Return how long an answer takes; a query that is stopped has taken as long as it may."""
    began = time.perf_counter()
    status, body = line.exchange(request)
    if status not in (HTTPStatus.OK, HTTPStatus.UNPROCESSABLE_ENTITY) or b"invalid_request" in body:
        raise RuntimeError(f"{status}: {body[:500]!r}")
    return time.perf_counter() - began


def _say(what: str, taken: Sequence[float]) -> None:
    ranked = sorted(1e3 * each for each in taken)
    p95 = ranked[min(len(ranked) - 1, int(0.95 * len(ranked)))]
    say(f"{statistics.median(ranked):8.1f} ms, p95 {p95:8.1f} ms, at most {ranked[-1]:8.1f} ms: {what}")


def measure(url: str, forget: Callable[[], None], quantiles: Quantiles, folder: Path) -> None:
    """Ask and print."""
    draw = random.Random(SEED)
    queries = [quantiles.query(draw) for _ in range(PAGES)]
    with serving(folder, workers=0, POLHODE_DATABASE_URL=url) as service, Line(service.address) as line:
        say(f"load average {os.getloadavg()[0]:.1f}")
        cold = []
        for query in queries[:COLD]:
            forget()
            cold.append(_seconds(line, _asked(line, f"?{query}")))
        _say("any page of two conditions, cold", cold)
        warm, slowest = [], []
        for query in queries:
            _seconds(line, _asked(line, f"?{query}"))
            warm.append(_seconds(line, _asked(line, f"?{query}")))
            slowest.append((warm[-1], query))
        _say("any page of two conditions, warm", warm)
        for seconds, query in sorted(slowest)[-8:]:
            say(f"    {1e3 * seconds:8.1f} ms {query}")
        for what, query in NAMED:
            _pages(line, what, quantiles.named(query))
        for what, path in STATISTICS:
            request = _asked(line, quantiles.named(path))
            forget()
            first = _seconds(line, request)
            _say(f"{what}, cold {1e3 * first:.0f} ms", [_seconds(line, request) for _ in range(5)])


def _pages(line: Line, what: str, query: str) -> None:
    """Ask for ten pages, one after the other, three times."""
    taken = []
    for _ in range(3):
        request: bytes | None = _asked(line, f"?{query}")
        for _ in range(10):
            if request is None:
                break
            taken.append(_seconds(line, request))
            following = json.loads(line.exchange(request)[1]).get("next")
            request = following and line.request("GET", f"/v1/solutions{following}")
    _say(what, taken)


def main() -> int:
    """Make what is missing, and measure."""
    options = argparse.ArgumentParser(prog="python -m tests.benchmarks.queries")
    options.add_argument("--rows", type=int, default=1_000_000)
    options.add_argument("--folder", type=Path, help="where the databases are kept; none are without it")
    options.add_argument("--only", choices=("sqlite", "postgres"))
    asked = options.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = asked.folder or Path(temporary)
        folder.mkdir(exist_ok=True)
        found = answers(folder)
        quantiles = Quantiles(found, asked.rows)
        for name, opened in (("sqlite", sqlite), ("postgres", postgres)):
            if asked.only in (None, name):
                with opened(folder) as (url, forget):
                    migrate(url)
                    database = Database(url)
                    fill(database, found, asked.rows)
                    database.close()
                    say(f"{name}, {asked.rows} solutions")
                    measure(url, forget, quantiles, folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
