"""A motion without a period that oscillates too fast for lines: its values are dots, and the page says so."""

import re

from playwright.sync_api import expect

from tests.support.browser import settle


def test_what_has_no_period_and_turns_too_often_is_shown_as_dots(tab):
    """As if its lines were far from the curve, which the service tells with the values."""
    identity = tab.site.solutions["state"]
    assert tab.site.service.call("GET", f"/v1/solutions/{identity}").document["period"] is None
    deviation = ["0.4"]
    asked = []

    def far_off(route):
        asked.append(route.request.url)
        answer = route.fetch()
        route.fulfill(response=answer, headers={**answer.headers, "polhode-deviation": deviation[0]})

    tab.page.route(re.compile(r"/trajectory\?.*preview="), far_off)
    page = tab.open(f"solution?id={identity}")
    settle(page)
    note = page.locator("#series-note")
    expect(note).to_contain_text("values; the motion oscillates too fast between them to be drawn as lines")
    modes = "[...new Set(document.getElementById('series').data.map(({mode}) => mode))]"
    assert page.evaluate(modes) == ["markers"]
    # More points were asked for before that was given up, the most in the end.
    points = [int(re.search(r"preview=(\d+)", url)[1]) for url in asked]
    assert points[0] < points[-1] == 6000
    count = page.evaluate("document.getElementById('series').data[0].x.length")
    expect(note).to_contain_text(f" {count} values;")
    # Where lines are near the curve, they are drawn.
    deviation[0] = "0.001"
    page.get_by_label("from").fill("0")
    page.get_by_label("to", exact=True).fill("0.5")
    page.get_by_role("button", name="Show").click()
    expect(note).to_contain_text("the lines between them are off by at most")
    assert page.evaluate(modes) == ["lines"]
