"""The page of accuracy: the table of the installation as a picture, and what samples cost."""

import json
from itertools import pairwise
from urllib.parse import quote

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
    drawn = "document.getElementById('picture').data.flatMap(({x}) => x).filter((x) => x !== null)"
    # The legend names each kind of motion that is shown, by its mark.
    names = "document.getElementById('picture').data.map(({name}) => name)"
    wait_until(lambda: set(page.evaluate(names)) == {*table["tolerances"], "any state"})
    # As the service estimates it: the first thousand, and each further one.
    wanted = [row["seconds"] + 99 * row["seconds_per_1000"] for row in rows]
    wait_until(lambda: sorted(page.evaluate(drawn)) == sorted(wanted))
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


def test_the_page_tells_where_a_tier_saves_time_and_where_it_does_not(tab):
    page = tab.open("accuracy")
    settle(page)
    rows = tab.site.service.call("GET", "/v1/accuracy").document["rows"]
    for tier, better in (("draft", "standard"), ("standard", "high"), ("high", "certified")):
        of = {name: {} for name in (tier, better)}
        for row in rows:
            if row["tier"] in of:
                of[row["tier"]].setdefault((row["kind"], row["family"]), []).append(row["seconds"])
        pairs = [
            pair
            for key, mine in of[tier].items()
            for pair in zip(mine, of[better].get(key, []), strict=False)
        ]
        faster = sum(one < 0.8 * other for one, other in pairs)
        words = f"{tier} is clearly faster than {better} on {faster} of {len(pairs)} problems"
        expect(page.locator("#savings")).to_contain_text(words)


def test_the_workbench_tells_of_each_tier_what_it_costs_on_this_problem(tab):
    document = {
        "body": {"A": 2, "C": 1}, "potential": {"type": "gravity", "a": -1},
        "motion": {"type": "planar", "lambda": 1}, "time": {"periods": 1, "samples": 201},
    }  # fmt: skip
    page = tab.open("workbench#" + quote(json.dumps(document)))
    settle(page)
    plan = tab.site.service.call("POST", "/v1/validations", document).document["plan"]
    for each, better in pairwise([*plan["tiers"], None]):
        shown = page.locator(f"#tiers [data-tier={each['tier']}]")
        expect(shown).to_contain_text(f"{1000 * each['expected_seconds']:.2g}"[:3])
        saves = better is None or each["expected_seconds"] < 0.8 * better["expected_seconds"]
        assert ("no faster than" in shown.inner_text()) != saves
    state = {"type": "state", "omega": ["2/5", 0, "9/10"], "gamma": ["3/5", 0, "4/5"]}
    document |= {"body": {"A": 2, "B": "3/2", "C": 1}, "motion": state, "time": {"stop": 10, "samples": 11}}
    page = tab.open("workbench#" + quote(json.dumps(document)))
    page.reload()
    settle(page)
    # Motions from states are proven by steps.
    expect(page.locator("#tiers [data-tier=certified]")).to_contain_text("reaches")
