"""Families and classical cases: an example of each kind runs with one click."""

import re

import pytest
from playwright.sync_api import expect

from tests.support.browser import settle


@pytest.mark.one_in(2)
@pytest.mark.parametrize("section", ["families", "classical"])
def test_an_example_runs_with_one_click_and_leads_to_its_solution(tab, section):
    page = tab.open("families")
    settle(page)
    card = page.locator(f"#{section} > li").first
    expect(card.locator("ul.plain li").first).not_to_be_empty()  # its conditions
    # Planar motions have a curve that is known before anything is computed.
    pictures = card.get_by_role("img", name="The curve of the planar motions")
    expect(pictures).to_have_count(1 if section == "families" else 0)
    card.get_by_role("button", name="Run the example").click()
    expect(card.get_by_role("img", name="Path of the vertical").locator("path.curve").first).to_be_attached()
    card.get_by_role("link", name="See the solution").click()
    page.wait_for_url(re.compile(r"solution\?id="))
    settle(page)
    identity = page.url.rpartition("=")[2]
    solution = tab.site.service.call("GET", f"/v1/solutions/{identity}").document
    shown = tab.site.service.call("GET", "/v1/families").document
    examples = [each["example"] for each in shown["items" if section == "families" else "classical"]]
    assert solution["problem"]["potential"] == examples[0]["potential"]
    assert solution["problem"]["motion"] == examples[0]["motion"]
