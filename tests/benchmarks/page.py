"""The page in Chromium: how soon a verdict is there, whether zooming stutters, what pages weigh.

``python -m tests.benchmarks.page``
"""

import re
import statistics
import tempfile
import time
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

from service.dashboard.routes import PAGES
from tests.benchmarks.measuring import Table, say
from tests.benchmarks.report import text_of_table
from tests.support.browser import (
    FLAGS,
    Site,
    Weights,
    address,
    chromium,
    fill_site,
    save_first_figure,
    settle,
)
from tests.support.serving import serving
from tests.support.waiting import wait_until

FORMULAS, ZOOMS = 15, 6
KEY_PAUSE = 60
"""Milliseconds between two keys: somebody who types fast."""
VERDICT_MS, TASK_MS, MOST_KB, MOST_FILES, FIGURE_SECONDS = 150, 200, 60, 10, 60
"""What is asked."""

WATCH_VERDICTS = """() => {
  globalThis.pressed = globalThis.shown = 0;
  addEventListener("input", () => { globalThis.pressed = performance.now(); }, true);
  const verdict = document.getElementById("verdict");
  new MutationObserver(() => {
    if (verdict.getAttribute("aria-busy") === "false") globalThis.shown = performance.now();
  }).observe(verdict, { attributes: true });
}"""
WATCH_TASKS = """() => {
  globalThis.tasks = [];
  const keep = (list) => globalThis.tasks.push(...list.getEntries().map(({ duration }) => duration));
  new PerformanceObserver(keep).observe({ type: "longtask" });
}"""


def main() -> None:
    """Print all tables."""
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(Path(folder)) as service,
        sync_playwright() as playwright,
    ):
        running = playwright.chromium.launch(executable_path=chromium(), args=FLAGS)
        page = running.new_page(viewport={"width": 1280, "height": 800})
        steps = first_figure(page, service.address)
        site = fill_site(service)
        rows = [steps, verdicts(page, site), *zooming(page, site)]
        remark = f"{FORMULAS} formulas typed with {KEY_PAUSE} ms between keys; {ZOOMS} zooms by dragging."
        say(text_of_table(Table("Speed of the page", remark, ("what", "asked", "reached"), rows)))
        rows = [weight(running.new_page(), site, path) for path in PAGES]
        remark = "Without plotly.js and data, as sent."
        say(text_of_table(Table("Weights of the pages", remark, ("page", "requests", "kB"), rows)))
        running.close()


def first_figure(page: Page, address: str) -> tuple[str, str, str]:
    """Go from the empty database to the saved picture of a sweep, as fast as the page answers."""
    began = time.monotonic()
    page.goto(address)
    settle(page)
    _, clicks = save_first_figure(page)
    what = "from the empty database to a saved picture of a sweep"
    return what, f"{FIGURE_SECONDS} s, 8 clicks", f"{time.monotonic() - began:.0f} s, {clicks} clicks"


def verdicts(page: Page, site: Site) -> tuple[str, str, str]:
    """Type formulas that the service has not seen; measure from the last key until the verdict is shown."""
    page.goto(site.address + "/workbench")
    settle(page)
    page.evaluate(WATCH_VERDICTS)
    field = page.get_by_label("V, a formula")
    found = []
    for k in range(FORMULAS):
        field.fill("a*g1 + b/g3^2")
        field.press("End")
        page.keyboard.type(f" + {k + 2}*c*(g1^2 - g2^2)", delay=KEY_PAUSE)
        wait_until(lambda: page.evaluate("shown > pressed"))
        assert "Admissible" in page.locator("#verdict").inner_text()
        found.append(page.evaluate("shown - pressed"))
    middle, worst = statistics.median(found), max(found)
    what = "last key to the verdict, median (and longest)"
    return what, f"{VERDICT_MS} ms", f"{middle:.0f} ms ({worst:.0f} ms)"


def zooming(page: Page, site: Site) -> list[tuple[str, str, str]]:
    """Zoom into the series by dragging, and out again; collect the long tasks of the browser."""
    page.goto(site.address + address("/solution", site))
    settle(page)
    plot = page.locator("#series .nsewdrag").first
    plot.wait_for()
    page.wait_for_timeout(2000)
    page.evaluate(WATCH_TASKS)
    answers = []
    for k in range(ZOOMS):
        plot.scroll_into_view_if_needed()
        box = plot.bounding_box()
        assert box is not None
        with page.expect_response(re.compile(r"trajectory\?start=.*preview=")) as answer:
            if k % 4 == 3:
                page.get_by_role("button", name="One period").click()
            else:
                page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 0.5 * box["height"])
                page.mouse.down()
                page.mouse.move(box["x"] + 0.7 * box["width"], box["y"] + 0.5 * box["height"], steps=10)
                page.mouse.up()
        answer.value.finished()
        page.wait_for_timeout(700)
        answers.append(answer.value.request.timing["responseEnd"])
    tasks = page.evaluate("tasks")
    return [
        ("longest task while zooming", f"{TASK_MS} ms", f"{max(tasks, default=0.0):.0f} ms"),
        ("samples of a zoomed stretch, median", "", f"{statistics.median(answers):.0f} ms"),
    ]


def weight(page: Page, site: Site, path: str) -> tuple[str, str, str]:
    """Open a page with an empty cache; return what it needs before it has data."""
    weights = Weights()
    weights.watch(page)
    page.goto(site.address + address(path, site))
    settle(page)
    own = weights.own()
    page.close()
    assert len(own) <= MOST_FILES
    assert sum(own.values()) <= 1000 * MOST_KB
    return path, str(len(own)), f"{sum(own.values()) / 1000:.0f}"


if __name__ == "__main__":
    main()
