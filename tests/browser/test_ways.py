"""The ways that people go through the page, walked in Chromium."""

import io
import json
import re
import unicodedata
from urllib.parse import quote

import numpy as np
import pytest
from playwright.sync_api import expect

from tests.support.browser import HOSTILE, problem, settle
from tests.support.waiting import wait_until

REFUTED = {**problem("first"), "potential": {"type": "expression", "expression": "g1 + g2/10"}}
FAULTY = {**problem("first"), "body": {"A": 2, "C": -1}}
SHOWN = {"p": "p", "q": "q", "r": "r", "g1": "γ₁", "g2": "γ₂", "g3": "γ₃"}
PLAIN = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-")


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
    # Zooming asks for the samples of exactly that stretch, far outside of what is stored, as packed numbers.
    with page.expect_response(re.compile(r"trajectory\?start=1000000&stop=1000001&preview=\d+")) as asked:
        page.get_by_label("from").fill("1000000")
        page.get_by_label("to", exact=True).fill("1000001")
        page.get_by_role("button", name="Show").click()
    columns = np.load(io.BytesIO(asked.value.body()))
    assert [columns["t"][0], columns["t"][-1]] == [1e6, 1e6 + 1]
    expect(page.locator("#series-note")).to_contain_text("From 1000000 to 1000001")
    assert "start=1000000&stop=1000001" in page.url
    with page.expect_download() as download:
        page.get_by_role("button", name="CSV", exact=True).click()
    assert download.value.path().read_text(encoding="utf-8").startswith("t,p,q,r,g1,g2,g3")
    page.get_by_label("or the one with the id").fill(tab.site.solutions["first"])
    page.get_by_role("button", name="Compare", exact=True).click()
    expect(page.locator("#compare-note")).to_contain_text("they are different motions")
    expect(page.locator("#overlay .scatterlayer path.js-line").first).to_be_attached()
    assert page.url.endswith(f"with={tab.site.solutions['first']}")
    tab.faults[:] = [
        fault for fault in tab.faults if not fault.startswith("422 ")
    ]  # while the form was half filled


def test_a_long_sum_goes_on_in_the_next_line(tab):
    many = {"type": "rational", "a": [-1, 1, 1], "b": ["1/20", 1, 1], "c": [1, 1]}
    page = tab.open(state_in({**problem("first"), "potential": many}))
    lines = page.locator(".formula-line")
    expect(lines.nth(2).locator("math")).not_to_have_count(1)
    sizes = lines.evaluate_all(
        "all => all.map((one) => [one.scrollWidth, one.clientWidth, one.offsetHeight])"
    )
    # h, F and G are sums; nothing of them is cut off.
    assert all(needed <= there for needed, there, _ in sizes[:3]), sizes
    # Letters of formulas are not those of text, and there are signs that nobody sees.
    text = re.sub(r"[\s\u2062]", "", unicodedata.normalize("NFKC", lines.nth(0).inner_text()))
    assert all(name in text for name in ("a1", "a2", "a3", "b1", "b2", "b3", "c1")), text
    tab.faults[:] = [fault for fault in tab.faults if not fault.startswith("422 ")]


