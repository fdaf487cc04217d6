"""What the tests of the page in Chromium share: the site, tabs that are watched, where Chromium is."""

import json
import re
import shutil
from dataclasses import dataclass, field
from pathlib import Path

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Download, Page, expect

from tests.support.serving import Service

EXAMPLES = Path(__file__).parents[2] / "examples"
SOLVED = ("first", "bobylev-steklov", "unstable", "state")
HOSTILE = "<img src=x onerror=alert(1)>"
"""Markup where people may write text; none of it may become an element."""
# The processor draws WebGL and puts the page together: to play a graphics card costs as much as the page.
FLAGS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing",
]
# The first is the engine without menus and tabs, which nobody sees here and which cost a third.
BROWSERS = "chromium-headless-shell", "chromium", "chromium-browser"


def problem(name: str) -> dict:
    return json.loads((EXAMPLES / f"{name}.json").read_text(encoding="utf-8"))


SWEEP = {
    "base": problem("first"),
    "axes": [
        {"pointer": "/motion/lambda", "linspace": ["1/10", 2, 12]},
        {"pointer": "/potential/parameters/b", "logspace": ["1/50", "1/5", 6]},
    ],
    "combine": "grid",
    "keep": ["period", "energy", "error"],
}
"""Below some λ there is no motion: these points are refused."""


@dataclass(frozen=True)
class Site:
    """The service under test, and what is stored in it."""

    service: Service
    solutions: dict[str, str]
    sweep: str

    @property
    def address(self) -> str:
        return self.service.address


@dataclass
class Watched:
    """A tab whose console errors, failed requests and violations of the policy are kept."""

    page: Page
    site: Site
    faults: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.page.on("console", self._said)
        self.page.on("pageerror", lambda error: self.faults.append(f"error: {error}"))
        self.page.on("requestfailed", self._failed)
        self.page.on("response", self._answered)

    def open(self, path: str) -> Page:
        self.page.goto(f"{self.site.address}/{path.lstrip('/')}")
        return self.page

    def _said(self, message) -> None:
        # Answers with an error are told by _answered, which knows their address.
        if message.type in ("error", "warning") and not message.text.startswith("Failed to load resource"):
            self.faults.append(f"{message.type}: {message.text}")

    def _answered(self, response) -> None:
        if response.status >= 400:
            self.faults.append(f"{response.status} {response.url}")

    def _failed(self, request) -> None:
        # Older answers are dropped on purpose while somebody types or zooms.
        if request.failure != "net::ERR_ABORTED":
            self.faults.append(f"{request.failure} {request.url}")


@dataclass(frozen=True)
class Weights:
    """The bytes of each file as it was sent, by its address."""

    names: dict[str, str] = field(default_factory=dict)
    sizes: dict[str, int] = field(default_factory=dict)

    def watch(self, page: Page) -> None:
        client = page.context.new_cdp_session(page)
        client.send("Network.enable")
        client.on(
            "Network.responseReceived",
            lambda told: self.names.update({told["requestId"]: told["response"]["url"]}),
        )
        client.on(
            "Network.loadingFinished",
            lambda told: self.sizes.update({told["requestId"]: told["encodedDataLength"]}),
        )

    def own(self) -> dict[str, int]:
        """Return the shell, the styles and the modules: beside them are plotly.js and data."""
        sent = {self.names[key]: size for key, size in self.sizes.items()}
        return {
            name: size
            for name, size in sent.items()
            if "/v1/" not in name and not name.endswith(("/readyz", "plotly.min.js"))
        }


LEVELS = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]
COUNT_CLICKS = """addEventListener("click", ({isTrusted}) => {
  if (isTrusted) sessionStorage.setItem("clicks", Number(sessionStorage.getItem("clicks") ?? 0) + 1);
}, true)"""
CLICKS_OF_A_CHOICE = 2
"""Clicks of somebody who chooses from a list: one opens it."""


def barriers(page: Page) -> list[tuple[str, list[str]]]:
    """Return what axe-core finds of the levels A and AA, contrast included."""
    found = Axe().run(page, options={"runOnly": LEVELS}).response["violations"]
    return [(fault["id"], [node["html"] for node in fault["nodes"]]) for fault in found]


def save_first_figure(page: Page) -> tuple[Download, int]:
    """Go from the overview to the saved picture of a sweep over two numbers; return it and the clicks."""
    page.add_init_script(COUNT_CLICKS)
    page.evaluate(COUNT_CLICKS)
    page.get_by_role("link", name="Workbench", exact=True).click()
    page.get_by_role("button", name="Sweep over λ…").click()
    dialog = page.get_by_role("dialog", name="A new sweep")
    dialog.get_by_label("Axis 2", exact=True).select_option(label="b")
    expect(dialog.locator("#sweep-cost")).to_contain_text("1,600 points: ")
    dialog.get_by_role("button", name="Start the sweep").click()
    page.wait_for_url(re.compile(r"sweep\?id="))
    expect(page.locator("#progress")).to_contain_text("1,600 of 1,600")
    expect(page.locator("#picture-note")).to_contain_text(re.compile("motions, [0-9,]+ points without one.$"))
    page.locator("summary[data-export]").first.click()
    with page.expect_download() as download:
        page.locator("[data-export=svg]:visible").click()
    clicks = int(page.evaluate("sessionStorage.getItem('clicks')"))
    return download.value, clicks + CLICKS_OF_A_CHOICE


def chromium() -> str | None:
    return next(filter(None, map(shutil.which, BROWSERS)), None)


def address(path: str, site: Site) -> str:
    """Return the address of a page, with the thing that it shows."""
    ids = {"/solution": f"?id={site.solutions['unstable']}", "/sweep": f"?id={site.sweep}"}
    return path + ids.get(path, "")


def settle(page: Page) -> None:
    """Wait until a page has filled all that it says is still coming."""
    page.locator("main[aria-busy=false]").wait_for()
    page.locator("main [aria-busy=true]").first.wait_for(state="detached")


def fill_site(service: Service) -> Site:
    """Solve some problems and start a sweep."""
    found = {}
    for name in SOLVED:
        job = service.call("POST", "/v1/jobs", problem(name), Prefer="wait=60")
        assert job.document["state"] == "succeeded", job
        found[name] = job.document["solution"]
    sweep = service.call("POST", "/v1/sweeps", SWEEP)
    assert sweep.status == 202, sweep
    return Site(service, found, sweep.document["id"])
