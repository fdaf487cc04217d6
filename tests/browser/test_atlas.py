"""The atlas of the workbench: ends, collisions and changes are told by marks, by lines and in words."""

import json
from urllib.parse import quote

from playwright.sync_api import expect

from tests.support.browser import problem, settle
from tests.support.waiting import wait_until

SPLITTING = {
    **problem("first"),
    "body": {"A": 2, "C": 1},
    "potential": {"type": "rational", "a": [1], "b": ["-1/16"], "c": [-1]},
    "motion": {"type": "planar", "lambda": "1/2"},
}
"""Its motions collide at the pole; at λ = 1 a window splits, and a part of it vanishes in an equilibrium."""
SYMBOLS = {"rest": "circle", "equator": "triangle-up", "pole": "x"}
NAMES = {"rest": "turns at rest", "equator": "crosses the equator", "pole": "passes a pole"}


def test_ends_collisions_and_changes_are_told_without_colours(tab):
    question = {name: SPLITTING[name] for name in ("body", "potential")}
    atlas = tab.site.service.call(
        "POST", "/v1/atlases", {**question, "lambda": ["0.1", "3"], "outputs": []}
    ).document
    windows = [one for part in atlas["parts"] for one in part["samples"]["windows"]]
    page = tab.open("workbench#" + quote(json.dumps(SPLITTING)))
    settle(page)
    page.locator("#atlas .legendtext").first.wait_for()
    drawn = page.evaluate(
        "document.getElementById('atlas').data.map(({end, x, y, fill, fillpattern, marker}) =>"
        " ({end, x, y, fill, hatched: fillpattern?.shape, symbol: marker?.symbol}))"
    )
    # Each end of each window is marked, and on the line where it is.
    marks = [trace for trace in drawn if trace["end"]]
    assert sorted(mark["end"] for mark in marks) == sorted(end for one in windows for end in one["ends"])
    ends = [values for one in windows for values in one["g1"]]
    for mark in marks:
        assert mark["symbol"] == SYMBOLS[mark["end"]]
        assert len(mark["x"]) == len(mark["y"]) >= 1
        assert any(set(mark["y"]) <= set(values) for values in ends)
    bands = [trace["hatched"] for trace in drawn if trace["fill"]]
    kinds = [one["kind"] for one in windows]
    assert {"collision", "periodic"} == set(kinds)
    assert [shape is not None for shape in bands] == [kind == "collision" for kind in kinds]
    # The legend names what is drawn and nothing else; lines of different kinds have different dashes.
    found = {end for one in windows for end in one["ends"]}
    named = {*(NAMES[end] for end in found), "collision: reaches a singularity", "separatrix", "equilibrium"}
    assert set(page.locator("#atlas .legendtext").all_text_contents()) == named
    lines = page.evaluate(
        "document.getElementById('atlas').layout.shapes.map(({x0, line}) => [x0, line.dash])"
    )
    changes = [change["lambda"]["value"] for change in atlas["changes"]]
    dashes = {dash for x, dash in lines if x in changes}
    assert len(dashes) == len(changes) == 2
    expect(page.locator("#atlas .annotation-text")).to_have_text(["separatrix", "equilibrium", "γ₁"])
    # The same in words, in the order of λ.
    told = page.locator("#changes li")
    expect(told).to_have_count(len(atlas["parts"]) + len(changes))
    expect(told.nth(0)).to_contain_text("passes a pole, crosses the equator, collision")
    expect(told.nth(1)).to_contain_text("separatrix, a window splits")
    expect(told.nth(3)).to_contain_text("equilibrium, a window vanishes")


def test_a_click_on_the_legend_picks_no_motion(tab):
    page = tab.open("workbench#" + quote(json.dumps(SPLITTING)))
    settle(page)
    field = page.get_by_label("λ", exact=True)
    picked = page.evaluate_handle(
        "() => { const said = []; new MutationObserver(() =>"
        " said.push(document.getElementById('said').textContent)).observe(document.getElementById('said'),"
        " {childList: true}); return said; }"
    )
    page.locator("#atlas .legendtext").first.click(force=True)
    expect(field).to_have_value("1/2")
    plot = page.locator("#atlas .nsewdrag").first
    box = plot.bounding_box()
    plot.click(position={"x": 0.5 * box["width"], "y": 0.5 * box["height"]})
    expect(field).not_to_have_value("1/2")
    # Of the two clicks one picked something.
    wait_until(lambda: len(picked.json_value()) == 1)


def test_an_end_where_p_squared_is_infinite_has_a_mark_and_a_name(tab):
    """V = −(2 g1² + g3²)/g2²: p² is infinite on the equator, which a motion from either pole runs into."""
    document = {
        **SPLITTING,
        "potential": {"type": "expression", "expression": "-(2*g1^2+g3^2)/g2^2"},
        # There is no other place where it would start by itself.
        "motion": {"type": "planar", "lambda": "1/2", "start": {"g1": "1/4"}},
    }
    page = tab.open("workbench#" + quote(json.dumps(document)))
    settle(page)
    page.locator("#atlas .legendtext").first.wait_for()
    marks = page.evaluate(
        "document.getElementById('atlas').data.filter(({end}) => end).map(({end, marker}) =>"
        " [end, marker.symbol])"
    )
    assert sorted(marks) == [["collision", "star"], ["pole", "x"]]
    assert "runs into a collision" in page.locator("#atlas .legendtext").all_text_contents()
    expect(page.locator("#changes li").first).to_contain_text(
        "passes a pole, runs into a collision, collision"
    )
