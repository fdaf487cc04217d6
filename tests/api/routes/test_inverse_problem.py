"""What a validation says of the parts of a potential: F, G, the known terms, the nearest admissible one."""

import numpy as np
import pytest

pytestmark = pytest.mark.any_database


def validate(client, potential, moments=None, **fields):
    document = {"body": moments or {"A": 2, "C": 1}, "potential": potential, **fields}
    response = client.post("/v1/validations", json=document)
    assert response.status_code == 200, response.json()
    return response.json()


def expression(text):
    return {"type": "expression", "expression": text}


def formulas(quadrants, function):
    return {quadrant: parts[function]["formula"] for quadrant, parts in quadrants.items()}


def test_the_parts_of_a_sum_of_known_terms_are_formulas_and_coefficients(client):
    text = "(3*g1^2+g3^2)*(g2^2-1/2+g2^3/5) - g1^(4/3)/3 + 1/(200*g3^4)"
    found = validate(client, expression(text), {"A": 3, "C": 1})["decomposition"]
    assert found["terms"] == {
        "constant": "0",
        "A": ["-1/2", "0", "1", "1/5"],
        "B": ["-1/3"],
        "C": ["1/200"],
        "log": [],
    }
    # H[B_0] = −λ²/3, H[C_0] = −3 λ^-6 and w = 4 λ^6 (A − C = 2): F = −H.
    assert found["F"] == "3/50*w^-1 - 1/18*2^(1/3)*w^(1/3)"
    assert found["reference_angle"] == "pi/4"
    assert found["values"] is None


def test_an_odd_term_has_an_F_of_its_own_on_each_quadrant(client):
    found = validate(client, {"type": "gravity", "a": -1})
    assert (found["energy"]["h"], found["energy"]["h_named"]) == ("1/2*nu", "-1/2*a*nu")
    # w = nu², h = nu/2 = −F.
    assert found["decomposition"]["F"] is None
    F = formulas(found["decomposition"]["quadrants"], "F")
    assert F == {"pp": "-1/2*w^(1/2)", "mp": "1/2*w^(1/2)", "pm": "-1/2*w^(1/2)", "mm": "1/2*w^(1/2)"}


def test_an_energy_that_depends_on_signs_is_told_by_quadrant(client):
    found = validate(client, expression("-g1*(4*g1^2+3*g3^2)"), {"A": 4, "C": 1})
    # B_1 at α = 4 has H = −(4 − 2)/4 λ⁴.
    half = {"pp": "1/2*lambda^4", "mp": "-1/2*lambda^4", "pm": "1/2*lambda^4", "mm": "-1/2*lambda^4"}
    assert found["energy"]["h"] is None
    assert {q: h["formula"] for q, h in found["energy"]["quadrants"].items()} == half


def test_the_functions_are_evaluated_at_points_that_are_sent(client):
    potential = {"type": "general", "F": "exp(-w)", "G": "g2^3"}
    points = {"w": ["1/2", 40], "g2": ["1/4"]}
    found = validate(client, potential, {"A": "17/10", "C": 1}, points=points)["decomposition"]
    for (w, F, error), place in zip(found["values"]["mp"]["F"], (0.5, 40.0), strict=True):
        # numpy's exponential is good to an ulp.
        assert w == place
        assert abs(F - np.exp(-place)) <= error + np.spacing(F)
    assert found["values"]["mp"]["G"] == [[0.25, 0.25**3, 0.0]]


@pytest.mark.parametrize(
    ("points", "pointer"), [({"w": [0]}, "/points/w/0"), ({"g2": ["1/2", 1]}, "/points/g2/1")]
)
def test_points_outside_the_functions_domains_are_refused(client, points, pointer):
    document = {"body": {"A": 2, "C": 1}, "potential": {"type": "gravity", "a": 1}, "points": points}
    response = client.post("/v1/validations", json=document)
    assert response.status_code == 422
    assert [(e["pointer"], e["code"]) for e in response.json()["errors"]] == [(pointer, "out_of_range")]


@pytest.mark.parametrize(
    ("A", "text", "expected", "distance"),
    [
        (2, "g1 + 3/10*g3^2 + 1/10*g1*g2", "0.1 + g1", "13/528"),
        (3, "g1 + 3/10*g3^2 + 1/10*g1^2*g2", None, "32231/33228"),
    ],
)
def test_the_nearest_admissible_polynomial_is_exact(client, A, text, expected, distance):
    # Up to the degree of the potential.
    body, degree = {"A": A, "C": 1}, A
    found = validate(client, expression(text), body, nearest={"degree": degree})
    assert found["verdict"] == "inadmissible"
    assert found["nearest"]["relative_squared_distance"] == distance
    assert expected is None or found["nearest"]["expression"] == expected
    again = validate(client, expression(found["nearest"]["expression"]), body)
    assert (again["verdict"], again["nearest"]) == ("admissible", None)


def test_the_nearest_polynomial_says_among_which_it_was_searched(client):
    found = validate(client, expression("g1"), {"A": 4, "C": 1})["nearest"]
    assert found["expression"] == "140/113*g1^3 + 105/113*g1*g3^2"
    assert (found["relative_squared_distance"], found["degree"]) == ("8/113", 7)
    assert found["space"]["dimension"] == 8
    assert "degree of at most 7" in found["space"]["description"]
    distances = ["1", "1", "1", *["8/113"] * 5]
    assert found["by_degree"] == [
        {"degree": n, "relative_squared_distance": distance} for n, distance in enumerate(distances)
    ]


def test_the_degree_of_the_search_may_be_asked_for(client):
    potential = {"type": "expression", "expression": "a*g2 + g1", "parameters": {"a": 2}}
    for degree in (0, 2, 9):
        found = validate(client, potential, {"A": 4, "C": 1}, nearest={"degree": degree})["nearest"]
        assert (found["degree"], len(found["by_degree"])) == (degree, degree + 1)
        assert found["by_degree"][-1]["relative_squared_distance"] == found["relative_squared_distance"]
        assert found["expression_named"] is not None


@pytest.mark.parametrize(
    ("nearest", "pointer", "code"),
    [
        ({"degree": 25}, "/nearest/degree", "out_of_range"),
        ({"degree": -1}, "/nearest/degree", "out_of_range"),
        ({"degree": 2.5}, "/nearest/degree", "invalid_number"),
        ({}, "/nearest/degree", "missing_field"),
        ({"degree": 3, "order": 1}, "/nearest/order", "unknown_field"),
        (12, "/nearest", "invalid_type"),
    ],
)
def test_a_degree_that_is_not_searched_up_to_is_refused(client, nearest, pointer, code):
    document = {"body": {"A": 2, "C": 1}, "potential": expression("g2"), "nearest": nearest}
    problem = client.post("/v1/validations", json=document).json()
    assert [(fault["pointer"], fault["code"]) for fault in problem["errors"]] == [(pointer, code)]
    if code == "out_of_range":
        assert "0 to 24 are accepted" in problem["errors"][0]["message"]


def test_what_is_no_polynomial_has_no_nearest_one(client):
    assert validate(client, expression("exp(g1)"))["nearest"] is None


def test_a_trivial_term_is_a_warning(client):
    found = validate(client, {"type": "homogeneous", "B": [-1, 1]})
    assert [(w["code"], w["pointer"]) for w in found["warnings"]] == [("trivial_term", "/potential/B/1")]
