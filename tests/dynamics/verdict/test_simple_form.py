"""A simpler formula equals the potential on the sphere, is used where it tells more, and nowhere else."""

from fractions import Fraction
from math import inf

import pytest
from flint import arb, ctx, fmpq
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.formula.tree import format_tree
from service.dynamics.verdict.simple_form import SIMPLER_POTENTIAL, is_simplified, simplified
from service.dynamics.verdict.verdict import decide
from tests.dynamics.verdict.formulas import EIGHT_PARAMETERS, EIGHT_TERMS, body, potential
from tests.support.effort import examples
from tests.support.hard_problems import SAME_AS, Q

AS_GOOD = [
    "-g1",
    "-g1 + 1/(20*g3^2) + (1+sqrt(5))/4*(g1^2-g2^2)",
    "-abs(g1)^(4/7)",
    f"{Q}*(g2^2-1/2+g2^3/5)",
    f"{Q}*(sin(g2)-g2)",
    f"{Q}*sqrt(1-g2)",
    f"{Q}*log(2+g2)",
    f"{Q}*(g2-1/2)*abs(g2-1/2)^(1/3)",
    f"-g1+{Q}*exp(-100*(g2-1/3)^2)",
    f"-g1+{Q}/(1+25*g2^2)",
]
DEFINED_IN_PARTS = [
    f"{Q}*sqrt(g2)^2+1e6*(g1^2+g2^2+g3^2-1)",
    f"({Q}^3*g2^3)^(1/3)",
    f"{Q}*sqrt((1/2-g2)*(1/3+g1))^2",
    f"{Q}*exp(log(g2-1/3))",
]
"""Simpler formulas of these would have values where they have none."""

numbers = st.fractions(Fraction(-1), Fraction(1), max_denominator=1000)


def on_sphere(x: Fraction, y: Fraction) -> tuple[arb, arb, arb]:
    """A point with rational coordinates, by stereographic projection."""
    square = x * x + y * y
    g1, g2, g3 = 2 * x / (1 + square), (1 - square) / (1 + square), 2 * y / (1 + square)
    first, second, third = (arb(fmpq(g.numerator, g.denominator)) for g in (g1, g2, g3))
    return first, second, third


@pytest.mark.one_in(4)
@pytest.mark.parametrize("text", SAME_AS)
def test_what_hides_is_found(text):
    stated = potential(text)
    found = simplified(stated)
    assert is_simplified(found)
    simple = compile_tape(parse(SAME_AS[text]))
    assert len(found.tape.instructions) <= 2 * len(simple.instructions) + 2, format_tree(found.tree)
    assert [notice.code for notice in found.notices] == [SIMPLER_POTENTIAL]
    # What was typed is told wherever V is.
    assert found.formula() == stated.formula()
    assert found.as_stated is stated


@pytest.mark.random_law
@given(text=st.sampled_from(sorted(SAME_AS)), x=numbers, y=numbers, scale=st.sampled_from([1, 1000]))
@settings(max_examples=examples(30, 5000), deadline=None)
def test_a_simpler_formula_has_the_same_values_on_the_sphere(text, x, y, scale):
    """Next to the north pole, where x and y are small, too."""
    with ctx.workprec(400):
        g = on_sphere(x / scale, y / scale)
        stated = potential(text)
        simple, known = simplified(stated).value_ball(*g), potential(SAME_AS[text]).value_ball(*g)
        value = stated.value_ball(*g)
        if value.is_finite():
            assert simple.overlaps(value)
            assert known.overlaps(value)
            # 400 bits of balls are enough: neither of the two may overlap because it is wide.
            assert simple.rad() < 1e-60 * (1 + abs(simple))


@pytest.mark.parametrize("text", AS_GOOD)
def test_a_formula_that_is_as_good_is_left_as_it_is(text):
    stated = potential(text)
    assert simplified(stated) is stated


def test_the_potential_of_the_paper_is_left_as_it_is():
    stated = potential(EIGHT_TERMS, parameters=EIGHT_PARAMETERS)
    assert simplified(stated) is stated


@pytest.mark.parametrize("text", DEFINED_IN_PARTS)
def test_a_formula_keeps_the_places_where_it_has_no_value(text):
    stated = potential(text)
    assert simplified(stated) is stated


@pytest.mark.parametrize("text", [*SAME_AS, *AS_GOOD])
def test_a_simpler_formula_of_a_simpler_formula_is_itself(text):
    found = simplified(potential(text))
    assert simplified(found) is found
    again = simplified(potential(format_tree(found.tree)))
    # By itself it may have the same functions once more: then its intervals are no narrower.
    assert not is_simplified(again) or len(again.tape.instructions) <= len(found.tape.instructions)


@pytest.mark.parametrize("text", SAME_AS)
def test_intervals_of_a_simpler_formula_are_not_wide(text):
    """Next to the pole and in the middle, on boxes of a thousandth, against those of the known formula."""
    with ctx.workprec(64):
        for x, y in ((Fraction(1, 5), Fraction(1, 3)), (Fraction(1, 900), Fraction(-1, 700))):
            g = [each * arb(1, 1e-3) for each in on_sphere(x, y)]
            found = simplified(potential(text)).value_ball(*g)
            known = potential(SAME_AS[text]).value_ball(*g)
            width = float(known.rad()) if known.is_finite() else inf
            # A sum of three terms may be twice as wide as a product of two.
            assert float(found.rad()) <= 2.5 * width or not known.is_finite()


@pytest.mark.parametrize("text", ["-abs(g2)*g1", "1e6*(g1^2+g2^2+g3^2-1)+g1*g3"])
def test_the_verdict_is_on_what_was_typed(text):
    stated = potential(text)
    assert decide(body(2), simplified(stated)) == decide(body(2), stated)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    "text",
    [
        f"({Q}^3*g2^3)^(1/3)",
        f"({Q}^3*(g2-1/2)^3)^(1/3) - g1",
        "(8*g1^6+12*g1^4*g3^2+6*g1^2*g3^4+g3^6)^(1/3)",
        f"{Q}*((g2+1/3)^5)^(1/5)",
    ],
)
def test_a_line_with_values_on_one_side_only_is_no_doubt(text):
    """No motion crosses the edge of where V is defined."""
    verdict = decide(body(2), potential(text))
    assert (verdict.verdict, verdict.proof) == ("admissible", "symbolic")


@pytest.mark.parametrize("text", ["sqrt(abs(g1+g2))", f"{Q}*abs(g2-g1)", f"{Q}*abs(g2)^(1/3)*g2/abs(g2-g3)"])
def test_a_kink_with_values_on_both_sides_is_none_of_them(text):
    assert decide(body(2), potential(text)).verdict != "admissible"
