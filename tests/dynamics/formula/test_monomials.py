"""Sums of monomials hold against evaluation: by every kind of rules a sum has the values of its formula."""

from fractions import Fraction

import pytest
from flint import arb, ctx, fmpq
from hypothesis import given
from hypothesis import strategies as st

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.monomials import (
    ALL_ATOMS,
    LOG_G1,
    LOG_G3,
    RHO,
    SPHERE,
    NotAMonomialSumError,
    ReadSum,
    Rules,
    added_up,
    read,
    reduced,
    weighted_sum,
    without_zeros,
)
from service.dynamics.potentials.recognition import laurent
from service.dynamics.verdict.sphere.boxes import sphere_points
from tests.support.planar import body, formula

BALLS = BallAlgebra()
RULES = {
    "any signs": Rules(atoms=ALL_ATOMS),
    "one quadrant": Rules((1, 0, -1), plain=2, atoms=ALL_ATOMS),
    "polynomials": Rules(plain=7),
    "without g2²": Rules((-1, 0, 0), plain=2, relation=SPHERE[1], has_roots=False),
    "without g3²": Rules((1, 0, 1), plain=2, relation=SPHERE[2], atoms=ALL_ATOMS),
}
# Polynomials, quotients, roots, absolute values, logarithms, functions of g2, and what cancels on the sphere.
FORMULAS = [
    "(g1 + 2*g2*g3 - 1/3)^3",
    "g1^3/g3^2 + 2*g2^2 - g2/g1",
    "1/(1 - g1^2 - g2^2) + (g1^2 + g2^2 + g3^2)^4*g3",
    "abs(g1)^(4/7)*g3 - g3^3/abs(g1)^(1/3)",
    "(g1^2)^(1/2)*g2 + abs(g1*g3)",
    "(g2^2)^(3/7) + sqrt(g2^2)",
    "(2 - 2*g2^2)^(1/2)*g1 + (g1^2 + g3^2)^(-3/2)",
    "log(g1^2/(g1^2 + g3^2))*(2*g1^2 + g3^2)",
    "exp(g2)^2*g1 - sin(1/3)*cos(exp(g2)) + pi*g2^g2",
    "abs(g2)*g1 + tan(g2)/g3",
    "exp(g2) - exp(sqrt(g2^2))",
    "abs(g1)^(17384615384615387/10^16) - abs(g3)^(1/10^9)",
]


def tape_of(text):
    return formula(text, body(2, 1)).tape


def values_of(terms, unit, atoms, gamma):
    g1, g2, g3 = gamma
    total = arb(0)
    for (a, b, d, signs, powers), coefficient in terms:
        value = arb(coefficient)
        for place, exponent, bit in ((g1, a, 1), (g2, b, 2), (g3, d, 4)):
            value *= BALLS.power(abs(place), Fraction(exponent, unit))
            value *= place.sgn() if signs & bit else 1
        for number, exponent in powers:
            value *= BALLS.power(atoms[number], Fraction(exponent, unit))
        total += value
    return total


def value_of(found: ReadSum, gamma):
    """The value of a sum, from its monomials and its atoms."""
    g1, _, g3 = gamma
    rho = g1 * g1 + g3 * g3
    atoms = {RHO: rho, LOG_G1: abs(g1).log(), LOG_G3: abs(g3).log(), -1: rho.log()}
    for number, (name, arguments, exponent) in enumerate(found.atoms):
        values = [
            values_of([(each, fmpq(p, q)) for each, p, q in terms], found.unit, atoms, gamma)
            for terms in arguments
        ]
        if name == "power":
            atoms[number] = BALLS.power(values[0], Fraction(*exponent))
        elif name == "general_power":
            atoms[number] = BALLS.general_power(*values)
        else:
            atoms[number] = BALLS.pi() if name == "pi" else BALLS.call(name, values[0])
    return values_of(found.terms.items(), found.unit, atoms, gamma)


@pytest.mark.parametrize("text", FORMULAS)
@pytest.mark.parametrize("name", RULES)
def test_a_sum_has_the_values_of_its_formula(name, text):
    rules, tape = RULES[name], tape_of(text)
    try:
        found = read(tape, rules)
    except NotAMonomialSumError:
        return
    seen = 0
    with ctx.workprec(192):
        for point in sphere_points():
            if any(sign * g < 0 for sign, g in zip(rules.signs, point, strict=True)):
                continue
            gamma = [BALLS.constant(g) for g in point]
            expected = tape.evaluate(BALLS, gamma)
            if expected.is_finite():
                seen += 1
                value = value_of(found, gamma)
                assert value.overlaps(expected)
                # Some sixty roundings of numbers that are not much larger than their sum.
                assert value.rad() <= 1e-40
    assert seen > 3


