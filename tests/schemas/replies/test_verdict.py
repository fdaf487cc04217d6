"""What a verdict says has one shape, whatever the potential is."""

import json

import pytest

from service.schemas.replies.verdict import VerdictOut
from service.verdicts.examination import examine_question

QUADRANTS = {"pp", "mp", "pm", "mm"}


def kinds(schema):
    """The JSON types that a value may have, beside null."""
    if "anyOf" in schema:
        return set().union(*(kinds(each) for each in schema["anyOf"])) - {"null"}
    return {"object"} if "$ref" in schema else {schema["type"]}


def test_no_field_of_a_verdict_is_sometimes_text_and_sometimes_an_object():
    document = VerdictOut.model_json_schema(mode="serialization")
    for name, schema in {"VerdictOut": document, **document["$defs"]}.items():
        for field, of_field in schema.get("properties", {}).items():
            assert len(kinds(of_field)) == 1, (name, field)
            assert len([each for each in of_field.get("anyOf", []) if each.get("type") != "null"]) <= 1


def verdict(potential, body):
    text = examine_question(json.dumps({"body": body, "potential": potential}))
    found = json.loads(text)["verdict"]
    VerdictOut.model_validate(found)
    return found


def test_a_verdict_says_which_known_case_its_problem_is():
    found = verdict({"type": "gravity", "a": -1}, {"A": 2, "B": "3/2", "C": 1})
    assert [each["name"] for each in found["known_cases"]] == ["bobylev_steklov"]
    assert found["ratios"] is None


def expression(text):
    return {"type": "expression", "expression": text}


THREE = {"A": 3, "C": 1}
DOUBLE = {"A": 2, "C": 1}
GENERAL = {"type": "general", "G": "0", **{f"F_{q}": f"{k}*w" for k, q in enumerate(sorted(QUADRANTS))}}


@pytest.mark.parametrize(
    ("potential", "ratios"),
    [
        ({"type": "gravity", "a": -1}, {"all": False, "ratios": ["2"], "others": []}),
        (expression("(A*g1^2 + 2*C*g3^2)*g2"), {"all": False, "ratios": [], "others": []}),
        (expression("(2*g1^2 + A*g3^2)*g2"), {"all": False, "ratios": [], "others": ["A^2 - 2"]}),
        (expression("sqrt(2 + g1)"), None),
    ],
)
def test_a_verdict_says_for_which_moments_a_polynomial_would_be_admissible(potential, ratios):
    assert verdict(potential, THREE)["ratios"] == ratios


@pytest.mark.parametrize(
    ("potential", "body", "has_one_F", "there"),
    [
        (expression("g1^2*(3*g1^2 + g3^2)^0 - 1/3*g1^(4/3) - g1^2"), THREE, True, {"pp", "pm"}),
        ({"type": "gravity", "a": -1}, DOUBLE, False, QUADRANTS),
        (GENERAL, DOUBLE, False, QUADRANTS),
        (expression("(3*g1^2 + g3^2)*g2"), THREE, True, QUADRANTS),
    ],
)
def test_every_quadrant_is_always_told_and_what_all_share_beside_them(potential, body, has_one_F, there):
    found = verdict(potential, body)
    parts, energy = found["decomposition"], found["energy"]
    assert set(parts["quadrants"]) == set(energy["quadrants"]) == QUADRANTS
    assert {q for q, part in parts["quadrants"].items() if part is not None} == there
    assert {q for q, h in energy["quadrants"].items() if h is not None} == there
    formulas = {parts["quadrants"][q]["F"]["formula"] for q in there}
    assert (parts["F"] is not None) == has_one_F == (len(formulas) == 1)
    assert not has_one_F or formulas == {parts["F"]}
    assert energy["variable"] == ("nu" if body["A"] == 2 else "lambda")


def test_what_has_no_formula_has_points_in_the_same_place():
    # It is g1, 1 higher on the curves with nu < 0 or nu > 1/2 and 1 lower on the others.
    found = verdict(expression("g1 + abs(g3^2 - g1/2)/(g3^2 - g1/2)"), DOUBLE)
    assert (found["energy"]["h"], found["decomposition"]["F"]) == (None, None)
    for quadrant, h in found["energy"]["quadrants"].items():
        F = found["decomposition"]["quadrants"][quadrant]["F"]
        sign = 1 if quadrant[0] == "p" else -1
        for function in (h, F):
            assert (function["formula"], function["numeric"]) == (None, True)
        # Beside the errors that are told, the rounding of what is expected here: of numbers up to 51.
        for nu, value in h["points"]:
            assert abs(value + nu / 2 - (-1 if 0 < nu < 0.5 else 1)) <= h["error"] + 1e-14
        for w, value in F["points"]:
            shift = 1 if sign > 0 and w < 0.25 else -1
            assert abs(value - sign * w**0.5 / 2 - shift) <= F["error"] + 1e-14
        assert all((nu > 0) == (sign > 0) for nu, _ in h["points"])
        G = found["decomposition"]["quadrants"][quadrant]["G"]
        assert (G["numeric"], G["points"], G["error"]) == (False, [], None)
