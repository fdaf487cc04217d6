"""Two formulas are called the same function only where that is true for all values."""

import pytest

from service.dynamics.formula.parser import parse
from service.dynamics.verdict.proofs.proof import is_same_function

SPHERE = {"g1": 0, "g2": 0, "g3": 0}


@pytest.mark.parametrize(
    ("left", "right", "signs"),
    [
        ("-1/2*a*nu", "-(a*nu/2)", {"nu": 0}),
        ("a*g1 + b/g3^2", "(a*g1*g3^2 + b)/g3^2", SPHERE),
        ("1/2*w^(1/2) + w^-1", "(w^(3/2) + 2)/(2*w)", {"w": 1}),
        ("sqrt(nu^2)", "-nu", {"nu": -1}),
        ("sqrt(nu^2)", "abs(nu)", {"nu": 0}),
        ("sin(g2)^2 + cos(g2)^2", "1", {"g2": 0}),
        ("exp(-w)*exp(2*w)", "exp(w)", {"w": 1}),
        ("log(w^3) - log(w)", "2*log(w)", {"w": 1}),
        ("(g1^2 - nu^2)/(g1 - nu)", "g1 + nu", {"g1": 1, "nu": 1}),
        ("sqrt(2)*sqrt(3)", "sqrt(6)", {}),
        ("2/(13/10 + sqrt(169/100 + 4))", "20/(13 + sqrt(569))", {}),
        ("a^2/b*x + c*x", "x*(a^2 + b*c)/b", {"x": 1}),
    ],
)
def test_identities_are_proved(left: str, right: str, signs: dict[str, int]) -> None:
    assert is_same_function(parse(left), parse(right), signs)


@pytest.mark.parametrize(
    ("left", "right", "signs"),
    [
        # By less than any check in balls could see.
        ("g1", "g1 + 1e-90*g2", SPHERE),
        ("w", "w*(1 + 1e-300)", {"w": 1}),
        ("a*nu", "a*nu + 1e-90*b", {"nu": 0}),
        # True on a part only.
        ("abs(1 - w)", "1 - w", {"w": 1}),
        ("abs(nu)", "nu", {"nu": 0}),
        ("sqrt(a^2)*nu", "a*nu", {"nu": 0}),
        # Without a value where the first one has one.
        ("x", "sqrt(x)^2", {"x": 0}),
        ("log(x^2)", "2*log(x)", {"x": 0}),
        ("sqrt(x*y)", "sqrt(x)*sqrt(y)", {"x": 0, "y": 0}),
        # Without a value anywhere.
        ("sqrt(-1 - x^2)", "sqrt(-1 - x^2)*2", {"x": 0}),
        # The wrong branch, a wrong sign, a lost parameter.
        ("(x^2)^(1/2)", "x", {"x": -1}),
        ("a*g1 + b/g3^2", "a*g1 - b/g3^2", SPHERE),
        ("a*g1 + b/g3^2", "b*g1 + a/g3^2", SPHERE),
        ("x*y*z", "x*y*z", {"x": 1, "y": 1, "z": 1}),
    ],
)
def test_what_is_not_the_same_everywhere_is_not_proved(left: str, right: str, signs: dict[str, int]) -> None:
    assert not is_same_function(parse(left), parse(right), signs)


def test_what_gains_values_is_the_same_where_the_first_has_some() -> None:
    assert is_same_function(parse("sqrt(x)^2"), parse("x"), {"x": 0})
