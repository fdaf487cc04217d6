"""Across a kink V and the energy must be the same on both sides wherever a curve crosses it."""

from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.dynamics.verdict.formulas import body, potential, verdict_on
from tests.support.effort import examples
from tests.support.euler_poisson import integrate, planar_start

Q = "(2*g1^2 + g3^2)"
U = "(g1 - (2*g1^2 + g3^2)/(3/2*sqrt(2)*sqrt(g1^2 + g3^2)))"
"""Admissible for A = 2C, with H = -nu/2; zero on g1 = g3 > 0, which is no curve and no circle."""


def excludes_zero(ball) -> bool:
    return abs(Fraction(Decimal(ball.mid))) > Fraction(Decimal(ball.rad))


def test_a_kink_that_curves_cross_is_refuted_by_the_jump_of_the_energy():
    verdict = verdict_on(f"-3*g1 - abs{U}/10000")
    assert (verdict.verdict, verdict.proof) == ("inadmissible", "counterexample")
    jump = verdict.jump
    assert jump is not None
    assert jump.of == "energy"
    assert excludes_zero(jump.jump)
    g1, g2, g3 = map(Fraction, map(Decimal, jump.g))
    radius = Fraction(Decimal(jump.radius))
    # On the line, and on the sphere, as far as the radius says: three coordinates, squares of at most 1.
    assert abs(g1 - g3) <= 2 * radius
    assert abs(g1**2 + g2**2 + g3**2 - 1) <= 7 * radius
    # H = -nu/2 on one side and nu/2 on the other, nu = g3²/g1 = g1 there: the jump is nu/10000.
    expected = g1 / 10000
    assert abs(abs(Fraction(Decimal(jump.jump.mid))) - expected) <= Fraction(Decimal(jump.jump.rad)) + radius


@settings(max_examples=examples(4, 12), deadline=None)
@given(
    a=st.fractions(-3, 3, max_denominator=9),
    size=st.fractions(Fraction(1, 10**6), 3, max_denominator=10**6),
    power=st.integers(1, 5),
)
def test_powers_of_a_kink_are_judged_by_their_slope(a, size, power):
    # |U|^k is U^k on one side and ±U^k on the other. L(U) = 0, but for k > 1 L(U^k) ≠ 0.
    verdict = verdict_on(f"({a})*g1 + {size}*abs{U}^{power}")
    assert verdict.verdict == "inadmissible"
    assert (verdict.jump is not None) == (power == 1)


@settings(max_examples=examples(5, 15), deadline=None)
@given(
    place=st.fractions(Fraction(-9, 10), Fraction(9, 10), max_denominator=20),
    smooth=st.sampled_from(["g1", "1/g3^2", f"{Q}*g2^3", "g1^2 - g2^2"]),
    kink=st.sampled_from(
        ["abs(x)", "abs(x)^3", "sqrt(x^2)*x", "(abs(x) + x)^2", "(x^4)^(1/3)", "log(abs(3*x)/5)"]
    ),
)
def test_a_circle_is_harmless_for_random_admissible_potentials(place, smooth, kink):
    text = f"{smooth} + {Q}*({kink.replace('x', f'(g2 - ({place}))')})"
    assert verdict_on(text).verdict == "admissible"


@pytest.mark.parametrize(
    "text",
    [
        f"-g1 + {Q}*abs(g2 - 1/3)/(g2 - 1/3)",
        "-g1*abs(g2)/g2",
        "-g1*g2/sqrt(g2^2)",
        f"-g1 + {Q}*(g2 - 1/3)/abs(g2 - 1/3)*(2 + g2)",
        f"-g1 + {Q}*abs(3*g2 - 1)/(g2 - 1/3)",
        f"-g1 + {Q}*((g2 - 1/3)^4)^(1/4)/(g2 - 1/3)",
        f"-3*g1 - {U}*abs(g1 - g3)/(g1 - g3) - (g1 - 2*g3)*0 + g1*abs(g1 - 2*g3)/(g1 - 2*g3)",
    ],
)
def test_a_potential_that_jumps_is_refuted(text):
    verdict = verdict_on(text)
    assert verdict.verdict == "inadmissible"
    assert verdict.jump is not None
    assert excludes_zero(verdict.jump.jump)


def test_two_formulas_for_one_function_on_both_sides_of_a_line_are_admissible():
    # g1 + |x| - |x|·sign(x)·… with all that jumps cancelled: V is g1 everywhere.
    text = "-g1 + abs(g1 - g3) - (g1 - g3)*abs(g1 - g3)/(g1 - g3)"
    assert verdict_on(text).verdict == "admissible"


def test_a_jump_between_curves_is_crossed_by_none():
    # sign(nu - 1/2) is constant on every curve, and H with it.
    verdict = verdict_on("-g1 + abs(g3^2 - g1/2)/(g3^2 - g1/2)")
    assert verdict.verdict == "admissible"


@pytest.mark.parametrize("alpha", ["3", "17/10"])
def test_the_line_is_judged_for_any_ratio_of_moments(alpha):
    # |V| of an admissible V that changes its sign: both pieces are admissible, the kink is not.
    on = body(alpha)
    inner = f"(abs(g1)^(2*({alpha} - 1)/({alpha})) - (A*g1^2 + C*g3^2)*g2)"
    verdict = verdict_on(f"abs{inner}", on)
    assert verdict.verdict in ("inadmissible", "undecided")
    assert verdict_on(f"{inner}", on).verdict == "admissible"


def largest_q(text: str, h: float) -> float:
    """Return how far a motion that begins with q = 0 on nu = 1 departs from it, by an integrator."""
    V = potential(text)
    g = np.array([0.5, 0.5, 0.5**0.5])
    start = planar_start(2.0, 1.0, float(V.value(g)), h, g)
    states = integrate((2.0, 1.5, 1.0), V.gradient_at, start, 3.0)
    line = np.sign(states[4] - 1 / 3)
    assert {-1.0, 1.0} <= set(line)
    return float(np.abs(states[1]).max())


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("text", "h"),
    [
        (f"-g1 + {Q}*abs(g2 - 1/3)/5", 0.5),
        (f"-g1 + {Q}*(sqrt((g2 - 1/3)^2) + g2 - 1/3)^2", 0.5),
        (f"-g1 + {Q}*abs(sin(5*g2))/9", 0.5),
        ("-g1 + abs(g3^2 - g1/2)/(g3^2 - g1/2)/7", 0.5 + 1 / 7),
    ],
)
def test_what_is_called_admissible_keeps_q_zero_across_its_kinks(text, h):
    assert verdict_on(text).verdict == "admissible"
    # The integrator's own error, at kinks too; a jump of H by 1e-5 would make q some 1e-6.
    assert largest_q(text, h) < 1e-9


def test_what_is_refuted_by_a_jump_does_not_keep_q_zero():
    text = f"-3*g1 - abs{U}/10000"
    assert verdict_on(text).verdict == "inadmissible"
    V = potential(text)
    # On nu = 1/2, which crosses the line g1 = g3 at g1 = 1/2.
    g = np.array([0.3, 0.76**0.5, 0.15**0.5])
    h = float(V.H(body(2), g))
    states = integrate((2.0, 1.5, 1.0), V.gradient_at, planar_start(2.0, 1.0, float(V.value(g)), h, g), 3.0)
    assert np.abs(states[1]).max() > 1e-8
