"""Solutions, jobs and sweeps as tables: labels of many rows, order, pages, failures in words."""

import csv
import io
import re
from urllib.parse import quote

import pytest
from playwright.sync_api import expect

from tests.support.browser import HOSTILE, barriers, problem, settle
from tests.support.effort import seldom

UNPROVABLE = {
    **problem("first"),
    "potential": {
        "type": "expression",
        "expression": "a*g1 - b/g3^2",
        "parameters": {"a": -1, "b": "1/20"},
    },
    "motion": {"type": "planar", "lambda": "1/10"},
    "accuracy": {"tier": "certified"},
}
"""A collision: the job fails, since the certified tier encloses periodic motions only."""
MANY = 30


@pytest.fixture(scope="module")
def jobs(site):
    """Many jobs of one solved problem, each with a label, and one that failed."""
    marked = [{**problem("first"), "labels": {"paging": str(place)}} for place in range(MANY)]
    answer = site.service.call("POST", "/v1/jobs", marked)
    assert all(item["status"] < 300 for item in answer.document["items"]), answer
    failed = {**UNPROVABLE, "labels": {"origin": HOSTILE}, "note": HOSTILE}
    answer = site.service.call("POST", "/v1/jobs", failed, Prefer="wait=60")
    assert answer.document["state"] == "failed", answer
    return answer.document


def labels_of(tab) -> dict[str, dict]:
    items = tab.site.service.call("GET", "/v1/solutions").document["items"]
    return {item["id"]: item["labels"] for item in items}


def test_labels_are_given_to_many_rows_by_the_keyboard_and_a_conflict_is_told_in_its_row(tab):
    page = tab.open("solutions")
    settle(page)
    count = len(labels_of(tab))
    expect(page.locator("#bulk")).to_be_hidden()
    page.get_by_label("Choose all on this page").focus()
    page.keyboard.press("Tab")
    while not page.evaluate("document.activeElement.matches('input.choose')"):
        page.keyboard.press("Tab")
    page.keyboard.press("Space")
    expect(page.locator("#said")).to_have_text("1 chosen")
    page.get_by_label("Choose all on this page").check()
    expect(page.locator("#chosen")).to_have_text(f"{count} chosen")
    changed = next(iter(labels_of(tab)))
    path = f"/v1/solutions/{changed}"
    tab.site.service.call("PATCH", path, {"labels": {"project": "of somebody else"}})
    page.get_by_label("label", exact=True).fill("project")
    page.get_by_label("value", exact=True).fill(HOSTILE)
    with page.expect_request(lambda request: request.method == "PATCH") as sent:
        page.get_by_role("button", name="Add label").click()
    assert re.fullmatch(r'"[^"]+"', sent.value.headers["if-match"])
    told = f"{count - 1} changed, 1 failed: the reasons are in their rows"
    expect(page.locator("#bulk-outcome")).to_have_text(told)
    expect(page.locator("tbody .fault")).to_have_text(
        "Not changed: somebody has changed project meanwhile; it is now of somebody else"
    )
    wanted = {identity: {"project": HOSTILE} for identity in labels_of(tab)}
    assert labels_of(tab) == {**wanted, changed: {"project": "of somebody else"}}
    assert page.locator("img").count() == 0
    # What was not changed is still chosen, and by now what it has is on the page.
    expect(page.locator("#chosen")).to_have_text("1 chosen")
    page.get_by_label("Choose all on this page").check()
    page.get_by_role("button", name="Remove label").click()
    expect(page.locator("#bulk-outcome")).to_have_text(f"{count} changed")
    assert set(map(str, labels_of(tab).values())) == {"{}"}


