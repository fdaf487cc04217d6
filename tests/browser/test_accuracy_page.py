"""The page of accuracy: the table of the installation as a picture, and what samples cost."""

from playwright.sync_api import expect

from tests.support.browser import settle
from tests.support.waiting import wait_until


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
    drawn = "document.getElementById('picture').data.flatMap(({x}) => x)"
    # As the service estimates it: the first thousand, and each further one.
    wanted = [row["seconds"] + 99 * row["seconds_per_1000"] for row in rows]
    assert wait_until(lambda: sorted(page.evaluate(drawn)) == sorted(wanted))
    assert page.evaluate("document.getElementById('picture').layout.shapes.map(({y0}) => y0)") == list(
        table["tolerances"].values()
    )


def test_other_methods_and_the_outputs_are_shown_with_where_they_were_measured(tab):
    page = tab.open("accuracy")
    settle(page)
    comparison = tab.site.service.call("GET", "/v1/accuracy").document["comparison"]
    ways, outputs = comparison["ways"], comparison["outputs"]
    expect(page.locator("#compared-where")).to_contain_text(comparison["date"][:10])
    expect(page.locator("#compared-where")).to_contain_text("busy" if comparison["load"] > 1.5 else "load")
    drawn = page.evaluate(
        "document.getElementById('ways').data.map(({name, x, y, text, line, marker}) =>"
        " ({name, points: x.map((_, k) => [text[k], x[k], y[k]]), look: [line.dash, marker.symbol]}))"
    )
    assert [trace["name"] for trace in drawn] == list(dict.fromkeys(way["way"] for way in ways))
    assert {"DOP853", "heyoka"} <= {trace["name"] for trace in drawn}
    for trace in drawn:
        mine = [way for way in ways if way["way"] == trace["name"]]
        assert trace["points"] == [[way["setting"], way["seconds"], way["error"]] for way in mine]
    # Told apart without colours.
    assert len({tuple(trace["look"]) for trace in drawn}) == len(drawn)
    expect(page.locator("#ways-table tbody tr")).to_have_count(len(ways))
    rows = page.locator("#outputs tbody tr")
    expect(rows).to_have_count(len(outputs))
    for k, row in enumerate(outputs):
        expect(rows.nth(k)).to_contain_text(f"{row['problem']}{row['output']}")
