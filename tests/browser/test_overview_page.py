"""The overview: what is under way, as the events tell it, and the small pictures of the last solutions."""

import re

import pytest
from playwright.sync_api import expect

from tests.support.browser import HOSTILE, problem, settle
from tests.support.waiting import wait_until

POINTS = 2000
LONG = {
    "base": {**problem("first"), "accuracy": {"tier": "certified"}},
    "axes": [{"pointer": "/motion/lambda", "linspace": ["17/10", 3, POINTS]}],
    "keep": ["period", "energy", "error"],
}
"""Proven digits of so many motions take minutes: it is still running when it is cancelled."""


@pytest.fixture
def started(tab):
    """The overview, opened before a sweep is started, and the id of that sweep."""
    page = tab.open("")
    settle(page)
    expect(page.locator("#running")).to_be_hidden()
    answer = tab.site.service.call("POST", "/v1/sweeps", LONG)
    assert answer.status == 202, answer
    identity = answer.document["id"]
    yield page, identity
    tab.site.service.call("POST", f"/v1/sweeps/{identity}/cancel")


def test_a_sweep_is_seen_while_it_runs_and_goes_when_it_is_over(tab, started):
    page, identity = started
    path = f"/v1/sweeps/{identity}"
    row = page.locator("#running li", has=page.locator(f"a[href='./sweep?id={identity}']"))
    expect(row).to_contain_text(f"of {POINTS:,} points")
    expect(row).to_contain_text("running")
    link = row.get_by_role("link")
    link.focus()
    value = "one => Number(one.querySelector('progress').value)"
    first = row.evaluate(value)
    wait_until(lambda: row.evaluate(value) > first)
    shown = row.evaluate(value)
    # Asked afterwards: meanwhile more may be done, never less.
    assert 0 < shown <= tab.site.service.call("GET", path).document["done"] / POINTS
    # Its events have changed the row, and have not taken it away from who reads it.
    assert link.evaluate("one => one === document.activeElement")
    tab.site.service.call("PATCH", path, {"note": HOSTILE})
    page.reload()
    expect(row).to_contain_text("running")  # known without an event, too
    expect(row.get_by_role("link")).to_have_text(f"Sweep {HOSTILE}")
    tab.site.service.call("POST", f"{path}/cancel")
    expect(row).to_have_count(0)
    assert page.locator("img").count() == 0


def test_small_pictures_are_drawn_from_previews(tab):
    asked = []
    tab.page.on("request", lambda request: asked.append(request))
    page = tab.open("")
    settle(page)
    cards = page.locator("#cards > li")
    for card in cards.all():
        card.scroll_into_view_if_needed()
        expect(card.locator(".thumb svg path.curve").first).to_be_attached()
    series = [request for request in asked if "/trajectory" in request.url]
    assert len(series) == cards.count() > 1
    assert all(re.search(r"preview=160&columns=t,g1,g2,g3$", request.url) for request in series)
    assert {request.headers["accept"] for request in series} == {"application/x-npz"}


def test_a_motion_that_turns_too_often_has_no_picture_that_lies(tab):
    tab.page.route(
        "**/trajectory?*",
        lambda route: route.fulfill(
            status=200, headers={"Content-Type": "application/x-npz", "Polhode-Deviation": "0.4"}, body=b""
        ),
    )
    page = tab.open("")
    settle(page)
    page.locator("#cards .thumb").first.scroll_into_view_if_needed()
    expect(page.locator("#cards .thumb").first).to_have_text("It oscillates too fast for a small picture.")


def test_sweeps_have_names_and_pictures_and_solutions_of_one_problem_stand_together(tab):
    service = tab.site.service
    rougher = service.call(
        "POST", "/v1/jobs", {**problem("first"), "accuracy": {"tier": "draft"}}, Prefer="wait=60"
    )
    page = tab.open("")
    settle(page)
    expect(page.locator("#workers")).to_have_text(
        re.compile("^One worker, (ready|compiling.*); [01] of 1 places at work.$")
    )
    minutes = service.call("GET", "/v1/status").document["succeeded_by_minute"]
    assert sum(minutes) > 0
    expect(page.locator("#rate svg")).to_have_attribute(
        "aria-label", re.compile("^Jobs solved in each of the last 15 minutes")
    )
    sweep = page.locator(f"#sweeps a[href='./sweep?id={tab.site.sweep}']")
    # b varies, and is no part of the name.
    expect(sweep).to_have_text("a*g1 + b/g3^2, a = -1, over λ and b")
    expect(sweep.locator("canvas")).to_have_attribute(
        "aria-label", re.compile(r"^period over λ from 1/10 to 2 \(12 values\) and b")
    )
    # One card for the problem, with both of its solutions.
    both = [rougher.document["solution"], tab.site.solutions["first"]]
    card = page.locator("#cards > li", has=page.locator(f"a[href='./solution?id={both[0]}']"))
    expect(card).to_have_count(1)
    expect(card.locator(f"a[href='./solution?id={both[1]}']")).to_contain_text("standard, error")
    service.call("DELETE", f"/v1/solutions/{both[0]}")
