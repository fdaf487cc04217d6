"""Somebody's first minutes: tours on an empty database, and the way to the picture of a first sweep."""

import re

import pytest
from playwright.sync_api import expect

from tests.support.browser import Site, Watched, settle
from tests.support.serving import serving

COUNT_CLICKS = """addEventListener("click", ({isTrusted}) => {
  if (isTrusted) sessionStorage.setItem("clicks", Number(sessionStorage.getItem("clicks") ?? 0) + 1);
}, true)"""


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


def test_each_tour_goes_to_its_end_and_leaves_nothing_behind(newcomer):
    for title, last, count in (
        ("Judge", "atlas-section", 4),
        ("Compute", "downloads", 5),
        ("Sweep", "downloads", 4),
    ):
        page = newcomer.open("")
        settle(page)
        assert page.locator(".hero + #begin").count() == 1  # nothing is there: how to begin stands first
        card = page.locator("#begin li", has_text=title)
        card.get_by_role("button", name="Take the tour").click()
        tour = page.get_by_role("complementary", name=f"Tour: {title}")
        for step in range(1, count + 1):
            expect(tour).to_contain_text(f"{step} of {count}")
            expect(page.locator(".toured")).to_have_count(1)
            if step < count:
                tour.get_by_role("button", name="Next").click()
        expect(page.locator(f"#{last}.toured")).to_be_visible()
        assert bool(stored(newcomer.site)) == (title != "Judge")
        tour.get_by_role("button", name=re.compile("^End the tour")).click()
        page.wait_for_url(newcomer.site.address + "/")
        assert stored(newcomer.site) == []
    expect(page.locator("#tour")).to_have_count(0)


def test_from_the_empty_database_to_the_picture_of_a_sweep(newcomer):
    page = newcomer.page
    page.add_init_script(COUNT_CLICKS)
    newcomer.open("")
    settle(page)
    page.get_by_role("link", name="Workbench", exact=True).click()
    page.get_by_role("button", name="Sweep over λ…").click()
    dialog = page.get_by_role("dialog", name="A new sweep")
    expect(dialog.locator("#sweep-cost")).to_contain_text("200 points: ")
    # What would be refused is told at its axis, and nothing can be started before it is mended.
    count = dialog.get_by_label("number of values, axis 1")
    count.fill("0")
    expect(dialog.locator("#sweep-axes .fault").first).to_contain_text("1 to 100000000 are accepted")
    expect(dialog.get_by_role("button", name="Start the sweep")).to_be_disabled()
    count.fill("200")
    dialog.get_by_label("Axis 2", exact=True).select_option(label="b")
    expect(dialog.locator("#sweep-cost")).to_contain_text("1,600 points: ")
    dialog.get_by_role("button", name="Start the sweep").click()
    page.wait_for_url(re.compile(r"sweep\?id="))
    expect(page.locator("#progress")).to_contain_text("1,600 of 1,600")
    expect(page.locator("#picture-note")).to_contain_text("motions")
    assert int(page.evaluate("sessionStorage.getItem('clicks')")) == 3
    identity = page.url.rpartition("=")[2]
    found = newcomer.site.service.call("GET", f"/v1/sweeps/{identity}").document["document"]
    assert found["axes"] == [
        {"pointer": "/motion/lambda", "linspace": [0.1, 3, 40]},
        {"pointer": "/potential/parameters/b", "linspace": [0.025, 0.1, 40]},
    ]
    assert found["keep"] == ["period", "period.error", "energy", "energy.error", "error"]
