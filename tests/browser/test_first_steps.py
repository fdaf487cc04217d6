"""Somebody's first minutes: tours on an empty database, and the way to the picture of a first sweep."""

import re

import pytest
from playwright.sync_api import expect

from tests.support.browser import Site, Watched, barriers, save_first_figure, settle
from tests.support.effort import seldom
from tests.support.serving import serving

MOST_CLICKS = 8


@pytest.fixture(scope="module")
def empty(chromium_path, tmp_path_factory):
    """A service whose database is empty, with a worker."""
    with serving(tmp_path_factory.mktemp("first")) as service:
        yield Site(service, {}, "")


@pytest.fixture
def newcomer(context, empty):
    tab = Watched(context.new_page(), empty)
    yield tab
    # What is refuted on purpose, and what would be refused while it is typed.
    assert [fault for fault in tab.faults if not fault.startswith("422 ")] == []


def stored(site: Site) -> list[str]:
    """Return what is in the database."""
    names = ("jobs", "solutions", "sweeps")
    return [
        item["id"] for name in names for item in site.service.call("GET", f"/v1/{name}").document["items"]
    ]


@pytest.mark.parametrize(
    ("title", "last", "count"),
    [("Sweep", "downloads", 4), *seldom(("Judge", "atlas-section", 4), ("Compute", "downloads", 5))],
)
def test_a_tour_goes_to_its_end_and_leaves_nothing_behind(newcomer, title, last, count):
    before = stored(newcomer.site)
    page = newcomer.open("")
    settle(page)
    # Where nothing is stored, how to begin stands first.
    assert page.locator(".hero + #begin").count() == (not before)
    card = page.locator("#begin li", has_text=title)
    card.get_by_role("button", name="Take the tour").click()
    tour = page.get_by_role("complementary", name=f"Tour: {title}")
    for step in range(1, count + 1):
        expect(tour).to_contain_text(f"{step} of {count}")
        expect(page.locator(".toured")).to_have_count(1)
        if step < count:
            tour.get_by_role("button", name="Next").click()
    expect(page.locator(f"#{last}.toured")).to_be_visible()
    assert title == "Judge" or barriers(page) == []
    assert len(stored(newcomer.site)) - len(before) == {"Judge": 0, "Compute": 2, "Sweep": 1}[title]
    tour.get_by_role("button", name=re.compile("^End the tour")).click()
    page.wait_for_url(newcomer.site.address + "/")
    assert stored(newcomer.site) == before
    expect(page.locator("#tour")).to_have_count(0)


def test_from_the_empty_database_to_a_saved_picture_of_a_sweep(newcomer):
    page = newcomer.open("")
    settle(page)
    saved, clicks = save_first_figure(page)
    assert clicks <= MOST_CLICKS
    content = saved.path().read_text(encoding="utf-8")
    assert "<svg" in content
    assert "period" in content
    identity = page.url.rpartition("=")[2]
    found = newcomer.site.service.call("GET", f"/v1/sweeps/{identity}").document["document"]
    assert found["axes"] == [
        {"pointer": "/motion/lambda", "linspace": [0.1, 3, 40]},
        {"pointer": "/potential/parameters/b", "linspace": [0.025, 0.1, 40]},
    ]
    assert found["keep"] == ["period", "period.error", "energy", "energy.error", "error"]


def test_a_sweep_that_would_be_refused_cannot_be_started(newcomer):
    page = newcomer.open("sweeps")
    settle(page)
    page.get_by_role("button", name="New sweep…").click()
    dialog = page.get_by_role("dialog", name="A new sweep")
    start = dialog.get_by_role("button", name="Start the sweep")
    expect(start).to_be_enabled()
    count = dialog.get_by_label("number of values, axis 1")
    count.fill("0")
    expect(dialog.locator("#sweep-axes .fault").first).to_contain_text("1 to 100000000 are accepted")
    expect(start).to_be_disabled()
    assert barriers(page) == []
    count.fill("3")
    expect(dialog.locator("#sweep-cost")).to_contain_text("3 points: ")
    expect(dialog.locator("#sweep-axes .fault").first).to_be_empty()
    before = len(stored(newcomer.site))
    page.keyboard.press("Enter")  # in a field it starts nothing, and throws nothing away
    expect(dialog).to_be_visible()
    page.keyboard.press("Escape")
    expect(dialog).to_be_hidden()
    assert len(stored(newcomer.site)) == before