def test_heads_of_columns_sort_by_several_columns_and_the_address_holds_them(tab):
    page = tab.open("solutions")
    settle(page)
    page.get_by_role("button", name="Tier").click()
    settle(page)
    expect(page.get_by_role("columnheader", name="Tier")).to_have_attribute("aria-sort", "ascending")
    page.get_by_role("button", name="Energy").click(modifiers=["Shift"])
    settle(page)
    expect(page.get_by_role("columnheader", name="Energy")).to_have_attribute("aria-sort", "ascending")
    page.get_by_role("button", name="Energy").click(modifiers=["Shift"])
    expect(page.get_by_role("columnheader", name="Energy")).to_have_attribute("aria-sort", "descending")
    assert page.url.endswith(f"?order={quote('tier,-energy', safe='')}")
    answer = tab.site.service.call("GET", "/v1/solutions?order=tier,-energy").document
    ids = [item["id"] for item in answer["items"]]
    assert [box.get_attribute("data-id") for box in page.locator("input.choose").all()] == ids
    page.get_by_label("Sort by").fill("perid")
    page.keyboard.press("Enter")
    expect(page.locator("#order-fault")).to_contain_text("'perid'")
    tab.faults[:] = [fault for fault in tab.faults if not fault.startswith("422 ")]


def test_a_page_of_a_list_has_an_address_that_can_be_sent_to_others(tab, jobs):
    page = tab.open("jobs?where=" + quote("label.paging is not null"))
    settle(page)
    rows = page.locator("tbody tr")
    expect(rows).to_have_count(25)
    first = {box.get_attribute("data-id") for box in page.locator("input.choose").all()}
    page.get_by_role("button", name="Next page").click()
    expect(rows).to_have_count(MANY - 25)
    settle(page)
    other = page.context.new_page()
    other.goto(page.url)
    settle(other)
    expect(other.locator("tbody tr")).to_have_count(MANY - 25)
    assert first.isdisjoint(box.get_attribute("data-id") for box in other.locator("input.choose").all())
    other.get_by_role("link", name="First page").click()
    expect(other.locator("tbody tr")).to_have_count(25)
    # A label of a row is a condition at a click.
    page.get_by_role("button", name="paging: 3", exact=True).click()
    expect(rows).to_have_count(1)
    assert page.get_by_role("button", name="Take away label.paging=3").is_visible()


def test_a_failure_is_told_in_words_with_its_attempts(tab, jobs):
    page = tab.open("jobs?where=state=failed")
    settle(page)
    row = page.locator("tbody tr", has_text="Missing moment")
    expect(row).to_contain_text(jobs["error"]["detail"])
    expect(row).to_contain_text(f"origin: {HOSTILE}")
    expect(row.locator(".note")).to_have_text(HOSTILE)
    row.locator("summary").click()
    expect(row.locator("details li")).to_contain_text("1: failed, by ")
    assert page.locator("img").count() == 0
    page.get_by_role("group", name="How often").get_by_role("button", name=HOSTILE).click()
    expect(page.locator("tbody tr")).to_have_count(1)


def ids_of(page) -> set[str]:
    return {box.get_attribute("data-id") for box in page.locator("input.choose").all()}


def test_what_a_failed_job_would_have_met_is_filled_in(tab):
    """A tolerance below what doubles reach of this motion, by a method that has nothing else."""
    impossible = {**problem("state"), "accuracy": {"tolerance": "1e-15"}, "method": "integration"}
    job = tab.site.service.call("POST", "/v1/jobs", impossible, Prefer="wait=60").document
    assert job["error"]["code"] == "accuracy_not_met", job
    accepted = job["error"]["accepted"]["tolerance"]
    page = tab.open(f"jobs?where=id={job['id']}")
    settle(page)
    page.get_by_role("link", name="Open with the tolerance").click()
    expect(page.get_by_label("or a tolerance")).to_have_value(str(accepted).replace("e-0", "e-"))
    settle(page)
    with page.expect_response(lambda answer: answer.url.endswith("/v1/jobs")) as sent:
        page.get_by_role("button", name="Compute").click()
    assert float(sent.value.request.post_data_json["accuracy"]["tolerance"]) == accepted
    page.wait_for_url(re.compile(r"solution\?id="))  # it is met
    tab.site.service.call("DELETE", f"/v1/solutions/{page.url.rpartition('=')[2]}")


