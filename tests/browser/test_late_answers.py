"""Answers that come late: nothing is lost that somebody has typed, pressed or chosen meanwhile."""

import json
import re
from urllib.parse import quote

import pytest
from playwright.sync_api import Page, Route, expect

from tests.support.browser import problem, settle
from tests.support.waiting import wait_until


class Held:
    """Requests that are not let through before ``go``."""

    def __init__(self, page: Page, address: object) -> None:
        self._page, self._is_open = page, False
        self.routes: list[Route] = []
        page.route(address, self._asked)

    def _asked(self, route: Route) -> None:
        if self._is_open:
            route.continue_()
        else:
            self.routes.append(route)

    def come(self, count: int = 1) -> None:
        """Wait until so many are held; asking the page lets them be seen."""
        wait_until(lambda: self._page.title() is not None and len(self.routes) >= count)

    def go(self) -> None:
        """Let all through, and whatever is asked from now on."""
        self._is_open = True
        for route in self.routes:
            route.continue_()


def test_a_problem_has_its_tier_before_the_tiers_can_be_chosen(tab):
    held = Held(tab.page, "**/v1/accuracy")
    accurate = {**problem("first"), "accuracy": {"tier": "certified"}}
    page = tab.open("workbench#" + quote(json.dumps(accurate)))
    held.come()
    with page.expect_request("**/v1/jobs") as sent:
        page.get_by_role("button", name="Compute").click()
    assert sent.value.post_data_json["accuracy"] == {"tier": "certified"}
    page.wait_for_url(re.compile(r"solution\?id="))
    page.unroute_all(behavior="ignoreErrors")


def test_whoever_writes_another_problem_is_not_taken_to_the_solution_of_the_last_one(tab):
    held = Held(tab.page, "**/v1/jobs")
    page = tab.open("workbench#" + quote(json.dumps(problem("first"))))
    settle(page)
    page.get_by_role("button", name="Compute").click()
    held.come()
    page.get_by_label("V, a formula").fill("a*g1 + b/g3^2 + 1")
    held.go()
    link = page.locator("#job").get_by_role("link", name="see the solution")
    expect(link).to_have_attribute("href", f"./solution?id={tab.site.solutions['first']}")
    expect(page.get_by_label("V, a formula")).to_have_value("a*g1 + b/g3^2 + 1")
    page.get_by_label("V, a formula").fill("a*g1 + b/g3^2 + 2")
    expect(page.get_by_role("button", name="Compute")).to_be_enabled()
    expect(link).to_be_visible()


def test_what_is_typed_into_a_question_while_labels_are_set_stays(tab):
    page = tab.open("solutions")
    settle(page)
    held = Held(tab.page, re.compile(r"/v1/solutions/\S+$"))
    page.locator("input.choose").first.check()
    page.get_by_label("label", exact=True).fill("late")
    page.get_by_label("value", exact=True).fill("yes")
    button = page.get_by_role("button", name="Add label")
    button.focus()
    page.keyboard.press("Enter")
    held.come()
    page.get_by_label("Filter").fill("period<")
    held.go()
    expect(page.locator("#bulk-outcome")).to_have_text("1 changed")
    expect(page.get_by_label("Filter")).to_have_value("period<")
    # A button that could not be pressed meanwhile has its focus again, unless somebody has gone elsewhere.
    expect(page.get_by_label("Filter")).to_be_focused()
    page.locator("input.choose").first.check()
    page.get_by_role("button", name="Remove label").focus()
    page.keyboard.press("Enter")
    expect(page.locator("#chosen")).to_have_text("")
    expect(page.get_by_role("button", name="Remove label")).to_be_focused()


def test_who_sorts_by_the_keyboard_stays_at_the_head(tab):
    page = tab.open("solutions")
    settle(page)
    page.get_by_role("button", name="Tier").focus()
    for direction in ("ascending", "descending"):
        page.keyboard.press("Enter")
        expect(page.get_by_role("columnheader", name="Tier")).to_have_attribute("aria-sort", direction)
        expect(page.get_by_role("button", name="Tier")).to_be_focused()


def test_the_next_page_is_that_of_the_rows_that_are_seen(tab):
    """Also when it is pressed while the answer to another question is on its way."""
    page = tab.page
    # As if pages had two rows.
    page.route(
        re.compile(r"/v1/solutions\?limit=25"),
        lambda route: route.continue_(url=route.request.url.replace("limit=25", "limit=2")),
    )
    tab.open("solutions?order=period")
    settle(page)
    seen = {box.get_attribute("data-id") for box in page.locator("input.choose").all()}
    held = Held(page, re.compile(r"/v1/solutions\?.*order=-period"))
    page.get_by_role("button", name="Period").click()
    held.come()
    page.get_by_role("button", name="Next page").click()
    expect(page.get_by_role("link", name="First page")).to_be_visible()
    answer = tab.site.service.call("GET", "/v1/solutions?order=period&limit=4").document
    following = [item["id"] for item in answer["items"]][2:]
    assert [box.get_attribute("data-id") for box in page.locator("input.choose").all()] == following
    assert seen.isdisjoint(following)
    held.go()
    assert "order=period&after=" in page.url


@pytest.fixture
def drawn(tab) -> Page:
    page = tab.open(f"sweep?id={tab.site.sweep}")
    settle(page)
    expect(page.locator("#picture-note")).not_to_be_empty()
    return page


def test_a_picture_that_is_drawn_anew_leaves_the_finer_sweep_as_it_was_typed(drawn):
    count = drawn.locator("#finer-form [name=count0]")
    count.fill("345")
    drawn.get_by_label("log of values").check()
    expect(drawn.locator("#picture")).to_contain_text("log₁₀")
    expect(count).to_have_value("345")
    expect(count).to_be_visible()


def test_a_late_point_does_not_take_the_place_of_a_later_one(drawn):
    held = Held(drawn, re.compile(r"points\?where=index%3D3&"))
    number = drawn.get_by_label("number", exact=True)
    for place in ("3", "5"):
        number.fill(place)
        drawn.get_by_role("button", name="Show it").click()
    held.come()
    expect(drawn.locator("#point h3")).to_have_text("Point 5")
    with drawn.expect_response(re.compile(r"points\?where=index%3D3&")) as late:
        held.go()
    late.value.finished()
    drawn.get_by_label("log of values").check()  # what follows the late answer has been done by then
    expect(drawn.locator("#picture")).to_contain_text("log₁₀")
    expect(drawn.locator("#point h3")).to_have_text("Point 5")


def test_a_choice_survives_a_library_of_charts_that_comes_at_the_second_try(tab):
    broken = [True]
    tab.page.route(
        "**/plotly.min.js", lambda route: route.abort("aborted") if broken[0] else route.continue_()
    )
    page = tab.open("accuracy")
    expect(page.locator(".notice.bad")).to_contain_text("the charts could not be loaded")
    page.locator("select[name=kind]").select_option("any state")
    broken[0] = False
    expect(page.locator("#ways .scatterlayer .trace").first).to_be_attached()
    expect(page.locator("select[name=kind]")).to_have_value("any state")
    tab.faults[:] = [fault for fault in tab.faults if "charts could not be loaded" not in fault]
