from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.potentials.families.coefficients import (
    gravity_potential,
    homogeneous_potential,
    rational_potential,
)
from service.dynamics.potentials.recognition import ThreeTerms, recognise
from tests.support.effort import examples
from tests.support.planar import body, formula

numbers = st.fractions(-5, 5, max_denominator=50)


@pytest.mark.parametrize(
    ("text", "terms"),
    [
        ("-g1", (-1, 0, 0, 0)),
        ("-g1 + g1^2 - g2^2", (-1, 0, 1, 0)),
        ("2*g1^2 + g3^2", (0, 0, 1, 1)),
        ("3*g1^2 + 2*g3^2 + g2^2 - g1", (-1, 0, 1, 2)),
        ("1/(20*g3^2) - (g1 - 2)/4", (Fraction(-1, 4), Fraction(1, 20), 0, Fraction(1, 2))),
        ("g3^-2*(1 - g1*g3^2)", (-1, 1, 0, 0)),
        ("(1 - g1^2 - g2^2)^-1 - g1", (-1, 1, 0, 0)),
        ("g1^2/g3^2 + g2^2/g3^2", (0, 1, 0, -1)),
        ("g1*g2 - g2*g1 + 7", (0, 0, 0, 7)),
        ("abs(g3)^-2 + abs(g1*g3^2)/g3^2 - 2*abs(-g1)", (-1, 1, 0, 0)),
        ("abs(g3)*g3*g1/abs(g3*g1)/g3", (0, 0, 0, 1)),
    ],
)
def test_formulas_that_agree_on_the_sphere(text, terms):
    rigid_body = body(2, 1)
    assert recognise(rigid_body, formula(text, rigid_body)) == ThreeTerms(*(Fraction(t) for t in terms))


@settings(max_examples=examples(7, 20), deadline=None)
@given(numbers, numbers, numbers)
def test_the_rational_family_of_length_one(a1, b1, c1):
    potential = rational_potential([a1], [b1], [c1])
    assert recognise(body(2, 1), potential) == ThreeTerms(a1, b1, c1)


def test_axes_exchanged():
    rigid_body = body("3/2", 3)
    found = recognise(rigid_body, formula("2*g3 - 1/g1^2 + 3*(2*g3^2 + g1^2)", rigid_body))
    assert found == ThreeTerms(Fraction(2), Fraction(-1), Fraction(3), Fraction(3))


@pytest.mark.parametrize(
    "text",
    [
        "g1^2", "g2", "g3", "g1*g3", "1/g1^2", "1/g3^4", "g1 + 1e-300*g2", "sqrt(2)*g1", "pi*g1", "abs(g3)",
        "abs(1+g1)", "abs(g2)", "abs(g3)*g1", "exp(g2)", "1/(1+g1)", "g1^(1/2)", "1/g2", "g3^-2.5",
        "(g1+g2+g3)^64",
    ],
)  # fmt: skip
def test_what_is_not_of_the_kind(text):
    rigid_body = body(2, 1)
    assert recognise(rigid_body, formula(text, rigid_body)) is None


def test_the_absolute_value_of_g1_on_either_side():
    rigid_body = body(2, 1)
    potential = homogeneous_potential(rigid_body, B=[Fraction(-1)], C=[Fraction(1, 20)])
    for sign in (1, -1):
        expected = ThreeTerms(Fraction(-sign), Fraction(1, 20), Fraction(0))
        assert recognise(rigid_body, potential, sign) == expected


def test_other_bodies():
    assert recognise(body(3, 1), gravity_potential(Fraction(-1), Fraction(0), Fraction(0))) is None
