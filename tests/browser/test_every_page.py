"""Every page, opened in Chromium: nothing fails, nothing violates the policy, nobody is shut out."""

import pytest

from service.dashboard.routes import PAGES
from tests.support.browser import Weights, address, barriers, settle
from tests.support.effort import seldom

MOST_BYTES, MOST_FILES = 60_000, 10
"""Limits of shell, styles and modules as they are sent; what is beside them are plotly.js and data."""
ALIKE = "/jobs", "/studies", "/sweeps"
"""Lists made by the code of that of solutions."""


@pytest.mark.parametrize("path", [*(path for path in PAGES if path not in ALIKE), *seldom(*ALIKE)])
def test_a_page_is_whole_light_and_open_to_everybody(tab, path):
    page = tab.page
    weights = Weights()
    weights.watch(page)
    settle(tab.open(address(path, tab.site)))
    own = weights.own()
    assert 0 < sum(own.values()) <= MOST_BYTES, own
    assert len(own) <= MOST_FILES, own

    assert page.locator("main h1").inner_text().strip(" …")
    assert page.locator(".notice.bad").count() == 0
    assert barriers(page) == []
    page.emulate_media(color_scheme="dark")
    assert barriers(page) == []

    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "content"
    order = page.eval_on_selector_all("[tabindex]", "found => found.map((element) => element.tabIndex)")
    assert all(place <= 0 for place in order)  # the keyboard goes in the order of the text

    page.set_viewport_size({"width": 375, "height": 720})
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
