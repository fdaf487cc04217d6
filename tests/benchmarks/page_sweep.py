"""A million points of a sweep on the page, in Chromium: as a heat map, as one line, and closer.

``python -m tests.benchmarks.page_sweep`` stores two finished sweeps without computing them, opens their pages
and prints a table. It is not part of ``make bench``: it needs Chromium.
"""

import statistics
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Browser, CDPSession, Page, sync_playwright
from sqlalchemy import insert

from service.jobs.records import JobState
from service.storage.codecs.packing import SOLVED, ChunkPoints, bounds_of, encode_points
from service.storage.database.database import Database
from service.storage.database.migration import migrate
from service.storage.database.rows import new_id
from service.storage.tables.base import table_of
from service.storage.tables.solutions import SweepChunkRow, SweepRow
from tests.benchmarks.measuring import say
from tests.support.browser import FLAGS, SWEEP, chromium
from tests.support.serving import serving

SIDE = 1000
POINTS = SIDE * SIDE
CHUNK = 10_000
REPEATS = 5
LAMBDA, B = "/motion/lambda", "/potential/parameters/b"
MATRIX = [
    {"pointer": LAMBDA, "linspace": ["1/10", 2, SIDE]},
    {"pointer": B, "logspace": ["1/50", "1/5", SIDE]},
]
LINE = [{"pointer": LAMBDA, "linspace": ["1/10", 2, POINTS]}]
HEADS = (
    "picture",
    "request to arrival",
    "arrival to picture",
    "longest task",
    "closer: longest task",
    "closer: processor",
)
WATCH = """
globalThis.tasks = [];
const kept = (list) => tasks.push(...list.getEntries().map(({startTime, duration}) => [startTime, duration]));
new PerformanceObserver(kept)
  .observe({type: "longtask", buffered: true});
"""
TIMES = """() => {
  const at = (name) => performance.getEntriesByName(name).at(-1)?.startTime;
  const asked = performance.getEntriesByType("resource").filter(({name}) => /format=npz/.test(name)).at(-1);
  return [asked.startTime, at("points-arrived"), at("points-drawn")];
}"""


def numbers(first: int, axes: int) -> tuple[list[str], Mapping[str, NDArray[np.float64]]]:
    """Return outcomes and kept numbers of a chunk; below a curve there is no motion."""
    index = np.arange(first, first + CHUNK)
    x, y = (index // SIDE / SIDE, index % SIDE / SIDE) if axes == 2 else (index / POINTS, np.zeros(CHUNK))
    refused = x < 0.1 + 0.3 * y**2
    period = np.where(refused, np.nan, 6 + np.sin(9 * x) * np.cos(5 * y) + 0.01 * np.sin(index))
    return np.where(refused, "no_motion", SOLVED).tolist(), {"period": period}


def chunks(sweep_id: str, axes: int) -> Iterator[dict[str, object]]:
    """Yield the rows of a sweep's chunks."""
    for first in range(0, POINTS, CHUNK):
        outcomes, kept = numbers(first, axes)
        refused = len(outcomes) - outcomes.count(SOLVED)
        data = encode_points(ChunkPoints(outcomes, kept))
        row = {"sweep_id": sweep_id, "first": first, "count": CHUNK, "refused": refused, "data": data}
        yield {**row, "bounds": bounds_of(kept)}


def store(database: Database, axes: list[dict[str, object]]) -> str:
    """Store a finished sweep; return its id."""
    identity, now = new_id(), time.time()
    rows = list(chunks(identity, len(axes)))
    done = {
        "points": POINTS,
        "next_index": POINTS,
        "done": POINTS,
        "refused": sum(int(str(row["refused"])) for row in rows),
    }
    times = {"created_at": now, "started_at": now, "finished_at": now}
    sweep = {"id": identity, "state": JobState.SUCCEEDED.value, **done, **times}
    document = {**SWEEP, "axes": axes, "keep": ["period"]}
    with database.write_rows() as connection:
        connection.execute(insert(table_of(SweepRow)), [{**sweep, "document": document}])
        connection.execute(insert(table_of(SweepChunkRow)), rows)
    return identity


def drawn(browser: Browser, address: str) -> tuple[float, ...]:
    """Return the milliseconds of one opening: asking, drawing, the longest task then and coming closer.

    The last is the time of the processor that the page's thread spends on coming closer: on a loaded machine
    it is steadier than that of the clock.
    """
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.add_init_script(WATCH)
    client = page.context.new_cdp_session(page)
    client.send("Performance.enable", {"timeDomain": "threadTicks"})
    page.goto(address)
    _wait(page)
    asked, arrived, shown = page.evaluate(TIMES)
    first = _longest(page, arrived, shown)
    box = page.locator("#picture .nsewdrag").first.bounding_box()
    assert box is not None
    busy = _busy(client)
    before = page.evaluate("performance.now()")
    page.evaluate("performance.clearMarks('points-drawn')")
    page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 0.2 * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.7 * box["height"], steps=5)
    page.mouse.up()
    _wait(page)
    closer = _longest(page, before, page.evaluate("performance.now()"))
    busy = _busy(client) - busy
    page.close()
    return arrived - asked, shown - arrived, first, closer, busy


def _busy(client: CDPSession) -> float:
    """Return the milliseconds of the processor that the page's thread has spent."""
    metrics = client.send("Performance.getMetrics")["metrics"]
    return next(1e3 * float(each["value"]) for each in metrics if each["name"] == "TaskDuration")


def _wait(page: Page) -> None:
    page.wait_for_function("() => performance.getEntriesByName('points-drawn').length > 0", timeout=120_000)
    page.wait_for_timeout(300)


def _longest(page: Page, start: float, stop: float) -> float:
    """Return the longest task between two times, in milliseconds; shorter ones than 50 are not told."""
    tasks = page.evaluate("tasks")
    return max((length for begin, length in tasks if start - length <= begin <= stop), default=50.0)


def main() -> int:
    """Fill, measure, print."""
    with tempfile.TemporaryDirectory() as folder:
        url = f"sqlite:///{Path(folder) / 'polhode.db'}"
        migrate(url)
        database = Database(url)
        pictures = {
            "heat map, 1000 × 1000": store(database, MATRIX),
            "one line of a million": store(database, LINE),
        }
        database.close()
        say(f"| {' | '.join(HEADS)} |\n|{' --- |' * len(HEADS)}")
        with serving(Path(folder), workers=0) as service, sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=chromium(), args=FLAGS)
            for name, identity in pictures.items():
                runs = [drawn(browser, f"{service.address}/sweep?id={identity}") for _ in range(REPEATS)]
                cells = [f"{statistics.median(times):.0f} ms" for times in zip(*runs, strict=True)]
                say(f"| {name} | {' | '.join(cells)} |")
            browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