def test_solutions_are_compared_with_the_errors_that_both_claim(tab):
    """The same motion at a looser tier: as far apart as the service's own samples, within both errors."""
    service = tab.site.service
    first = tab.site.solutions["first"]
    draft = {**problem("first"), "accuracy": {"tier": "draft"}}
    other, _ = service.solve(draft)
    page = tab.open(f"solution?id={first}&with={other['id']}")
    note = page.locator("#compare-note")
    expect(note).to_contain_text("they agree")
    shown = (
        r"the largest difference is (.+?), in (\S+) at t = (\S+), "
        r"within the sum of both claimed errors, (.+?): they agree"
    )
    apart, name, _, claimed = re.search(shown, note.inner_text()).groups()
    stop = service.call("GET", f"/v1/solutions/{first}/trajectory").document["columns"]["t"][-1]
    columns = "t,p,q,r,g1,g2,g3"
    query = f"start=0&stop={stop!r}&samples=800&columns={columns}"
    ours, theirs = (
        service.call("GET", f"/v1/solutions/{k}/trajectory?{query}").document for k in (first, other["id"])
    )
    gaps = {
        k: max(abs(x - y) for x, y in zip(ours["columns"][k], theirs["columns"][k], strict=True))
        for k in columns.split(",")
    }
    largest = max(gaps, key=gaps.__getitem__)
    assert SHOWN[largest] == name
    # Two digits are shown.
    assert float(apart.translate(PLAIN).replace(" × 10", "e")) == pytest.approx(gaps[largest], rel=0.05)
    both = ours["error"] + theirs["error"]
    assert float(claimed.translate(PLAIN).replace(" × 10", "e")) == pytest.approx(both, rel=0.05)
    expect(page.locator("#apart .scatterlayer .points path").first).to_be_attached()
    # Looked at from the list, too; and taken away again.
    expect(page.locator("#compare optgroup").first).to_have_attribute("label", "The same motion")
    page.get_by_role("button", name=f"Compare no more with {other['id']}").click()
    expect(page.locator("#compare-charts")).to_be_hidden()
    assert "with=" not in page.url


def test_who_is_faster_than_what_compares_is_heard(tab):
    """The module that compares comes once somebody looks there: a click before it has come is not lost."""
    first, other = (tab.site.solutions[name] for name in ("first", "bobylev-steklov"))
    held = []
    tab.page.route("**/compare.js", lambda route: held.append(route))
    page = tab.open(f"solution?id={first}")
    settle(page)
    page.get_by_label("or the one with the id").fill(other)
    page.get_by_role("button", name="Compare", exact=True).click()
    wait_until(lambda: page.title() and held)  # asking the page lets the request be seen
    expect(page.locator("#compare-note")).to_be_empty()
    held[0].continue_()
    expect(page.locator("#compare-note")).to_contain_text("they are different motions")
    assert page.url.endswith(f"with={other}")


def test_a_late_answer_leaves_the_field_alone_that_somebody_is_in(tab):
    """They are about to type over what stands there; once they leave, it tells what is shown."""
    held = []
    tab.page.route("**/trajectory?*", lambda route: held.append(route))
    page = tab.open(f"solution?id={tab.site.solutions['first']}&start=1&stop=2")
    expect(page.locator("#title")).not_to_be_empty()
    field, other = page.get_by_label("from"), page.get_by_label("to", exact=True)
    expect(field).to_be_visible()  # the title comes first, and what is hidden takes no focus
    field.focus()
    expect(field).to_be_focused()
    wait_until(lambda: page.title() and held)  # asking the page lets the request be seen
    held[0].continue_()
    expect(page.locator("#series-note")).to_contain_text("From 1 to 2")
    assert (field.input_value(), other.input_value()) == ("", "")
    field.blur()
    assert (field.input_value(), other.input_value()) == ("1", "2")
    field.fill("0")
    field.blur()
    assert (field.input_value(), other.input_value()) == ("0", "2")


def test_an_id_that_is_no_solution_is_refused_beside_the_others(tab):
    page = tab.open(f"solution?id={tab.site.solutions['first']}&with=nothing")
    expect(page.locator("#compare-note .bad")).to_contain_text("no solution")
    assert tab.faults == [f"404 {tab.site.address}/v1/solutions/nothing"]
    tab.faults.clear()


