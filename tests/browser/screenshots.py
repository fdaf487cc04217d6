"""Writes pictures of the pages to docs/screenshots: ``make screenshots``."""

import io
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from tests.support.browser import FLAGS, address, chromium, fill_site, settle
from tests.support.serving import serving

FOLDER = Path(__file__).parents[2] / "docs" / "screenshots"
COLOURS = 160
"""Number of colours of the palette: enough for a page, and a third of the bytes."""
PICTURES = {
    "overview": ("/", "light", 1000),
    "overview-dark": ("/", "dark", 1000),
    "workbench": ("/workbench", "light", 1180),
    "workbench-dark": ("/workbench", "dark", 1180),
    "solution": ("/solution", "light", 2400),
    "solution-dark": ("/solution", "dark", 1500),
    "solutions": ("/solutions", "light", 800),
    "sweep": ("/sweep", "light", 900),
    "families": ("/families", "dark", 1100),
    "accuracy": ("/accuracy", "light", 800),
}
"""Each page with a theme and how many pixels of it are shown."""


def main() -> None:
    """Take all pictures of one service with solutions in it."""
    FOLDER.mkdir(exist_ok=True)
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(Path(folder)) as service,
        sync_playwright() as playwright,
    ):
        site = fill_site(service)
        browser = playwright.chromium.launch(executable_path=chromium(), args=FLAGS)
        for name, (path, theme, height) in PICTURES.items():
            page = browser.new_page(
                viewport={"width": 1200, "height": height}, color_scheme=theme, reduced_motion="reduce"
            )
            page.goto(service.address + address(path, site))
            settle(page)
            _wait_for_pictures(page)
            _write(FOLDER / f"{name}.png", page.screenshot())
            page.close()
        browser.close()


def _wait_for_pictures(page: Page) -> None:
    """Wait until charts and small pictures are drawn, which come when a page has its data."""
    for chart in page.locator(".chart:visible").all():
        chart.locator("svg.main-svg").first.wait_for()
    for thumb in page.locator("#cards .thumb").all():
        thumb.scroll_into_view_if_needed()
        thumb.locator("svg").wait_for()
    page.evaluate("scrollTo(0, 0)")


def _write(path: Path, content: bytes) -> None:
    picture = Image.open(io.BytesIO(content)).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    picture.save(path, optimize=True)


if __name__ == "__main__":
    main()
