"""The page of a sweep: its picture, a point that becomes a solution, a part that becomes a finer sweep."""

import json
import math
import re

import pytest
from playwright.sync_api import expect

from tests.support.browser import HOSTILE, SWEEP, settle

LAMBDA, B = "/motion/lambda", "/potential/parameters/b"


@pytest.fixture
def sweep(tab):
    """The page of the site's sweep, drawn, and the points of it as the API tells them."""
    page = tab.open(f"sweep?id={tab.site.sweep}")
    settle(page)
    expect(page.locator("#picture-note")).not_to_be_empty()
    points = tab.site.service.call("GET", f"/v1/sweeps/{tab.site.sweep}/points?limit=100").document["items"]
    return page, points


def test_unlike_hosts_are_told(tab):
    def answer(route):
        found = route.fetch().json()
        kinds = [{**found["provenances"][0], "hosts": hosts} for hosts in (["a", "b"], ["b", "c"])]
        route.fulfill(json={**found, "provenances": kinds})

    tab.page.route(f"**/v1/sweeps/{tab.site.sweep}", answer)
    page = tab.open(f"sweep?id={tab.site.sweep}")
    expect(page.locator("#computed")).to_contain_text("Computed on 3 hosts, of 2 kinds:")


def spot_of(page, x: float, y: float) -> dict[str, float]:
    """Return where two numbers are on the picture, in pixels of it."""
    ask = "([x, y]) => { const {xaxis, yaxis} = document.getElementById('picture')._fullLayout;"
    ask += " return {x: xaxis._offset + xaxis.d2p(x), y: yaxis._offset + yaxis.d2p(y)}; }"
    return page.evaluate(ask, [x, y])


def colours_at(page, places: list[tuple[float, float]]) -> list[list[int]]:
    """Return the colours at numbers of the axes; the canvas is read once."""
    ask = "(places) => { const {xaxis, yaxis} = document.getElementById('picture')._fullLayout;"
    ask += " const canvas = document.getElementById('cells'); const scale = canvas.width / xaxis._length;"
    ask += " const {data} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);"
    ask += " const at = (axis, value) => Math.floor(axis.d2p(value) * scale);"
    ask += " return places.map(([x, y]) => 4 * (at(yaxis, y) * canvas.width + at(xaxis, x)))"
    ask += ".map((k) => [...data.slice(k, k + 4)]); }"
    return page.evaluate(ask, places)


def test_a_heat_map_has_the_colour_of_each_number_and_a_mark_for_each_reason(sweep):
    page, points = sweep
    assert len(points) == 72
    solved = [point for point in points if point["outcome"] == "solved"]
    assert 0 < len(solved) < 72
    expect(page.locator("#progress")).to_contain_text("72 of 72")
    expect(page.locator("#refusals")).to_contain_text("no motion")
    expect(page.locator("#computed")).to_have_text("Computed on one host.")
    expect(page.locator("#picture-note")).to_have_text(
        f"{len(solved)} motions, {72 - len(solved)} points without one."
    )
    expect(page.locator("#marks li")).to_have_text([f" no motion: {72 - len(solved)}"])
    ends = sorted(solved, key=lambda point: point["period"])
    refused = next(point for point in points if point["outcome"] != "solved")
    places = [(point[LAMBDA], point[B]) for point in ends]
    around = [(refused[LAMBDA] + step / 500, refused[B]) for step in range(16)]
    colours = colours_at(page, places + around)
    shades, stripes = colours[: len(ends)], colours[len(ends) :]
    # The ends of the colours that the picture is drawn with, Viridis, in which green grows all along.
    assert (shades[0], shades[-1]) == ([0x44, 0x01, 0x54, 255], [0xFD, 0xE7, 0x25, 255])
    assert [green for _, green, _, _ in shades] == sorted(green for _, green, _, _ in shades)
    assert {colour[3] for colour in stripes} == {0, 255}  # stripes, and between them nothing
    page.get_by_label("log of values").check()
    expect(page.locator("#picture")).to_contain_text("log₁₀")


