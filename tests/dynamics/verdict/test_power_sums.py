"""Sums of real powers: the verdict by exponents, held against the ring of proofs, balls, and closed forms."""

from fractions import Fraction

import pytest
from flint import arb, ctx, fmpq

from service.dynamics.body import RigidBody
from service.dynamics.equations.compatibility import residual_ball
from service.dynamics.formula.algebras.monomials import NotAMonomialSumError
from service.dynamics.potentials.families.coefficients import (
    energy_of_B,
    energy_of_C,
    gravity_potential,
    homogeneous_potential,
    rational_potential,
)
from service.dynamics.potentials.families.written import expression_potential
from service.dynamics.verdict.proofs.energy_terms import energy_terms
from service.dynamics.verdict.proofs.power_sums import judge_power_sum, number_of, prove_power_sum
from service.dynamics.verdict.proofs.proof import prove
from service.dynamics.verdict.sphere.boxes import sphere_points
from service.dynamics.verdict.verdict import decide

ONE = Fraction(1)
DOUBLE = RigidBody(Fraction(2), None, ONE)
DRAWN = RigidBody(Fraction(17384615384615387, 10**16), None, ONE)
"""Its ring of proofs would need a root of degree 10^16."""


def expression(text, body=DOUBLE, **parameters):
    return expression_potential(text, {name: Fraction(value) for name, value in parameters.items()}, body)


def judged(body, potential):
    A, C = (fmpq(m.numerator, m.denominator) for m in (body.A, body.C))
    return judge_power_sum(A, C, potential.tape)


POTENTIALS = {
    "gravity": (DOUBLE, gravity_potential(ONE, Fraction(0), Fraction(0))),
    "three terms": (DOUBLE, expression("a*g1 + b/g3^2 + c*(2*g1^2+g3^2)*g2^3", a=-1, b="1/50", c=2)),
    "rational": (DOUBLE, rational_potential([ONE, ONE * 2, ONE * 3], [ONE, ONE / 2], [Fraction(0), ONE])),
    "by signs": (DOUBLE, expression("abs(g1) + g1*g3/abs(g3) + sqrt(g1)^2")),
    "on the sphere": (DOUBLE, expression("g1*(g1^2+g2^2+g3^2)^2")),
    "homogeneous": (
        RigidBody(Fraction(17, 10), None, ONE),
        homogeneous_potential(
            RigidBody(Fraction(17, 10), None, ONE), A=[ONE, ONE], B=[ONE, ONE], C=[ONE, ONE]
        ),
    ),
    "C larger": (RigidBody(ONE, None, Fraction(2)), expression("g3 + 1/g1^2")),
}


@pytest.mark.parametrize("name", POTENTIALS)
def test_the_energy_is_that_of_the_ring(name):
    body, potential = POTENTIALS[name]
    proof, energy = prove(body, potential.tape), prove_power_sum(body, potential.tape)
    assert proof is not None
    assert energy is not None
    assert energy.by_octant() == energy_terms(body, proof)


@pytest.mark.parametrize("n", [0, 1, 2])
def test_terms_of_any_moments_have_their_energies(n):
    alpha, unit = DRAWN.alpha, [Fraction(0)] * n + [ONE]
    of_B = prove_power_sum(DRAWN, homogeneous_potential(DRAWN, B=unit).tape).by_octant()[1, 1, 1]
    assert of_B == {(Fraction(2 * (n + 1)), ""): energy_of_B(alpha, n)}
    of_C = prove_power_sum(DRAWN, homogeneous_potential(DRAWN, C=unit).tape).by_octant()[1, 1, 1]
    assert of_C == {(-2 * alpha * (n + 1), ""): energy_of_C(alpha, n)}


def test_a_moment_of_many_digits_is_decided():
    potential = homogeneous_potential(DRAWN, A=[Fraction(0), ONE], B=[-ONE], C=[ONE / 20])
    assert prove(DRAWN, potential.tape) is None
    verdict = decide(DRAWN, potential)
    assert (verdict.verdict, verdict.proof) == ("admissible", "symbolic")
    assert verdict.energy_formula is not None


