"""The page of a solution: the body turns whatever was stored, and one clock moves all of its pictures."""

import json
import re
from itertools import pairwise

import numpy as np
import pytest
from playwright.sync_api import expect

from service.schemas.replies.response_model import ENDS_IN_WORDS, STABILITY_IN_WORDS
from tests.support.browser import Watched, address, problem, settle
from tests.support.effort import seldom

CLASSICAL = {
    "body": {"A": 1},
    "potential": {"type": "gravity", "a": 1},
    "motion": {"type": "classical", "case": "elliptic_x_minus_k_over_x"},
    "time": {"periods": 1, "samples": 101},
}
"""Two moments follow from the case."""
ORIENTED = {**problem("state"), "outputs": ["gamma", "omega", "orientation"]}
PIXEL = 0.004
"""Radians, of a picture 26rem wide."""
NEAR = 2e-3
"""Difference of times: a tenth of a pixel of the narrowest panel, 500 for 10; browsers round to less."""
FRAMES = """async ([columns, module]) => {
    const {attitudesFrom} = await import(module);
    const arrays = Object.fromEntries(Object.entries(columns).map(([k, v]) => [k, Float64Array.from(v)]));
    return attitudesFrom(arrays);
}"""


WORDS = "async (module) => { const {ENDS, STABILITY} = await import(module); return [ENDS, STABILITY]; }"


def module_of(tab: Watched, name: str) -> str:
    script = tab.page.locator("head script[type=module]").get_attribute("src")
    return f"{tab.site.address}/{script.replace('solution.js', name)}"


def matrices(quaternions: np.ndarray) -> np.ndarray:
    """Return the rotations from the body into space, shape (n, 3, 3)."""
    w, x, y, z = np.asarray(quaternions).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def test_attitudes_from_the_angular_velocity_are_those_of_the_service(tab):
    """Up to the azimuth at the start, which is free; the error falls with the fourth power of the step."""
    solution, _ = tab.site.service.solve(ORIENTED)
    page = tab.open(f"solution?id={solution['id']}")
    settle(page)
    module = module_of(tab, "body.js")
    off = []
    for count in (200, 400, 800):
        path = f"/v1/solutions/{solution['id']}/trajectory?start=0&stop=20&samples={2 * count + 1}"
        columns = tab.site.service.call("GET", path).document["columns"]
        given = {name: columns[name] for name in ("t", "p", "q", "r", "g1", "g2", "g3")}
        found = page.evaluate(FRAMES, [given, module])
        ours = matrices(found["frames"])
        theirs = matrices(np.array([columns[f"q{k}"][::2] for k in range(4)]).T)
        # The last row is the vertical in the body, of both.
        gamma = np.array([columns[f"g{k}"][::2] for k in (1, 2, 3)]).T
        turn = ours @ np.swapaxes(theirs, 1, 2)
        off.append(np.max(np.abs(turn - turn[0])))
        # A row of a matrix is as long as √3 times its largest part; 1e-9 is above the claimed error.
        assert np.max(np.abs(ours[:, 2] - gamma)) <= 3**0.5 * off[-1] + 1e-9
        # What the page says of itself is more than its error.
        assert off[-1] < found["apart"] < PIXEL
    # A method of the fourth order: 16 each, as far as the steps are small.
    assert all(10 < before / after < 25 for before, after in pairwise(off)), off


@pytest.mark.parametrize("name", ["first", *seldom("classical", "unstable", "state")])
def test_every_body_turns(tab, name):
    stated = CLASSICAL if name == "classical" else problem(name)
    solution = tab.site.solutions.get(name) or tab.site.service.solve(stated)[0]["id"]
    methods = set()
    tab.page.on("request", lambda request: methods.add(request.method))
    tab.page.emulate_media(reduced_motion="no-preference")
    page = tab.open(f"solution?id={solution}")
    settle(page)
    faces = page.locator("#turning svg .face")
    expect(faces).to_have_count(3)
    before = faces.first.get_attribute("d")
    expect(faces.first).not_to_have_attribute("d", before)  # it turns by itself
    page.get_by_role("button", name="Pause").click()
    assert methods == {"GET"}  # whoever may only read sees it, too
    note = page.locator("#turning-note")
    is_free = name == "first"
    expect(note).to_contain_text(
        "The problem gives no B: the box has B = 2" if is_free else "of the body, B = "
    )
    is_gravity = stated["potential"]["type"] == "gravity"
    expect(page.locator("#turning svg .mark")).to_have_count(1 if is_gravity else 0)
    for label, kind in (("herpolhode", "second"), ("polhode", "fourth")):
        count = page.locator(f"#turning svg .{kind}").count()
        page.get_by_label(label, exact=True).check()
        expect(page.locator(f"#turning svg .{kind}")).to_have_count(count + 1)
    page.get_by_label("trail of").select_option("1")
    expect(page.locator("#turning svg .third")).to_have_count(1)


