"""The workbench teaches: a slip is answered with what was meant, and nothing stale looks like an answer."""

import json
import re
import types
from urllib.parse import quote

import pytest
from playwright.sync_api import expect

import polhode
from tests.browser.test_late_answers import Held
from tests.support.browser import EXAMPLES, problem, settle

REFUTED = {**problem("first"), "potential": {"type": "expression", "expression": "g1 + g2/10"}}
PARTS = ["formulas", "sphere", "plan", "tiers", "atlas-section"]
PROGRAM = """async ([problem, module]) => {
    const {asPython} = await import(module);
    return asPython(problem, "http://127.0.0.1:8000/");
}"""
AWKWARD = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {
        "type": "expression",
        "expression": "lam*g1 + body*g3",
        "parameters": {"lam": 1, "body": "-1/3"},
    },
    "motion": {"type": "planar", "lambda": "1/2", "g1_sign": -1, "window": 0},
    "time": {"times": [0, "1/3", 1e-3]},
    "accuracy": {"relative": 1e-9},
    "outputs": ["gamma", "omega", "stability"],
}
"""Parameters that have the names of arguments, and sections that no argument stands for."""


def state_in(stated: object) -> str:
    return "workbench#" + quote(json.dumps(stated))


def refusals_of_half_filled_forms(tab) -> None:
    tab.faults[:] = [fault for fault in tab.faults if not fault.startswith("422 ")]


def test_a_slip_in_the_formula_is_mended_step_by_step(tab):
    stated = {**problem("first"), "potential": {"type": "expression", "expression": "-2γ₁ + k/g3²"}}
    page = tab.open(state_in(stated))
    formula, verdict = page.get_by_label("V, a formula"), page.locator("#verdict")
    expect(verdict).to_contain_text("The verdict waits for the potential.")
    expect(verdict).to_contain_text("did you mean '-2*g1 + k/g3^2'?")
    page.get_by_role("button", name="Use it").click()
    expect(formula).to_have_value("-2*g1 + k/g3^2")
    expect(verdict).to_contain_text("add k = … to the parameters")
    page.get_by_label("Parameters").fill("k = 1/20")
    expect(verdict).to_contain_text("Admissible")
    expect(formula).not_to_have_attribute("aria-invalid", "true")
    refusals_of_half_filled_forms(tab)


def test_the_nearest_admissible_potential_is_one_click_away(tab):
    page = tab.open(state_in(REFUTED))
    verdict = page.locator("#verdict")
    expect(verdict).to_contain_text("The nearest admissible polynomial")
    answer = tab.site.service.call("POST", "/v1/validations", {k: REFUTED[k] for k in ("body", "potential")})
    nearest = answer.document["nearest"]
    above, below = map(int, nearest["relative_squared_distance"].split("/"))
    [shown] = re.findall(r"differs from the potential by ([\d.]+) %", verdict.inner_text())
    assert float(shown) == pytest.approx(100 * (above / below) ** 0.5, rel=0.05)  # two digits are shown
    page.get_by_role("button", name="Use this").click()
    expect(page.get_by_label("V, a formula")).to_have_value(
        nearest["expression_named"] or nearest["expression"]
    )
    expect(verdict).to_contain_text("Admissible —")
    refusals_of_half_filled_forms(tab)


def test_the_bodies_for_which_a_potential_would_be_admissible_are_one_click_away(tab):
    """V = g1 (4 g1² + 3 g3²): the polynomial of A = 4C, and of no other body."""
    stated = {**problem("first"), "potential": {"type": "expression", "expression": "g1*(4*g1^2 + 3*g3^2)"}}
    stated["body"] = {"A": 2, "C": 3}
    page = tab.open(state_in(stated))
    verdict = page.locator("#verdict")
    expect(verdict).to_contain_text("For A/C = 4 it would be admissible, for no other ratio of the moments.")
    page.get_by_role("button", name="Use A/C = 4").click()
    expect(page.get_by_label("A", exact=True)).to_have_value("12")
    expect(verdict).to_contain_text("Admissible —")
    page.get_by_label("V, a formula").fill("g1^3 + g2^2*g1 + g3")
    expect(verdict).to_contain_text("There is no ratio A/C for which it would be admissible.")
    refusals_of_half_filled_forms(tab)


def test_what_is_of_the_last_problem_is_grey(tab):
    page = tab.open(state_in(problem("first")))
    settle(page)
    held = Held(page, re.compile(r"/v1/validations\?formulas"))
    page.get_by_label("λ", exact=True).fill("3/2")
    held.come()
    for part in PARTS:
        place = page.locator(f"#{part}")
        expect(place).to_have_attribute("aria-busy", "true")
        expect(place).to_have_css("opacity", "0.45")
    expect(page.locator("#verdict")).to_have_attribute("aria-busy", "false")  # it does not depend on λ
    held.go()
    settle(page)
    for part in PARTS:
        expect(page.locator(f"#{part}")).to_have_css("opacity", "1")


def stated_by(program: str) -> dict:
    """Run a program that solves a problem; return the problem, which is not solved."""
    found: list[dict] = []
    motion = types.SimpleNamespace(period=None, energy=None, error=None)
    client = types.SimpleNamespace(solve=lambda **given: found.append(polhode.problem(**given)) or motion)
    module = types.SimpleNamespace(connect=lambda _: client)
    first, _, rest = program.partition("\n")
    assert first == "import polhode as ph"
    exec(rest, {"ph": module})
    [document] = found
    return document


def test_what_is_copied_as_python_is_what_a_person_writes_and_states_the_same(tab):
    page = tab.open("workbench")
    script = page.locator("head script[type=module]").get_attribute("src")
    module = f"{tab.site.address}/{script.replace('workbench.js', 'fields.js')}"
    stated = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(EXAMPLES.glob("*.json"))]
    for document in [*(one for one in stated if "motion" in one), AWKWARD]:
        program = page.evaluate(PROGRAM, [document, module])
        assert "json" not in program
        given = stated_by(program)
        # The page leaves out the outputs that a service computes anyhow, the client no empty parameters.
        given.setdefault("outputs", ["gamma", "omega"])
        if not given["potential"].get("parameters"):
            given["potential"].pop("parameters", None)
        assert given.items() >= document.items(), program
    settle(page)