@pytest.mark.parametrize(
    ("name", "refused"),
    [
        # 1 - g1² - g2² is one power only where g2² is replaced, and log |g1| needs a sign.
        ("any signs", {2, 7}),
        ("one quadrant", {2}),
        ("polynomials", set(range(2, 12))),
        # There, |g2| is no polynomial in g2, and g1 has a sign.
        ("without g2²", {3, *range(5, 12)}),
        # 1/g3² is one through a sum of three terms.
        ("without g3²", {1, 2}),
    ],
)
def test_all_others_are_sums(name, refused):
    """The law above is about something."""
    found = set[int]()
    for number, text in enumerate(FORMULAS):
        try:
            read(tape_of(text), RULES[name])
        except NotAMonomialSumError:
            found.add(number)
    assert found == refused


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("1/(1 - g1^2 - g2^2)", "1/g3^2"),
        ("(1 - g2^2 - g3^2)^3*g2^5/g1^6", "g2*(1 - g1^2 - g3^2)^2"),
        ("sqrt(g3^2) + abs(g3)", "2*g3*(g3/abs(g3))"),
        ("abs(g1)", "-g1"),
    ],
)
def test_on_the_sphere_a_function_has_one_form(text, same):
    assert laurent(tape_of(text), -1) == laurent(tape_of(same), -1)


@pytest.mark.parametrize("text", ["g1^(1/2)", "(g3^3)^(2/3)", "pi*g1", "exp(g2)", "abs(g2)", "1/(2 - g2)"])
def test_what_has_roots_functions_or_values_on_one_side_is_no_laurent_polynomial(text):
    assert laurent(tape_of(text), -1) is None


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("text", "rules"),
    [
        ("(1 + g1 + g2 + g3)^500", Rules()),
        ("(((((((1 + g1)^9)^9)^9)^9)^9)^9)^9", Rules()),
        ("(g1 + g2)^4", Rules(most_terms=4)),
        ("(g1 + g2)*(g1 + g3)*(g2 + g3)", Rules(most_work=10)),
        ("(g1 + g2)*(g1 + g3)", Rules(most_products=3)),
        ("(g1 + g2)^5", Rules(most_degree=4)),
        ("(2/3)^20*g1", Rules(most_bits=20)),
        ("exp(g2) + sin(g2)", Rules(atoms=ALL_ATOMS, most_atoms=1)),
        ("exp(g2 + g2^2)", Rules(atoms=ALL_ATOMS, most_argument_terms=1)),
        ("exp(exp(g2))", Rules(atoms=ALL_ATOMS, nests=False)),
        ("exp(g1)", Rules(atoms=ALL_ATOMS)),
        ("1/(g1 - g1)", Rules(atoms=ALL_ATOMS)),
    ],
)
def test_beyond_a_limit_there_is_no_sum(text, rules):
    with pytest.raises(NotAMonomialSumError):
        read(tape_of(text), rules)


def test_where_a_root_needs_a_sign_it_is_noted():
    assert read(tape_of("sqrt(g1) + abs(g3)^(1/3)"), Rules()).positive == 1


FRACTIONS = st.fractions(-3, 3, max_denominator=7)
TERMS = st.lists(st.tuples(st.integers(0, 4), FRACTIONS))


def polynomial_at(terms, x):
    return sum((coefficient * x**power for power, coefficient in terms), Fraction(0))


@given(TERMS, FRACTIONS, FRACTIONS)
def test_equal_keys_are_added_and_zeros_left_out_without_changing_the_value(terms, factor, x):
    total = added_up(terms)
    assert list(total) == list(dict.fromkeys(power for power, _ in terms))
    assert polynomial_at(total.items(), x) == polynomial_at(terms, x)
    weighted = weighted_sum([(factor, total), (Fraction(2), {0: x})])
    assert polynomial_at(weighted.items(), x) == factor * polynomial_at(terms, x) + 2 * x
    kept = without_zeros(total)
    assert all(kept.values())
    assert polynomial_at(kept.items(), x) == polynomial_at(terms, x)


@given(
    st.dictionaries(st.tuples(*[st.integers(0, 5)] * 3), st.integers(-4, 4), max_size=5), st.integers(0, 2)
)
def test_a_square_is_replaced_without_changing_the_value_on_the_sphere(terms, position):
    total = {(*each, 0, ()): fmpq(value) for each, value in terms.items() if value}
    found = reduced(total, SPHERE[position])
    assert all(each[position] < 2 for each in found)
    for x, y, z in list(sphere_points())[:3]:
        values = [
            sum(Fraction(int(c.p), int(c.q)) * x**a * y**b * z**d for (a, b, d, *_), c in each.items())
            for each in (total, found)
        ]
        assert values[0] == values[1]