def test_chosen_rows_are_compared_saved_sent_again_and_deleted(tab):
    service = tab.site.service
    page = tab.open("solutions")
    settle(page)
    before = ids_of(page)
    compare = page.get_by_role("button", name="Compare")
    page.locator(f"input[data-id='{tab.site.solutions['first']}']").check()
    expect(compare).to_be_disabled()  # with what?
    assert barriers(page) == []
    page.locator(f"input[data-id='{tab.site.solutions['unstable']}']").check()
    with page.expect_download() as download:
        page.get_by_role("button", name="Download as CSV").click()
    rows = list(csv.DictReader(io.StringIO(download.value.path().read_text(encoding="utf-8"))))
    assert {row["id"] for row in rows} == {tab.site.solutions["first"], tab.site.solutions["unstable"]}
    compare.click()
    expect(page.locator("#compare-note")).to_contain_text("they are different motions")
    # Narrow screens do not scroll sideways, and the navigation leaves the page nine tenths of the height.
    page.set_viewport_size({"width": 390, "height": 844})
    expect(page.locator("#overlay .main-svg").first).to_be_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.locator("header.top").bounding_box()["height"] <= 844 / 10
    page.set_viewport_size({"width": 1280, "height": 800})

    marked = {**UNPROVABLE, "labels": {"act": "yes"}}
    failed = [service.call("POST", "/v1/jobs", marked, Prefer="wait=60").document["id"] for _ in range(2)]
    page = tab.open("jobs?where=" + quote("label.act=yes"))
    settle(page)
    assert ids_of(page) == set(failed)
    page.locator(f"input[data-id='{failed[0]}']").check()
    expect(page.get_by_role("button", name="Cancel", exact=True)).to_be_disabled()  # it is over
    page.get_by_role("button", name="Solve again").click()
    expect(page.locator("#bulk-outcome")).to_have_text("1 sent again")
    expect(page.locator("tbody tr")).to_have_count(3)
    expect(page.locator("tbody .state.failed")).to_have_count(3)  # for the same reason
    page.get_by_label("Choose all on this page").check()
    dialog = page.get_by_role("dialog", name="Delete?")
    page.get_by_role("button", name="Delete…").click()
    expect(dialog).to_contain_text("3 jobs will be deleted")
    dialog.get_by_role("button", name="Cancel").click()
    expect(page.locator("tbody tr")).to_have_count(3)
    page.get_by_role("button", name="Delete…").click()
    dialog.get_by_role("button", name="Delete", exact=True).click()
    expect(page.locator("#bulk-outcome")).to_have_text("3 deleted")
    expect(page.locator("#table")).to_have_text("Nothing meets these conditions.")
    assert service.call("GET", f"/v1/jobs/{failed[0]}").status == 404
    assert {item["id"] for item in service.call("GET", "/v1/solutions").document["items"]} == before


@pytest.mark.parametrize("name", ["sweeps", *seldom("solutions", "jobs")])
def test_examples_of_questions_are_answered_and_what_is_refused_can_be_taken_away(tab, name):
    page = tab.open(name)
    settle(page)
    asked = {"where": page.get_by_label("Filter"), "order": page.get_by_label("Sort by")}
    query = "&".join(f"{key}={quote(field.get_attribute('placeholder'))}" for key, field in asked.items())
    assert tab.site.service.call("GET", f"/v1/{name}?{query}").status == 200, query
    # The list of orders is one of what may be typed, too.
    orders = page.locator("#orders option").evaluate_all("found => found.map((one) => one.value)")
    assert orders
    page.get_by_label("Filter").fill("nothing=1, created_at>=2026-01-01")
    page.keyboard.press("Enter")
    expect(page.locator("#where-fault")).to_contain_text("'nothing'")
    expect(page.locator("#table")).to_have_class(re.compile("stale"))
    page.get_by_role("button", name="Take away nothing=1").click()
    expect(page.locator("#where-fault")).to_be_empty()
    expect(page.locator("#table")).not_to_have_class(re.compile("stale"))
    expect(page.locator("#chips li")).to_have_count(1)
    tab.faults[:] = [fault for fault in tab.faults if not fault.startswith("422 ")]


@pytest.mark.parametrize("what", ["sweep", *seldom("solution")])
def test_what_is_not_there_has_a_page_that_leads_to_its_list(tab, what):
    page = tab.open(f"{what}?id=019f0000-0000-7000-8000-000000000001")
    expect(page.locator("h1")).to_have_text(f"There is no such {what}")
    page.get_by_role("link", name=f"All {what}s").click()
    settle(page)
    assert page.url.endswith(f"/{what}s")
    tab.faults[:] = [fault for fault in tab.faults if not fault.startswith("404 ")]
