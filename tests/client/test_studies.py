"""Studies over the live service: answers, numbers with their errors, waiting for the job, the command."""

import json
from fractions import Fraction

import pytest

import polhode as ph
from tests.support.commands import polhode

BASE = {
    "body": {"A": 2, "C": 1},
    "potential": {"type": "expression", "expression": "-g1 + 1/(20*g3^2)"},
    "motion": {"type": "planar"},
}
NEAR_ONE = {"/motion/lambda": ("99/100", "101/100")}


def test_a_search_of_numbers_tells_them_with_their_errors(connected):
    found = connected.search(BASE, NEAR_ONE, energy="2/5")
    (solution,) = found.solutions
    # h = λ²/2 − 1/(10 λ⁴) (theory 3.3) is 2/5 at λ = 1.
    assert abs(Fraction(solution["lam"].digits) - 1) <= Fraction(solution["lam"].radius)
    assert (solution.window, solution.is_proved, found.is_complete, found.undecided) == (0, True, True, [])
    assert repr(found) == "<1 solutions; no others>"
    document = {"what": "numbers", "base": BASE, "unknowns": [], "wanted": []}
    with pytest.raises(ph.RefusedError) as refused:
        connected.study(document)
    assert {fault["pointer"] for fault in refused.value.document["errors"]} == {"/unknowns", "/wanted"}
    with pytest.raises(ph.WrongArgumentError):
        connected.study({"what": "beauty"})


def test_integrals_and_potentials_are_asked_by_letters(connected):
    # Kovalevskaya's integral (1889), of a heavy body with A = B = 2C.
    function = "(p^2 - q^2 - k*g1/C)^2 + (2*p*q - k*g2/C)^2"
    answer = connected.integral(function, "k*g1", body={"A": "2*C", "B": "2*C"}, letters=["k"])
    assert (answer["verdict"], answer["name"]) == ("integral", "kovalevskaya")
    refuted = connected.integral(function, "k*g1", body=(3, 2, 1), k=1)
    assert (refuted["verdict"], refuted["proof"]) == ("not_integral", "counterexample")
    assert connected.search_integrals("g1", (2, 1), body=(2, 2, 1))["integrals"] == []
    assert connected.search_potentials(1, body=(2, 1))["dimension"] == 2


def test_the_command_prints_an_answer_for_people_and_for_programs(service, tmp_path, capsys):
    file = tmp_path / "study.json"
    asked = {
        "what": "numbers",
        "base": BASE,
        "unknowns": [{"pointer": "/motion/lambda", "interval": list(NEAR_ONE["/motion/lambda"])}],
        "wanted": [{"of": "energy", "equals": "2/5"}],
    }
    file.write_text(json.dumps(asked), encoding="utf-8")
    assert polhode("study", file, "--url", service.address) == 0
    assert "rest: proved_empty" in capsys.readouterr().out.splitlines()
    assert polhode("study", file, "--json") == 0
    assert json.loads(capsys.readouterr().out)["rest"] == "proved_empty"
    file.write_text(json.dumps({**asked, "what": "beauty"}), encoding="utf-8")
    assert polhode("study", file) == 1
    assert "accepted are integral, integrals, potentials, numbers" in capsys.readouterr().err
