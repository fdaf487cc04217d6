"""The logarithmic solutions: golden residues, the printed example, H, and where there are any."""

from fractions import Fraction
from itertools import product

import pytest
from flint import arb, ctx

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.potentials.families.coefficients import homogeneous_potential
from service.dynamics.potentials.terms import (
    NoLogTermError,
    energy_of_log,
    log_term,
    multiplicity,
    partial_fractions,
)
from service.dynamics.verdict.verdict import decide
from tests.support.planar import body

# (α, m) and the residue at t = 1, which multiplies the logarithm.
RESIDUES = [
    ("2", 1, "1"),
    ("3", 1, "8"),
    ("2", 2, "-6"),
    ("3/2", 2, "-1"),
    ("4", 1, "81"),
    ("5/2", 2, "-81/2"),
    ("3/2", 4, "-5"),
]


def index(alpha: Fraction, m: int) -> int:
    return int(alpha * m) - 1


def potential_of(alpha: Fraction, n: int):
    rigid_body = body(alpha.numerator, alpha.denominator)
    return rigid_body, homogeneous_potential(rigid_body, log=[Fraction(0)] * n + [Fraction(1)])


@pytest.mark.parametrize(("alpha", "m", "residue"), RESIDUES)
def test_residues(alpha: str, m: int, residue: str) -> None:
    ratio = Fraction(alpha)
    for exchanged in (ratio, 1 / ratio):
        assert multiplicity(exchanged, index(ratio, m)) == m
        assert log_term(exchanged, index(ratio, m)).residue == Fraction(residue)


@pytest.mark.parametrize(("alpha", "m", "_"), RESIDUES)
def test_the_partial_fractions_are_the_integrand(alpha: str, m: int, _: str) -> None:
    ratio = Fraction(alpha)
    N = int(ratio * m)
    polynomial, double, poles = partial_fractions(ratio, N, m)
    # Times t² (t-1)^m both sides are polynomials of degree at most N: N + 1 values decide.
    for t in (Fraction(k, 2) for k in range(3, 4 + N)):
        parts = sum((factor * t**i for i, factor in enumerate(polynomial)), double / t**2)
        parts += sum(factor / (t - 1) ** k for k, factor in enumerate(poles, start=1))
        # There is no term in 1/t: the residue at 0 vanishes.
        assert parts == (ratio - t) ** N / (t - 1) ** m / t**2


def test_the_example_with_alpha_three() -> None:
    _, potential = potential_of(Fraction(3), 2)
    printed = compile_tape(
        parse(
            "16*(g1^2+g3^2)*(3*g1^2+g3^2)*log(abs(g1)) + 27*(g1^2+g3^2)^2 - (3*g1^2+g3^2)^2"
            " - 8*(g1^2+g3^2)*(3*g1^2+g3^2)*log(g1^2+g3^2)"
        )
    )
    with ctx.workprec(200):
        for signs in product((1, -1), repeat=3):
            point = [sign * arb(k) / 7 for sign, k in zip(signs, (2, 6, 3), strict=True)]
            difference = potential.value_ball(*point) - printed.evaluate(BallAlgebra(), point)
            # Terms up to 30, 200 bits: 190 bits behind the point are left at least.
            assert difference.contains(0)
            assert difference.abs_upper() < arb(2) ** -180


@pytest.mark.parametrize(("alpha", "m", "_"), RESIDUES)
@pytest.mark.parametrize("is_exchanged", [False, True])
def test_they_are_admissible_by_proof_with_the_printed_energy(
    alpha: str, m: int, _: str, is_exchanged: bool
) -> None:
    ratio = Fraction(alpha)
    n = index(ratio, m)
    # The printed -(α-1)^(m(α-1)) is rational: m (α-1) is the integer N - m.
    expected = -((ratio - 1) ** int(m * (ratio - 1)))
    if is_exchanged:
        ratio = 1 / ratio
    assert energy_of_log(ratio, n) == expected
    rigid_body, potential = potential_of(ratio, n)
    verdict = decide(rigid_body, potential)
    assert (verdict.verdict, verdict.proof) == ("admissible", "symbolic")
    with ctx.workprec(200):
        g1, g2, g3 = arb(2) / 7, arb(6) / 7, arb(3) / 7
        alpha_ball = BallAlgebra().constant(ratio)
        square = g3**2 / g1 ** (2 / alpha_ball)
        power = square ** (n + 1) if ratio > 1 else square ** (-alpha_ball * (n + 1))
        H = potential.H_ball(rigid_body, g1, g2, g3)
        assert H.overlaps(BallAlgebra().constant(expected) * power)
        # Terms up to 1e4 cancel: some 20 of the 200 bits.
        assert H.rad() < arb(2) ** -160


def test_they_are_there_where_a_series_has_a_gap_and_nowhere_else() -> None:
    ratios = {Fraction(p, q) for p in range(1, 9) for q in range(1, 9)} - {Fraction(1)}
    for alpha, n in product(ratios, range(6)):
        larger = max(alpha, 1 / alpha)
        if larger in {Fraction(n + 1, m) for m in range(1, n + 1)}:
            assert log_term(alpha, n).alpha == larger
        else:
            with pytest.raises(NoLogTermError) as caught:
                log_term(alpha, n)
            assert caught.value.pointer == f"/potential/log/{n}"


def test_the_message_names_the_moments_that_have_one() -> None:
    with pytest.raises(NoLogTermError, match="one of: 3, 3/2"):
        log_term(Fraction(17, 10), 2)
    with pytest.raises(NoLogTermError, match="one of: none"):
        log_term(Fraction(2), 0)
