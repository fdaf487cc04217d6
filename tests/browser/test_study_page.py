"""Questions about integrals, potentials and numbers: asked on the page, and read there."""

import json
import re

import pytest
from playwright.sync_api import expect

from tests.support.browser import barriers, settle
from tests.support.effort import seldom

KINDS = {
    "integral": "Is this function an integral?",
    "integrals": "Which integrals are there?",
    "potentials": "Which potentials have planar motions?",
    "numbers": "Which numbers give a period, …?",
}
READ = [
    # kind, example, what the answer says, what stands in it
    ("integral", "Kovalevskaya's integral", "an integral: constant along every motion.", "Kovalevskaya"),
    ("integral", "the relation of Hess", "It is an invariant relation", "q/3"),
    # The integral of Kovalevskaya has the degree 4, 2 (theory 6); A = B = 2C.
    ("integrals", "of a heavy body", "1 more integral", "Kovalevskaya"),
    # g1 is that of Bobylev and Steklov (theory 1.4); two more powers of g2 with A g1² + C g3² before.
    ("potentials", "of one body", "potentials", "g1"),
    # λ = 1 has the period 6.34007793723281 (theory 1.6), and dT/dλ = -1.6.
    ("numbers", "a period", "1 solution; it is proved that there are no others.", "1.0000490"),
]


def shown(page) -> dict:
    return json.loads(page.locator("#document").inner_text())


@pytest.mark.parametrize(("kind", "example", "says", "has"), [READ[0], READ[4], *seldom(*READ[1:4])])
def test_every_kind_of_question_is_asked_and_its_answer_is_read(tab, kind, example, says, has):
    page = tab.open("study")
    settle(page)
    page.get_by_label("What is asked").select_option(label=KINDS[kind])
    page.get_by_role("button", name=example, exact=True).click()
    document = shown(page)
    page.get_by_role("button", name="Ask", exact=True).click()
    page.wait_for_url(re.compile(r"study\?id="))
    expect(page.locator("#answer .verdict")).to_contain_text(says)
    expect(page.locator("#answer")).to_contain_text(has)
    assert barriers(page) == []
    page.set_viewport_size({"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    # The address alone shows the question and the answer, and the list leads to it.
    its_id = page.url.rpartition("=")[2]
    page.goto(page.url)
    settle(page)
    assert shown(page) == document
    expect(page.locator("#answer .verdict")).to_contain_text(says)
    page.set_viewport_size({"width": 1280, "height": 800})
    page.get_by_role("link", name="Studies").click()
    settle(page)
    page.locator(f"a[href='./study?id={its_id}']").click()
    expect(page.locator("#answer .verdict")).to_contain_text(says)
    tab.site.service.call("DELETE", f"/v1/jobs/{its_id}")


def test_a_fault_is_marked_at_its_field_and_a_failed_study_says_why(tab):
    page = tab.open("study")
    settle(page)
    function = page.get_by_label("Formula in p, q, r, g1, g2, g3")
    function.fill("p^2 + x")
    page.get_by_role("button", name="Ask", exact=True).click()
    expect(page.locator("#answer")).to_contain_text("'x'")
    expect(function).to_have_attribute("aria-invalid", "true")
    expect(page.locator(".state")).to_have_text("No answer")
    page.get_by_label("What is asked").select_option(label=KINDS["integrals"])
    degree = page.get_by_label("in p, q, r")
    degree.fill("99")
    page.get_by_role("button", name="Ask", exact=True).click()
    expect(page.locator("#trouble-form")).to_contain_text("0 to 12 are accepted")
    expect(degree).to_be_focused()
    tab.faults[:] = [fault for fault in tab.faults if not fault.startswith("422 ")]


def test_letters_are_parameters_without_a_number(tab):
    page = tab.open("study")
    settle(page)
    page.get_by_label("Parameters").fill("k, a = 1/2")
    assert shown(page)["potential"]["parameters"] == {"k": None, "a": "1/2"}
    page.get_by_label("only where the areas integral is 0").check()
    page.get_by_label("Relations").fill("q\n p - r \n")
    assert (shown(page)["areas"], shown(page)["relations"]) == (0, ["q", "p - r"])
    page.get_by_label("A", exact=True).fill("")
    assert shown(page)["body"] == {"B": "2*C"}
