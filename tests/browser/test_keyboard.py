"""Whoever has no mouse reaches every control, and each has a name."""

import pytest
from playwright.sync_api import expect

from tests.support.browser import address, settle

CONTROLS = "a[href], button:not(:disabled), input:not(:disabled), select:not(:disabled), textarea, summary"
SEEN = (
    f"[...document.querySelectorAll({CONTROLS!r})]"
    ".filter((one) => one.checkVisibility() && one.tabIndex >= 0)"
)
MOST_KEYS = 400
NAMED = {
    "/solutions": [
        "Filter",
        "Choose all on this page",
        "Add label",
        "Remove label",
        "Set note",
        "Clear the selection",
    ],
    "/solution": ["or the one with the id", "Compare", "Copy as curl", "Copy as Python", "Show", "CSV"],
    "/sweep": ["Show it", "Start a finer sweep…", "Copy as curl", "log of values", "points"],
    "/workbench": ["λ", "Compute", "Copy as curl", "Copy as Python", "certified", "to"],
}
"""On each page some controls, which are reached by these names."""


@pytest.mark.one_in(2)
@pytest.mark.parametrize("path", NAMED)
def test_every_control_is_reached_by_the_key_tab(tab, path):
    page = tab.open(address(path, tab.site))
    settle(page)
    if path == "/solutions":
        page.locator("input.choose").first.check()
    if path == "/sweep":
        page.locator("#finer-form [name=count0]").wait_for()
    page.evaluate("document.activeElement.blur()")
    reached = "document.activeElement.setAttribute('data-reached', '')"
    # Of the choices of one group a browser offers the one that is chosen; the arrows go to the others.
    left = f"{SEEN}.filter((one) => !one.matches('[data-reached], [type=radio]:not(:checked)'))"
    for _ in range(MOST_KEYS):
        page.keyboard.press("Tab")
        if page.evaluate(f"{reached}, {left}.length") == 0:
            break
    assert page.evaluate(f"{left}.map((one) => one.outerHTML)") == []
    names = page.evaluate(
        f"{SEEN}.map((one) => (one.ariaLabel || one.labels?.[0]?.textContent || one.textContent).trim())"
    )
    assert all(names)
    for name in NAMED[path]:
        assert any(shown.startswith(name) for shown in names), names


@pytest.mark.parametrize("name", ["Key", "Theme"])
def test_the_tools_at_the_top_are_pressed_by_the_keyboard(tab, name):
    page = tab.open("families")
    settle(page)
    page.get_by_role("button", name=name).focus()
    page.keyboard.press("Enter")
    if name == "Theme":
        expect(page.locator("html")).to_have_attribute("data-theme", "light")
        return
    expect(page.locator("#key-field")).to_be_focused()
    page.keyboard.press("Escape")
    expect(page.locator("#key-button")).to_be_focused()