@pytest.mark.parametrize(
    ("body", "potential"),
    [
        (DRAWN, gravity_potential(ONE, Fraction(0), Fraction(0))),
        (DOUBLE, gravity_potential(ONE, ONE, Fraction(0))),
        (DOUBLE, expression("b/abs(g3)^k - g1", b=1, k="2.000000000000001")),
        (DOUBLE, expression("g1*g2")),
        (DOUBLE, expression("(2*g1^2+g3^2)*g1^k", k="1/7")),
    ],
)
def test_what_is_refuted_has_a_residual(body, potential):
    assert judged(body, potential).is_refuted
    with ctx.workprec(256):
        residuals = [residual_ball(body, potential.tape, point) for point in sphere_points()]
        assert any(each.is_defined and not each.residual.contains(0) for each in residuals)


def test_functions_of_numbers_are_constants_of_the_energy():
    found = judged(DOUBLE, expression("exp(k)*sin(k)^2*g1 + cos(k)/g3^2", k="3/7")).energy
    with ctx.workprec(128):
        k = arb(fmpq(3, 7))
        expected = {fmpq(2): -k.exp() * k.sin() ** 2 / 2, fmpq(-4): -2 * k.cos()}
        for term in found.terms:
            assert (arb(term.coefficient) * number_of(term.constants)).overlaps(expected[term.power])
    # As text they are left to the ring, which knows their relations.
    assert set(found.by_octant().values()) == {None}


def test_functions_of_the_height_are_no_part_of_the_energy():
    G = judged(DOUBLE, expression("(2*g1^2+g3^2)*(cos(3*g2) + exp(-g2^2)*g2) - g1")).energy
    assert [(term.coefficient, term.power) for term in G.terms] == [(fmpq(1, 2), fmpq(2))]
    alone = judged(DOUBLE, expression("cos(3*g2)"))
    # A cosine may hide a relation: that is for others to say.
    assert alone.energy is None
    assert not alone.is_refuted


def test_fractional_powers_of_the_height_are_proved_but_not_refuted():
    k = Fraction(17384615384615387, 10**16)
    assert judged(DOUBLE, expression("(2*g1^2+g3^2)*(g2^2)^k", k=k)).energy.terms == ()
    alone = judged(DOUBLE, expression("(g2^2)^k", k=k))
    assert alone.energy is None
    assert not alone.is_refuted


def test_functions_of_the_height_and_of_its_absolute_value_are_two():
    # exp(g2) - exp|g2| is 0 for g2 > 0 only.
    found = judged(DOUBLE, expression("exp(g2) - exp(sqrt(g2^2)) + g1"))
    assert found.energy is None
    assert not found.is_refuted


@pytest.mark.parametrize(
    "text", ["log(g1)*g1", "g1/g2", "abs(g2)", "g1/(2*g1^2+g3^2)", "sin(g1)", "(2*g1)^k"]
)
def test_others_are_no_sums_of_powers(text):
    with pytest.raises(NotAMonomialSumError):
        judged(DOUBLE, expression(text, k="1/3"))


def test_the_square_of_the_momentum_is_that_of_the_potential():
    body, potential = POTENTIALS["homogeneous"]
    A, C = float(body.A), float(body.C)
    terms = judged(body, potential).squared_momentum()
    for g1, g2, g3 in [(0.3, 0.5, 0.81), (0.6, -0.64, 0.48)]:
        sign = -1.0 if g2 < 0.0 else 1.0
        found = sum(
            float(arb(c)) * g1 ** float(arb(a)) * abs(g2) ** float(arb(b)) * g3 ** float(arb(d)) * sign**odd
            for c, a, b, d, _, odd, _, _ in terms
        )
        gradient = potential.gradient_at(g1, g2, g3)
        p_squared = C * g3 * (g1 * gradient[2] - g3 * gradient[0]) / ((A - C) * A * g1)
        # Some twenty terms of the order of 10, each rounded a few times.
        assert found * C / (A * (A - C)) == pytest.approx(p_squared, rel=1e-12)
