"""Sums of powers have the values of their formulas, and values where the factors of these have none."""

from fractions import Fraction

import pytest
from flint import arb, ctx

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.power_sums import PowerAlgebra, PowerSum, Small
from service.dynamics.formula.tape import Tape
from tests.support.planar import body, formula

G, Z = Fraction(3, 5), Fraction(4, 5)
FORMULAS = [
    "g3^4/g1 + 2*g1 - 1/2",
    "(g1^2 + 2*g3^2)*(g2 - g2^2)/g1",
    "abs(g1)^(4/7)*g3 - g3^3/abs(g1)^(1/3)",
    "sqrt(2*g1^2 + g3^2) + exp(g1)*g3",
    "(g1 - g3^2)^3/(g1^2 + g3^4)",
    "log(g1^2 + g3^2) + abs(g3)/g3",
    "-g1*g3/g1 + 0*g2",
]


def tape_of(text: str) -> Tape:
    return formula(text, body(2, 1)).tape


def through_powers(text: str, x: arb, side: int, alpha: Fraction = Fraction(7, 5), unit: int = 5) -> arb:
    base = BallAlgebra()
    root = abs(x) ** (arb(1) / unit) if side else x
    algebra = PowerAlgebra(base, Small(root, unit if side else 1, side))
    g1, g3 = algebra.loop(base.constant(G), base.constant(Z), alpha, 1)
    return algebra.value(tape_of(text).evaluate(algebra, (g1, algebra.of(arb("0.3")), g3)))


@pytest.mark.parametrize("text", FORMULAS)
@pytest.mark.parametrize(("x", "side"), [("0.37", 1), ("-0.61", -1), ("0.37", 0), ("-0.61", 0)])
def test_they_are_the_values_of_the_formula(text, x, side):
    with ctx.workprec(160):
        place = arb(x)
        gamma = arb(G.numerator) / 5 * abs(place) ** (arb(7) / 5), arb("0.3"), arb(4) / 5 * place
        expected = tape_of(text).evaluate(BallAlgebra(), gamma)
        found = through_powers(text, place, side)
        assert found.overlaps(expected)
        # As many bits but for what a dozen operations round.
        assert found.rel_accuracy_bits() > 140


def test_a_quotient_has_a_value_where_its_factors_vanish():
    # g3⁴/g1 = (Z⁴/G) |x|^(4 − α) and (g1² + g3²)/|g3| = Z |x| (1 + …).
    about = arb(0, 0.125)
    assert not tape_of("g3^4/g1").evaluate(BallAlgebra(), (about, arb(1), about)).is_finite()
    found = through_powers("g3^4/g1", about, 0, Fraction(2))
    limit = arb(256) / 625 / (arb(3) / 5) * arb(0.125) ** 2
    assert found.contains(0)
    assert found.contains(limit)
    assert abs(found).upper() < 1.001 * limit
    assert through_powers("(g1^2 + g3^2)/sqrt(g3^2)", arb(0), 1, Fraction(2), 1) == 0


def test_exact_numbers_cancel():
    # 1 − g2² for g2 = 1 − u is 2u − u², to all digits of a small u, and not the rest of a difference.
    base = BallAlgebra()
    algebra = PowerAlgebra(base, Small(arb("1e-30"), 1, 1))
    u = PowerSum({(Fraction(2), 0): arb(3)})
    g2 = algebra.subtract(algebra.constant(Fraction(1)), u)
    found = algebra.value(tape_of("sqrt(1 - g2^2)").evaluate(algebra, (u, g2, u)))
    assert found.rel_accuracy_bits() > 45
    assert found.overlaps(arb(6).sqrt() * arb("1e-30"))


@pytest.mark.parametrize(
    ("text", "terms"),
    [
        ("(1 - g3^2)/(1 + g3)", {0: 1, 1: -1}),
        ("(1 + g3)^3/(1 + g3)^2", {0: 1, 1: 1}),
        ("(sqrt(g3) + 2*g3)/(3 + 6*sqrt(g3))", {Fraction(1, 2): Fraction(1, 3)}),
        ("(g3^2 - 1/g3)*g3/(g3 - 1)", {0: 1, 1: 1, 2: 1}),
    ],
)
def test_a_quotient_of_sums_with_exact_numbers_is_a_sum_where_it_is_one(text, terms):
    algebra = PowerAlgebra(BallAlgebra(), Small(arb("0.3"), 1, 1))
    g3 = PowerSum({(Fraction(1), 0): Fraction(1)})
    found = tape_of(text).evaluate(algebra, (g3, g3, g3))
    assert found.terms == {(Fraction(e), 0): Fraction(factor) for e, factor in terms.items()}
    # No value was asked for on the way: it is the same at every place.
    assert not algebra.powers
