"""Every page, opened in Chromium: nothing fails, nothing violates the policy, nobody is shut out."""

import pytest
from axe_playwright_python.sync_playwright import Axe

from service.dashboard.routes import PAGES
from tests.support.browser import address, settle

LEVELS = {"wcag2a", "wcag2aa", "wcag21a", "wcag21aa"}


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("path", PAGES)
def test_a_page_fills_without_a_fault_and_without_barriers(tab, path, theme):
    tab.page.emulate_media(color_scheme=theme)
    page = tab.open(address(path, tab.site))
    settle(page)
    assert page.locator("main h1").inner_text().strip(" …")
    assert page.locator(".notice.bad").count() == 0
    found = Axe().run(page, options={"runOnly": sorted(LEVELS)}).response["violations"]
    assert [(fault["id"], [node["html"] for node in fault["nodes"]]) for fault in found] == []


@pytest.mark.parametrize("path", PAGES)
def test_a_page_can_be_read_on_a_phone(tab, path):
    tab.page.set_viewport_size({"width": 375, "height": 720})
    page = tab.open(address(path, tab.site))
    settle(page)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


@pytest.mark.parametrize("path", PAGES)
def test_the_keyboard_reaches_the_content_first_and_the_tools(tab, path):
    page = tab.open(address(path, tab.site))
    settle(page)
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "content"
    order = page.eval_on_selector_all("[tabindex]", "found => found.map((element) => element.tabIndex)")
    assert all(place <= 0 for place in order)  # the order of the text is that of the keyboard


@pytest.mark.parametrize("path", PAGES)
def test_the_first_load_is_light(tab, path):
    # What is charged is what a page needs before it has data: the shell, styles and modules as they are sent.
    client = tab.page.context.new_cdp_session(tab.page)
    client.send("Network.enable")
    names, sizes = {}, {}
    client.on(
        "Network.responseReceived", lambda told: names.update({told["requestId"]: told["response"]["url"]})
    )
    client.on(
        "Network.loadingFinished", lambda told: sizes.update({told["requestId"]: told["encodedDataLength"]})
    )
    settle(tab.open(address(path, tab.site)))
    files = {
        names[key]: size
        for key, size in sizes.items()
        if "/v1/" not in names[key] and "plotly.min" not in names[key]
    }
    assert 0 < sum(files.values()) <= 60_000, files
    assert len(files) <= 10, files
