"""Solutions, jobs and sweeps as tables: labels of many rows, order, pages, failures in words."""

import re
from urllib.parse import quote

import pytest
from playwright.sync_api import expect

from tests.support.browser import HOSTILE, problem, settle

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
    page.get_by_label("Order").fill("perid")
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
    row = page.locator("tbody tr", has_text="This motion cannot be enclosed")
    expect(row).to_contain_text(jobs["error"]["detail"])
    expect(row).to_contain_text(f"origin: {HOSTILE}")
    expect(row.locator(".note")).to_have_text(HOSTILE)
    row.locator("summary").click()
    expect(row.locator("details li")).to_contain_text("1: failed, by ")
    assert page.locator("img").count() == 0
    page.get_by_role("group", name="How often").get_by_role("button", name=HOSTILE).click()
    expect(page.locator("tbody tr")).to_have_count(1)
