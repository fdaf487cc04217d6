"""Formulas as LaTeX and MathML: on request, beside the verdict, and never in its way."""

import json
from functools import cache

import pytest

from service.api.verdicts import examiner as asking
from service.schemas.replies.response_model import QUADRANTS_OUT
from service.verdicts.examination import examine_question
from service.verdicts.formulas import examine_question_with_formulas, simplify_formula, with_simplified
from tests.support.mathml import checked
from tests.support.verdicts import die, never_answer

pytestmark = pytest.mark.any_database

PLANAR = {"type": "planar", "nu": 1}


def question(text, A=2, C=1, motion=None, **parameters):
    potential = {"type": "expression", "expression": text, "parameters": parameters}
    return {
        "body": {"A": A, "C": C},
        "potential": potential,
        **({} if motion is None else {"motion": motion}),
    }


ELLIPTIC = question("a*g1 + b/g3^2", motion=PLANAR, a=-1, b="1/20")
INADMISSIBLE = question("a*g1 + b*g2", a=1, b=1)
QUESTIONS = {
    "elliptic": ELLIPTIC,
    "inadmissible": INADMISSIBLE,
    "lambda": question("k*abs(g1)^(4/3)", A=3, k=-2),
    "odd in g2": question("-g1 + (2*g1^2 + g3^2)*g2^3"),
    "undecided": question("g1 + exp(-1000)*abs(g2 - 99999/100000)*0 + log(1 + 1e-300*g2)"),
    "negative": question("a*g1", motion={"type": "planar", "nu": "-1/2"}, a=1),
    "general": {
        "body": {"A": "17/10", "C": 1},
        "potential": {"type": "general", "F": "a*w", "G": "g2^3", "parameters": {"a": 2}},
    },
}


examined = cache(examine_question_with_formulas)


def rows_of(document, *, is_simplified=True):
    asked = json.dumps({"document": document, "formats": ("latex", "mathml")})
    verdict = json.loads(examined(asked))["verdict"]
    answers = [simplify_formula(work) for work in verdict["works"]] if is_simplified else []
    return with_simplified(verdict, answers)


def found(rows, name, *, named=False, **where):
    """Return the one row of this name."""
    (row,) = [
        row
        for row in rows["formulas"]
        if (row["name"], row["named"]) == (name, named) and all(row[k] == v for k, v in where.items())
    ]
    return row


@pytest.mark.parametrize("document", QUESTIONS.values(), ids=QUESTIONS)
def test_the_verdict_itself_is_the_one_without_formulas(document):
    plain = json.loads(examine_question(json.dumps(document)))["verdict"]
    assert plain["formulas"] is None
    assert {**rows_of(document, is_simplified=False), "formulas": None} == plain


@pytest.mark.parametrize("document", QUESTIONS.values(), ids=QUESTIONS)
def test_every_formula_says_where_it_is_from_and_is_well_formed(document):
    verdict = rows_of(document, is_simplified=False)
    assert verdict["formulas"]
    pointed = set()
    for row in verdict["formulas"]:
        assert not row["simplified"]
        checked(row["formats"]["mathml"])
        assert row["formats"]["latex"]
        assert set(row["quadrants"]) <= set(QUADRANTS_OUT)
        assert row["quadrants"]
        for pointer in row["at"]:
            field = verdict
            for name in pointer.split("/")[1:]:
                field = field[name]
            # As it stands: the text behind the equals sign is the field.
            assert row["formats"]["text"].partition(" = ")[2] == field
            pointed.add(pointer)
    assert pointed == texts(verdict)


def texts(verdict):
    """The pointers of all fields with a formula."""
    pointers = {f"/energy/{name}" for name in ("h", "h_named") if (verdict["energy"] or {}).get(name)}
    parts = verdict["decomposition"] or {}
    pointers |= {f"/decomposition/{n}" for n in ("F", "F_named", "G", "G_named") if parts.get(n)}
    pointers |= {
        f"/nearest/{n}" for n in ("expression", "expression_named") if (verdict["nearest"] or {}).get(n)
    }
    for quadrant in QUADRANTS_OUT:
        for name in ("formula", "named"):
            if (((verdict["energy"] or {}).get("quadrants") or {}).get(quadrant) or {}).get(name):
                pointers.add(f"/energy/quadrants/{quadrant}/{name}")
            for function in ("F", "G"):
                part = (parts.get("quadrants") or {}).get(quadrant) or {}
                if (part.get(function) or {}).get(name):
                    pointers.add(f"/decomposition/quadrants/{quadrant}/{function}/{name}")
    return pointers


