"""The page of accuracy: the table of the installation as a picture, and what samples cost."""

from playwright.sync_api import expect

from tests.support.browser import settle


def test_the_picture_and_the_costs_are_those_of_the_rows_that_are_chosen(tab):
    page = tab.open("accuracy")
    settle(page)
    table = tab.site.service.call("GET", "/v1/accuracy").document
    expect(page.locator("#table tbody tr")).to_have_count(len(table["rows"]))
    page.get_by_role("spinbutton", name="samples").fill("100000")
    page.locator("select[name=kind]").select_option("any state")
    rows = [row for row in table["rows"] if row["kind"] == "any state"]
    expect(page.locator("#table tbody tr")).to_have_count(len(rows))
    expect(page.locator("#costs thead")).to_contain_text("Seconds for 100,000 samples")
    expect(page.locator("#costs tbody tr")).to_have_count(len({row["tier"] for row in rows}))
    drawn = page.evaluate("document.getElementById('picture').data.flatMap(({x}) => x)")
    # As the service estimates it: the first thousand, and each further one.
    wanted = [row["seconds"] + 99 * row["seconds_per_1000"] for row in rows]
    assert sorted(drawn) == sorted(wanted)
    assert page.evaluate("document.getElementById('picture').layout.shapes.map(({y0}) => y0)") == list(
        table["tolerances"].values()
    )