def test_a_click_on_a_point_computes_it_and_lands_on_its_solution(tab, sweep):
    page, points = sweep
    point = next(point for point in reversed(points) if point["outcome"] == "solved")
    page.locator("#picture").click(position=spot_of(page, point[LAMBDA], point[B]))
    expect(page.locator("#point h3")).to_have_text(f"Point {point['index']}")
    refused = next(point for point in points if point["outcome"] != "solved")
    page.get_by_label("number", exact=True).fill(str(refused["index"]))
    page.get_by_role("button", name="Show it").click()
    expect(page.locator("#point")).to_contain_text("no motion")
    page.get_by_role("button", name="see why").click()
    expect(page.locator("#point .notice, #point .fault")).to_contain_text("p² is negative")
    tab.faults[:] = [fault for fault in tab.faults if not fault.startswith("422 ")]
    page.locator("#picture").click(position=spot_of(page, point[LAMBDA], point[B]))
    page.get_by_role("button", name="Open as a solution").click()
    page.wait_for_url(re.compile(r"solution\?id="))
    identity = page.url.rpartition("=")[2]
    solution = tab.site.service.call("GET", f"/v1/solutions/{identity}").document
    # A point and its single job are the same problem, and have the same numbers to the last bit.
    assert solution["period"]["value"] == point["period"]
    settle(page)


def test_a_part_of_the_picture_becomes_a_finer_sweep_that_is_asked_for_first(tab, sweep):
    page, _ = sweep
    corners = [spot_of(page, 1.0, 0.04), spot_of(page, 1.5, 0.1)]
    page.locator("#picture").scroll_into_view_if_needed()
    box = page.locator("#picture").bounding_box()
    page.mouse.move(box["x"] + corners[0]["x"], box["y"] + corners[0]["y"])
    page.mouse.down()
    page.mouse.move(box["x"] + corners[1]["x"], box["y"] + corners[1]["y"], steps=4)
    page.mouse.up()
    expect(page.get_by_role("button", name="Show all again")).to_be_visible()
    fields = {name: page.locator(f"#finer-form [name={name}]") for name in ("from0", "to0", "from1", "to1")}
    wanted = {"from0": 1.0, "to0": 1.5, "from1": 0.04, "to1": 0.1}
    typed = {name: float(field.input_value()) for name, field in fields.items()}
    # A mouse is told in whole pixels: of 2 over 900 px, and of a decade over 350 px.
    assert all(math.isclose(typed[name], value, rel_tol=0.02) for name, value in wanted.items()), typed
    for name, count in (("count0", "4"), ("count1", "3")):
        page.locator(f"#finer-form [name={name}]").fill(count)
    page.get_by_role("button", name="Start a finer sweep").click()
    dialog = page.get_by_role("dialog", name="Start a sweep?")
    expect(dialog).to_contain_text("A new sweep of 12 points")
    before = tab.site.service.call("GET", "/v1/sweeps").document["total"]
    dialog.get_by_role("button", name="Cancel").click()
    expect(dialog).to_be_hidden()
    page.get_by_role("button", name="Start a finer sweep").click()
    with page.expect_request("**/v1/sweeps") as sent:
        dialog.get_by_role("button", name="Start it").click()
    assert len(sent.value.headers["idempotency-key"]) == 32
    page.wait_for_url(lambda address: "sweep?id=" in address and tab.site.sweep not in address)
    expect(page.locator("#progress")).to_contain_text("12 of 12")
    assert tab.site.service.call("GET", "/v1/sweeps").document["total"] == before + 1
    finer = tab.site.service.call("GET", f"/v1/sweeps/{page.url.rpartition('=')[2]}").document
    assert finer["document"]["axes"] == [
        {"pointer": LAMBDA, "linspace": [typed["from0"], typed["to0"], 4]},
        {"pointer": B, "logspace": [typed["from1"], typed["to1"], 3]},
    ]
    assert finer["note"] == f"a part of the sweep {tab.site.sweep}"
    expect(page.locator("#picture-note")).to_contain_text("12 motions, 0 points")


