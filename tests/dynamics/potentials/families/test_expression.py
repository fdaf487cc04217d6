from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.body import RigidBody
from service.dynamics.errors import FormulaError, FormulaLimitError, MissingMomentError, UnknownNameError
from service.dynamics.formula.parameters import RESERVED_NAMES, ParameterNameError
from service.dynamics.potentials.families.written import (
    expression_potential,
)

BODY = RigidBody(Fraction(2), None, Fraction(1))
WITH_B = RigidBody(Fraction(2), Fraction(3, 2), Fraction(1))
GAMMA = np.array([0.3, 0.5, 0.7])


def test_parameters_and_moments_are_numbers_of_the_formula() -> None:
    potential = expression_potential(
        "a*g1 + b/g3^2 + A*B*C*g2", {"a": Fraction(-1), "b": Fraction(1, 20)}, WITH_B
    )
    assert potential.formula() == "-1*g1 + 0.05/g3^2 + 2*1.5*1*g2"
    # Five operations on numbers of order one.
    assert float(potential.value(GAMMA)) == pytest.approx(-0.3 + 0.05 / 0.49 + 1.5, rel=1e-15)


def test_the_exponent_may_be_a_ratio_of_moments() -> None:
    body = RigidBody(Fraction(17, 10), None, Fraction(1))
    potential = expression_potential("g1^(2*(A - C)/A)", {}, body)
    assert float(potential.value(GAMMA)) == pytest.approx(0.3 ** (14 / 17), rel=1e-15)


def test_the_same_formula_in_other_words_is_the_same_potential() -> None:
    one = expression_potential("a*g1", {"a": Fraction(-1)}, BODY)
    other = expression_potential("-g1", {"unused": Fraction(3)}, BODY)
    assert one == other
    assert hash(one) == hash(other)


def test_a_parameter_that_is_zero_takes_its_term_away() -> None:
    potential = expression_potential("-g1 + b/g3^2", {"b": Fraction(0)}, BODY)
    assert float(potential.value(np.array([0.5, 0.5, 0.0]))) == -0.5


def test_a_long_sum_is_a_potential_like_any_other() -> None:
    potential = expression_potential("+".join(["g1"] * 1249), {}, BODY)
    assert float(potential.value(GAMMA)) == pytest.approx(1249 * 0.3, rel=1e-12)
    assert potential == expression_potential(potential.formula().replace(" ", ""), {}, BODY)
    assert "Potential" in repr(potential)


@pytest.mark.parametrize("text", ["B*g1", "g1^(B/C)", "0*B + g1"])
def test_B_in_the_formula_needs_B_in_the_body(text: str) -> None:
    expression_potential(text, {}, WITH_B)
    with pytest.raises(MissingMomentError, match="the formula needs the moment B") as caught:
        expression_potential(text, {}, BODY)
    assert caught.value.pointer == "/body/B"


@pytest.mark.parametrize(
    ("text", "error", "position"),
    [
        ("g1 +", FormulaError, 4),
        ("a*g1", UnknownNameError, 0),
        ("g1 + 1/(2 - A)", FormulaError, 6),
        ("g1^(1000*A)", FormulaLimitError, 2),
        ("g1" + "+g1" * 2000, FormulaLimitError, 4000),
    ],
)
def test_a_fault_is_reported_with_its_place(text: str, error: type[FormulaError], position: int) -> None:
    with pytest.raises(error) as caught:
        expression_potential(text, {}, BODY)
    assert caught.value.pointer == "/potential/expression"
    assert caught.value.position == position
    assert caught.value.code == "formula"
    assert caught.value.message.count("character ") == 1


@pytest.mark.parametrize("name", sorted(RESERVED_NAMES))
def test_a_name_with_a_meaning_is_no_parameter(name: str) -> None:
    with pytest.raises(ParameterNameError) as caught:
        expression_potential("g1", {name: Fraction(1)}, BODY)
    assert caught.value.pointer == f"/potential/parameters/{name}"


@pytest.mark.parametrize(
    ("name", "escaped"),
    [("", ""), ("2a", "2a"), ("a b", "a b"), ("é", "é"), ("a/b~c", "a~1b~0c"), ("x" * 61, "x" * 61)],
)
def test_a_parameter_must_have_a_name_of_the_grammar(name: str, escaped: str) -> None:
    with pytest.raises(ParameterNameError) as caught:
        expression_potential("g1", {name: Fraction(1)}, BODY)
    assert caught.value.pointer == f"/potential/parameters/{escaped}"
