"""The ways that people go through the page, walked in Chromium."""

import json
import re
from urllib.parse import quote

from playwright.sync_api import expect

from tests.support.browser import HOSTILE, problem, settle

REFUTED = {**problem("first"), "potential": {"type": "expression", "expression": "g1 + g2/10"}}
FAULTY = {**problem("first"), "body": {"A": 2, "C": -1}}


def state_in(problem: object) -> str:
    return "workbench#" + quote(json.dumps(problem))


def test_from_a_formula_over_its_verdict_to_the_solution_and_into_it(tab):
    page = tab.open(state_in(problem("bobylev-steklov")))
    settle(page)
    page.get_by_label("Given as").select_option("expression")
    page.get_by_label("V, a formula").fill("a*g1 + b/g3^2")
    page.get_by_label("Parameters").fill("a = -1, b = 1/21")
    page.get_by_label("Kind").select_option("planar")
    page.get_by_label("λ", exact=True).fill("1")
    page.get_by_label("Periods").fill("")
    page.get_by_label("or until t").fill("10")
    expect(page.locator("#verdict")).to_contain_text("Admissible")
    expect(page.locator("#formulas math")).not_to_have_count(0)
    expect(page.locator("#atlas .scatterlayer path").first).to_be_attached()
    page.get_by_role("button", name="Compute").click()
    page.wait_for_url(re.compile(r"solution\?id="))
    expect(page.locator("h1")).to_contain_text("a*g1 + b/g3^2")
    # Zooming asks for the samples of exactly that stretch, far outside of what is stored.
    with page.expect_response(re.compile(r"trajectory\?start=1000000&stop=1000001&samples=\d+")) as asked:
        page.get_by_label("from").fill("1000000")
        page.get_by_label("to", exact=True).fill("1000001")
        page.get_by_role("button", name="Show").click()
    assert asked.value.json()["columns"]["t"][0] == 1e6
    expect(page.locator("#series-note")).to_contain_text("from 1000000 to 1000001")
    with page.expect_download() as download:
        page.get_by_role("button", name="CSV", exact=True).click()
    assert download.value.path().read_text(encoding="utf-8").startswith("t,p,q,r,g1,g2,g3")
    tab.faults[:] = [
        fault for fault in tab.faults if not fault.startswith("422 ")
    ]  # while the form was half filled


def test_a_refuted_potential_shows_its_counterexample_on_the_sphere(tab):
    page = tab.open(state_in(REFUTED))
    expect(page.locator("#verdict")).to_contain_text("Not admissible")
    expect(page.locator("#verdict")).to_contain_text("At γ = (")
    expect(page.locator("#sphere circle.wrong")).to_have_count(1)
    assert [
        fault for fault in tab.faults if not fault.startswith("422 ")
    ] == []  # the refusal of the whole problem
    tab.faults.clear()


def test_a_fault_stands_at_its_field(tab):
    page = tab.open(state_in(FAULTY))
    field = page.get_by_label("C", exact=True)
    expect(field).to_have_attribute("aria-invalid", "true")
    expect(page.locator(f"#{field.get_attribute('aria-describedby')}")).to_contain_text("moment of inertia")
    field.fill("1")
    expect(field).not_to_have_attribute("aria-invalid", "true")
    tab.faults[:] = [fault for fault in tab.faults if not fault.startswith("422 ")]


def test_a_click_on_the_atlas_picks_a_motion(tab):
    page = tab.open(state_in(problem("first")))
    plot = page.locator("#atlas .nsewdrag").first
    plot.wait_for()
    settle(page)
    before = page.get_by_label("λ", exact=True).input_value()
    box = plot.bounding_box()
    plot.click(position={"x": 0.8 * box["width"], "y": 0.8 * box["height"]})
    expect(page.get_by_label("λ", exact=True)).not_to_have_value(before)
    # The range is from 0.1 to 3: a click at four fifths of it.
    assert abs(float(page.get_by_label("λ", exact=True).input_value()) - (0.1 + 0.8 * 2.9)) < 0.05  # pixels
    tab.faults[:] = [fault for fault in tab.faults if not fault.startswith("422 ")]


def test_markup_that_people_wrote_is_text(tab):
    hostile = {"body": {"A": 2, "C": 1}, "potential": {"type": "expression", "expression": HOSTILE}}
    page = tab.open(state_in(hostile))
    expect(page.get_by_label("V, a formula")).to_have_attribute("aria-invalid", "true")
    assert page.locator("img").count() == 0
    tab.faults[:] = [fault for fault in tab.faults if not fault.startswith("422 ")]


def test_a_list_is_asked_by_text_by_facets_and_by_its_address(tab):
    page = tab.open("solutions?where=period<6")
    settle(page)
    rows = page.locator("tbody tr")
    answer = tab.site.service.call("GET", "/v1/solutions?where=period%3C6").document
    assert answer["items"]
    expect(rows).to_have_count(len(answer["items"]))
    page.get_by_role("button", name="Take away period<6").click()
    expect(rows).to_have_count(tab.site.service.call("GET", "/v1/solutions").document["total"])
    page.get_by_role("group", name="How often").get_by_role("button", name="integration").click()
    expect(rows).to_have_count(1)
    assert page.url.endswith("?where=method%3Dintegration")
    page.go_back()
    expect(rows).not_to_have_count(1)
    page.get_by_label("Where").fill("perid<5")
    page.get_by_role("button", name="Ask").click()
    expect(page.locator("#where-fault")).to_contain_text("there is no column 'perid'")
    assert tab.faults == [f"422 {tab.site.address}/v1/solutions?limit=25&where=perid%3C5"]
    tab.faults.clear()