def test_what_cannot_be_drawn_as_lines_is_not(tab):
    """A hundred million periods are told as what each variable goes through; a period of them is drawn."""
    path = f"/v1/solutions/{tab.site.solutions['first']}"
    stop = 1e8 * tab.site.service.call("GET", path).document["period"]["value"]
    stored = tab.site.service.call("GET", f"{path}/trajectory").document
    query = f"start=0&stop={stop!r}&samples=800&columns=t,p,q,r,g1,g2,g3"
    error = tab.site.service.call("GET", f"{path}/trajectory?{query}").document["error"]
    page = tab.open(f"solution?id={tab.site.solutions['first']}&start=0&stop={stop!r}")
    note = page.locator("#series-note")
    expect(note).to_contain_text("too many to be drawn")
    expect(note).to_contain_text("1 × 10⁸ periods")
    shown = page.evaluate(
        "document.getElementById('series').data.map(({name, x, y}) => ({name, x: [...x], y: [...y]}))"
    )
    for name, short in SHOWN.items():
        low, high = (trace["y"] for trace in shown if trace["name"] == short)
        values = stored["columns"][name]
        # The samples of one period are inside; beyond them are the error at that time, which is told, and the
        # hundredth of the range by which drawn lines may be off.
        reach = 0.01 * (max(values) - min(values)) + 1.001 * error
        assert min(values) - reach <= low[0] <= min(values)
        assert max(values) <= high[0] <= max(values) + reach
    page.get_by_role("button", name="One period").click()
    expect(note).to_contain_text("the lines between them are off by at most")
    assert page.evaluate("document.getElementById('series').data.every(({x}) => x.length >= 400)")


def test_an_error_that_can_be_seen_is_drawn_as_a_band(tab):
    solution = tab.site.solutions["first"]
    page = tab.open(f"solution?id={solution}")
    settle(page)
    series = page.locator("#series")
    series.locator(".scatterlayer path").first.wait_for()
    bands = "document.getElementById('series').data.filter(({fill}) => fill === 'tonexty').length"
    assert page.evaluate(bands) == 0
    # A thousandth of a billionth of the height of γ: the told error is more than a pixel of it.
    page.evaluate("Plotly.relayout('series', {'yaxis2.range[0]': 0.5, 'yaxis2.range[1]': 0.5 + 1e-12})")
    wait_until(lambda: page.evaluate(bands) == 3)
    error = tab.site.service.call(
        "GET", f"/v1/solutions/{solution}/trajectory?preview=400&columns=t,p,q,r,g1,g2,g3"
    ).document["error"]
    first_values = (
        "document.getElementById('series').data.filter(({name}) => name === 'γ₁').map(({y}) => y[0])"
    )
    low, high, _ = page.evaluate(first_values)
    assert high - low == pytest.approx(2 * error, rel=1e-3)  # the rounding of values near 1


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


def test_an_atlas_that_takes_long_is_drawn_by_a_job(tab):
    """As if it took long: the service is asked for a job, which a worker does."""
    drawn = re.compile(r"/v1/atlases$")

    def by_job(route):
        headers = {**route.request.headers, "prefer": "respond-async"}
        route.continue_(headers=headers)

    tab.page.route(drawn, by_job)
    with tab.page.expect_response(drawn) as asked, tab.page.expect_response(re.compile(r"/v1/atlases/\S+")):
        tab.open(state_in(problem("first")))
    assert asked.value.status == 202
    expect(tab.page.locator("#atlas .scatterlayer path").first).to_be_attached()
    expect(tab.page.locator("#fault-atlas")).to_be_empty()


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
    settle(page)
    expect(rows).to_have_count(tab.site.service.call("GET", "/v1/solutions").document["total"])
    page.get_by_role("group", name="How often").get_by_role("button", name="integration").click()
    # Other tests integrate on this site as well.
    integrated = tab.site.service.call("GET", "/v1/solutions?where=method%3Dintegration").document["items"]
    expect(rows).to_have_count(len(integrated))
    settle(page)
    assert page.url.endswith("?where=method%3Dintegration")
    page.go_back()
    expect(rows).not_to_have_count(len(integrated))
    settle(page)
    page.get_by_label("Filter").fill("perid<5")
    page.get_by_role("button", name="Search").click()
    expect(page.locator("#where-fault")).to_contain_text("there is no column 'perid'")
    assert tab.faults == [f"422 {tab.site.address}/v1/solutions?limit=25&where=perid%3C5"]
    tab.faults.clear()