def test_lines_over_an_axis_have_a_mark_for_points_without_a_motion(sweep):
    page, points = sweep
    page.locator("select[name=y]").select_option("")
    expect(page.locator("#cells")).to_be_hidden()
    # A line for each value of the other axis, and one trace of marks.
    expect(page.locator("#picture .legendtext")).to_have_count(7)
    expect(page.locator("#picture .legendtext").last).to_have_text("no motion")
    page.locator("select[name=of]").select_option("energy")
    drawn = (
        "document.getElementById('picture').data.filter((one) => one.yaxis !== 'y2').flatMap((one) => one.y)"
    )
    solved = [point["energy"] for point in points if point["outcome"] == "solved"]
    page.wait_for_function(f"wanted => {drawn}.filter((y) => y !== null).includes(wanted)", arg=solved[0])
    assert sorted(y for y in page.evaluate(drawn) if y is not None) == sorted(solved)
    page.evaluate("document.getElementById('picture').emit('plotly_click', {points: [{customdata: 71}]})")
    expect(page.locator("#point h3")).to_have_text("Point 71")


def test_labels_and_notes_of_a_sweep_are_text(tab, sweep):
    page, _ = sweep
    path = f"/v1/sweeps/{tab.site.sweep}"
    tab.site.service.call("PATCH", path, {"labels": {"project": HOSTILE}, "note": HOSTILE})
    page.reload()
    expect(page.locator("#labels")).to_have_text(f"project: {HOSTILE}")
    expect(page.locator("#note")).to_have_text(HOSTILE)
    page.locator("#labels a").click()
    expect(page.locator("tbody tr")).to_have_count(1)
    assert page.locator("img").count() == 0
    tab.site.service.call("PATCH", path, {"labels": None, "note": None})


THREE = {
    **SWEEP,
    "axes": [*SWEEP["axes"], {"pointer": "/potential/parameters/a", "values": [-1, "-3/2", -2]}],
}


def test_of_three_axes_one_is_held_or_all_stand_beside_each_other(tab):
    identity = tab.site.service.call("POST", "/v1/sweeps", THREE).document["id"]
    page = tab.open(f"sweep?id={identity}")
    settle(page)
    expect(page.locator("#progress")).to_contain_text("216 of 216")
    expect(page.locator("h1")).to_have_text("a*g1 + b/g3^2")  # a and b vary
    expect(page.locator("#picture-note")).to_contain_text("motions")
    # The slice is that of the number beside the slider, and not of another one.
    slider = page.get_by_label("at a =")
    expect(page.locator("#held output")).to_have_text("-3/2")
    with page.expect_response(re.compile(r"/grid\?.*at=%2Fpotential%2Fparameters%2Fa%3D2$")) as asked:
        slider.press("ArrowRight")
        expect(page.locator("#held output")).to_have_text("-2")
        slider.blur()
    assert asked.value.ok
    # JSON is answered in pages of a hundred; the file has all.
    with page.expect_download() as download:
        page.get_by_role("button", name="JSON", exact=True).click()
    saved = json.loads(download.value.path().read_text(encoding="utf-8"))
    points = tab.site.service.call("GET", f"/v1/sweeps/{identity}/points?limit=1000").document["items"]
    assert saved == points
    assert len(saved) == 216
    page.locator("select[name=as]").select_option("parallel")
    expect(page.locator("#picture .xtick text")).to_have_text(["λ", "b", "a", "period"])
    lines = "document.getElementById('picture').data"
    lines += ".map(({customdata}) => new Set(customdata.filter((k) => k !== null)).size)"
    solved = [point for point in points if point["outcome"] == "solved"]
    counts = page.evaluate(lines)
    assert sum(counts) == len(solved)
    assert counts[0] == 0  # nothing is faint before a band is marked
    # The upper half of the axis of a: -1 and the middle, -3/2.
    spots = [spot_of(page, x, y) for x, y in ((1.8, 0.45), (2.2, 1.04))]
    page.locator("#picture").scroll_into_view_if_needed()
    box = page.locator("#picture").bounding_box()
    page.mouse.move(box["x"] + spots[0]["x"], box["y"] + spots[0]["y"])
    page.mouse.down()
    page.mouse.move(box["x"] + spots[1]["x"], box["y"] + spots[1]["y"], steps=4)
    page.mouse.up()
    inside = [point for point in solved if point["/potential/parameters/a"] >= -1.5]
    expect(page.locator("#under")).to_have_text(
        f"{len(inside)} of {len(solved)} points are in the marked bands."
    )
    assert page.evaluate(lines)[0] == len(solved) - len(inside)
    page.get_by_role("button", name="Show all again").click()
    expect(page.locator("#under")).to_be_empty()