def test_a_body_with_its_proven_error_is_one_click_away(tab):
    page = tab.open(f"solution?id={tab.site.solutions['first']}")
    settle(page)
    expect(page.locator("#turning-note")).to_contain_text("nothing is claimed")
    page.get_by_role("button", name="With its proven error").click()
    page.wait_for_url(lambda url: tab.site.solutions["first"] not in url)
    settle(page)
    solution = tab.site.service.call("GET", f"/v1/solutions/{page.url.split('id=')[1]}").document
    assert "orientation" in solution["problem"]["outputs"]
    expect(page.locator("#turning-note")).to_contain_text("with a claimed error of at most")
    expect(page.get_by_role("button", name="With its proven error")).to_have_count(0)


def lines(tab: Watched, place: str) -> list[float]:
    """Return the times at which a chart shows the cursor."""
    return tab.page.evaluate(
        """(id) => {
            const {xaxis} = document.getElementById(id)._fullLayout;
            const own = document.getElementById(id).parentElement.querySelectorAll(".cursor .line");
            return [...own].map((line) => xaxis.p2d(parseFloat(line.style.left) - xaxis._offset));
        }""",
        place,
    )


def test_one_cursor_shows_all_values_at_a_time(tab):
    identity = tab.site.solutions["first"]
    page = tab.open(f"solution?id={identity}&with={tab.site.solutions['bobylev-steklov']}")
    settle(page)
    page.locator("#apart .scatterlayer .points path").first.wait_for()
    page.locator("#series").hover(position={"x": 500, "y": 150})
    values = page.locator("#clock .value")
    shown = re.search(r"^t = ([\d.]+): p = (\S+), q = (\S+), r = (\S+), γ₁ = ", values.inner_text())
    [time] = lines(tab, "series")
    for place in ("drift", "apart"):
        assert lines(tab, place) == pytest.approx([time], abs=NEAR)
    # One in each column of panels; those of the second are measured by the first axis.
    assert lines(tab, "overlay")[0] == pytest.approx(time, abs=NEAR)
    assert len(lines(tab, "overlay")) == 2
    # The values are those of the nearest sample, of 400 in 10.
    assert abs(float(shown[1]) - time) <= 10 / 399
    path = f"/v1/solutions/{identity}/trajectory?start={shown[1]}&stop={shown[1]}&samples=1"
    columns = tab.site.service.call("GET", path).document["columns"]
    for text, name in zip(shown.groups()[1:], ("p", "q", "r"), strict=True):
        # Seven digits of the values, six of the time; |dω/dt| is below 2 here.
        assert float(text.rstrip(",").replace("−", "-")) == pytest.approx(columns[name][0], abs=1e-5)
    # Marks on the sphere, of ω and in the phase plane go along: the start, and where it is now.
    expect(page.locator("#gamma circle.mark")).to_have_count(1)
    expect(page.locator("#omega circle.mark")).to_have_count(1)
    expect(page.locator(".figure:has(> #phase) .cursor .dot")).to_have_count(1)


def test_one_error_has_one_name_and_says_what_it_is_of(tab):
    page = tab.open(address("/solution", tab.site))
    settle(page)
    facts = page.locator("#facts")
    expect(facts).to_contain_text("Claimed error, stored samples")
    expect(page.locator("#series-note")).to_contain_text("their claimed error is at most")
    expect(facts).to_contain_text("Against leaving its plane")
    expect(facts).to_contain_text("linearly unstable")
    tolerance = tab.site.service.call("GET", "/v1/accuracy").document["tolerances"]["standard"]
    exponent = (
        f"{tolerance:.0e}".split("e-")[1].lstrip("0").translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))
    )
    expect(facts).to_contain_text(f"Double precision keeps 1 × 10⁻{exponent} until")
    expect(facts).to_contain_text("passes a pole, crosses the equator")
    expect(page.locator("#multipliers svg text")).to_contain_text(["1", "−1", "i", "−i"])
    # The words are those of the API and of the command line.
    words = page.evaluate(WORDS, module_of(tab, "core.js"))
    assert words == [dict(ENDS_IN_WORDS), dict(STABILITY_IN_WORDS)]
    titles = json.loads(page.evaluate("JSON.stringify(document.getElementById('series').layout.annotations)"))
    assert [(title["text"], title.get("textangle", 0)) for title in titles] == [("ω", 0), ("γ", 0)]