def test_the_formulas_are_those_of_the_theory():
    rows = rows_of(ELLIPTIC)
    assert found(rows, "V", named=True)["formats"]["latex"] == r"V = a \gamma_{1} + \frac{b}{\gamma_{3}^{2}}"
    h = found(rows, "h", named=True)
    assert h["formats"]["text"] == "h(nu) = -a*nu/2 - 2*b/nu^2"
    assert h["formats"]["latex"] == r"h \left(\nu\right) = -\frac{a \nu}{2} - \frac{2 b}{\nu^{2}}"
    assert h["simplified"]
    # Theory 3.3: x'² = 2 (1 − x² − ν x) N/(C ν²) with N = −a1 ν² x − 2 b1, and p² = N/(2 C ν x).
    speed = found(rows, "speed_squared", named=True)
    assert speed["formats"]["text"] == "(dg1/dt)^2 = 2*(a*g1*nu^2 + 2*b)*(g1^2 + g1*nu - 1)/nu^2"
    assert found(rows, "p_squared", named=True)["formats"]["text"] == "p^2 = -a*nu/2 - b/(g1*nu)"
    assert (
        r"\pm \int \frac{\mathrm{d} \gamma_{1}}{\sqrt{" in found(rows, "time", named=True)["formats"]["latex"]
    )
    assert found(rows, "x1")["formats"]["text"] == "x1 = 1/10"
    assert found(rows, "period")["window"] == 0


def test_a_potential_that_is_odd_in_g2_has_a_speed_in_each_hemisphere():
    rows = rows_of(QUESTIONS["odd in g2"])
    north, south = (found(rows, "p_squared", g2_sign=sign) for sign in (1, -1))
    assert north["formats"]["text"] != south["formats"]["text"]


def test_nothing_changes_without_the_option(client):
    plain = client.post("/v1/validations", json=ELLIPTIC).json()
    assert plain["formulas"] is None
    asked = client.post("/v1/validations?formulas=latex", json=ELLIPTIC).json()
    assert {**asked, "formulas": None} == plain
    assert all(row["formats"]["mathml"] is None for row in asked["formulas"])
    assert all(row["formats"]["latex"] for row in asked["formulas"])


def test_a_whole_problem_and_a_state_may_ask_too(client):
    whole = {**ELLIPTIC, "time": {"stop": 1, "samples": 2}}
    answer = client.post("/v1/validations?formulas=text,mathml", json=whole).json()
    assert answer["plan"] is not None
    assert answer["formulas"]
    state = {
        **question("g1"),
        "body": {"A": 2, "B": 2, "C": 1},
        "motion": {"type": "state", "omega": [1, 0, 0], "gamma": [1, 0, 0]},
        "time": {"stop": 1, "samples": 2},
    }
    assert client.post("/v1/validations?formulas=latex", json=state).json()["formulas"] is None


@pytest.mark.parametrize("simplifier", [never_answer, die])
def test_a_sympy_that_never_ends_or_dies_leaves_the_formulas_as_they_stand(client, monkeypatch, simplifier):
    monkeypatch.setattr(asking, "simplify_formula", simplifier)
    monkeypatch.setattr(client.app.state.resources.settings, "formula_seconds", 0.3)
    answer = client.post("/v1/validations?formulas=latex,mathml", json=ELLIPTIC)
    assert answer.status_code == 200
    rows = answer.json()["formulas"]
    assert not any(row["simplified"] for row in rows)
    expected = [
        {**row, "window": row["window"]} for row in rows_of(ELLIPTIC, is_simplified=False)["formulas"]
    ]
    assert rows == expected


def test_errors_are_those_without_formulas(client):
    for document in ({"body": {"A": 1}}, question("sqrt(-1 - g1^2)")):
        plain, asked = (client.post(f"/v1/validations{q}", json=document) for q in ("", "?formulas=latex"))
        assert asked.status_code == plain.status_code == 422
        assert asked.json()["errors"] == plain.json()["errors"]


@pytest.mark.parametrize("value", ["tex", "", "latex,", "latex,html", "LaTeX", "latex mathml"])
def test_other_formats_are_refused(client, value):
    answer = client.post("/v1/validations", params={"formulas": value}, json=ELLIPTIC)
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["pointer"] == "?formulas"
    assert "latex" in answer.json()["errors"][0]["message"]


def test_hostile_names_come_out_harmless():
    names = ["input", "script", "_", "a_1", "a1", "V", "gamma1", "x" * 60]
    document = question(" + ".join(f"{name}*g1" for name in names), **dict.fromkeys(names, 1))
    row = found(rows_of(document), "V", named=True)
    checked(row["formats"]["mathml"])
    assert r"\mathrm{script}" in row["formats"]["latex"]
    assert r"\input" not in row["formats"]["latex"]
