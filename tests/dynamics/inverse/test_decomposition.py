"""V = V1[F] + Q G: what was put together is taken apart, and what was taken apart gives V again."""

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from itertools import islice

import numpy as np
import pytest
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.errors import EqualMomentsError
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import Tape, compile_tape
from service.dynamics.inverse.decomposition import Decomposition, NoDecompositionError, Terms, decompose
from service.dynamics.potentials.families.coefficients import homogeneous_potential
from service.dynamics.potentials.families.general_solution import SIGNS
from service.dynamics.potentials.families.written import general_potential
from service.dynamics.verdict.sphere.boxes import Point, sphere_points
from tests.dynamics.inverse.random_potentials import cases, points
from tests.dynamics.verdict.formulas import EIGHT_PARAMETERS, EIGHT_TERMS, U, W, body, potential
from tests.support.effort import seldom
from tests.support.witnesses.angular_part import reconstruct

EXACT_POINTS = list(islice(sphere_points(), 8, 16))
"""Rational points of the sphere, one in each octant."""


def without_formulas(found: Decomposition) -> Decomposition:
    return replace(found, F=dict.fromkeys(found.F), G=dict.fromkeys(found.G))


def departure(found: Decomposition, gamma: NDArray[np.float64]) -> float:
    """The largest departure of V1 + Q G from V, relative to max(1, |V|, |Q G|)."""
    A, C = float(found.body.A), float(found.body.C)
    scale = np.maximum(1.0, np.abs(found.potential.value(gamma)))
    for quadrant, (first, third) in SIGNS.items():
        here = (first * gamma[:, 0] > 0) & (third * gamma[:, 2] > 0)
        G = found.G_at(quadrant, gamma[here, 1]).value
        scale[here] = np.maximum(scale[here], np.abs((A * gamma[here, 0] ** 2 + C * gamma[here, 2] ** 2) * G))
    return float(np.max(reconstruct(found, gamma).error / scale))


def exact_departure(found: Decomposition, point: Point) -> arb:
    """Return a bound of |V1 + Q G - V| / max(1, |V|) at an exact point of the sphere, from the formulas."""
    again = general_potential(found.body, found.F, found.G, {}, found.reference_angle)
    with ctx.workprec(128):
        g1, g2, g3 = (BallAlgebra().constant(coordinate) for coordinate in point)
        exact = found.potential.value_ball(g1, g2, g3)
        difference = again.value_ball(g1, g2, g3) - exact
        return difference.abs_upper() / max(arb(1), exact.abs_upper())


@pytest.mark.parametrize("seed", [*seldom(0), 1, *seldom(*range(2, 8))])
def test_random_potentials_are_taken_apart_and_put_together(seed):
    gamma = points(8, seed)
    for number, (on, V) in enumerate(cases(25, seed)):
        found = decompose(on, V)
        # A bound from balls of 128 bits, 1e-38; V1 and Q G may be 1e6 times V (powers up to 12).
        assert exact_departure(found, EXACT_POINTS[number % 8]) < 1e-28
        # In doubles powers up to 12 and logarithms of some units make 1e-14 of the rounding of F's argument;
        # the points are on the sphere to 1e-16 only, which V1 and Q G feel alike.
        assert departure(found, gamma) < 1e-12
        if number % 8 == 0:
            assert departure(without_formulas(found), gamma[:3]) < 1e-12


@pytest.mark.parametrize("seed", [100, *seldom(101)])
def test_computed_values_and_formulas_agree_within_their_errors(seed):
    w, g2 = np.array([1e-9, 0.02, 0.7, 5.0, 1e9]), np.array([-0.99, -0.4, 0.0, 0.3, 0.999])
    for on, V in cases(6, seed):
        found = decompose(on, V)
        computed = without_formulas(found)
        for quadrant in SIGNS:
            for one, other in (
                (found.F_at(quadrant, w), computed.F_at(quadrant, w)),
                (found.G_at(quadrant, g2), computed.G_at(quadrant, g2)),
            ):
                # The errors are bounds: no allowance is needed.
                assert np.all(np.abs(one.value - other.value) <= one.error + other.error)
                assert np.all(other.error <= 1e-15 * np.maximum(np.abs(other.value), 1e-30))


@pytest.mark.parametrize("w", [1e-200, 1e200])
def test_F_is_computed_at_the_ends_of_the_range_of_doubles(w):
    V = potential("3*abs(g1)^(4/3) - 1/7/g3^4", on := body(3))
    # H[|g1|^(4/3)] = -λ²/3, H[1/g3^4] = -3 λ^(-6) and w = 2² λ^6.
    expected = (w / 4) ** (1 / 3) - 3 / 7 * (w / 4) ** -1
    found = without_formulas(decompose(on, V)).F_at("pp", w)
    assert found.error <= 1e-15 * abs(found.value)
    assert found.value == pytest.approx(expected, rel=1e-13)  # a power 1/3 of 1e200 in doubles: 460 ulp
    assert found.value.shape == ()


def formulas(text: str, on_moment: str = "2", C: str = "1") -> tuple[Mapping[str, str | None], ...]:
    on = body(on_moment, C)
    found = decompose(on, potential(text, on))
    return found.F, found.G


def test_what_is_independent_of_signs_is_one_formula():
    F, G = formulas("(A*g1^2 + C*g3^2)*(g2^2 - 1/2)", "3", "2")
    assert set(F.values()) == {"0"}
    assert set(G.values()) == {"g2^2 - 1/2"}


@pytest.mark.parametrize(
    ("text", "G"),
    [
        ("(A*g1^2 + C*g3^2)*(1 - g2^2)*g2", "-g2^3 + g2"),
        ("(A*g1^2 + C*g3^2)*(g2 + g1^2 + g2^2 + g3^2)", "g2 + 1"),
        ("(A*g1^2 + C*g3^2)*sqrt(g1^2 + g3^2)", "(1 - g2^2)^(1/2)"),
        ("(A*g1^2 + C*g3^2)/(1 - g2^2)*g2^3", "-g2 + g2*(1 - g2^2)^-1"),
        ("g1^2 - g2^2", "1 - 2/3*(1 - g2^2)^-1"),
        ("(A*g1^2 + C*g3^2)*exp(g2/2)", "exp(1/2*g2)"),
        ("(A*g1^2 + C*g3^2)*pi/(2 + g2)", "pi*(g2 + 2)^-1"),
        ("(A*g1^2 + C*g3^2)*(g2*sin(g2 - 2*g2^2) + abs(g2)^(1/3))", "g2*sin(-2*g2^2 + g2) + abs(g2)^(1/3)"),
    ],
)
def test_G_is_written_simply(text, G):
    assert set(formulas(text)[1].values()) == {G}


@pytest.mark.parametrize("C", ["1", "4", "2/3"])
@pytest.mark.parametrize(("n", "factor"), [(1, "1/2"), (2, "-1/2"), (3, "-3/2")])
def test_F_of_the_terms_that_are_odd_in_g1_has_the_sign_of_g1(n, factor, C):
    # k_n = u_n (3 - 2n)/(2 C^(n-1/2)).
    F, _ = formulas(U(n), str(2 * Fraction(C)), C)
    for quadrant, (sign, _) in SIGNS.items():
        expected = f"{sign}*({factor})/({C})^({Fraction(2 * n - 1, 2)})*w^({Fraction(2 * n - 1, 2)})"
        assert_same(F[quadrant], expected)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_F_of_the_terms_in_powers_of_g3_is_a_power_of_w(n):
    # l_n = (n + 1) C^n w_n.
    F, _ = formulas(W(n), "3", "3/2")
    for quadrant in SIGNS:
        assert_same(F[quadrant], f"{n + 1}*(3/2)^{n}*w^(-{n})")


def assert_same(text: str | None, expected: str) -> None:
    assert text is not None
    with ctx.workprec(128):
        for w in (arb("0.3"), arb("7.5")):
            values = [tape_of(formula).evaluate(BallAlgebra(), (w,)) for formula in (text, expected)]
            assert values[0].overlaps(values[1])


def tape_of(text: str) -> Tape:
    return compile_tape(parse(text), ("w",))


def test_the_coefficients_of_the_paper_are_read():
    on = body(2)
    terms = decompose(on, potential(EIGHT_TERMS, on, EIGHT_PARAMETERS)).terms["mm"]
    a1, a2, a3, b1, b2, b3, c1, c2 = EIGHT_PARAMETERS.values()
    # c_1 (g1² - g2²) = c_1 (2 g1² + g3² - 1); the a_n-terms are odd in g1;
    # a_3 belongs to -U_3, b_2 to 2 W_2, b_3 to 5 W_3.
    assert terms == Terms(
        -c1, (c1, Fraction(0), c2), (-a1, Fraction(0), -a2, Fraction(0), a3), (b1, 2 * b2, 5 * b3), ()
    )


HOMOGENEOUS = [
    ("17/10", {"A": "1 -2/3 0 4", "B": "1/2 3", "C": "-1/7 0 5"}),
    ("3/5", {"A": "0 2", "B": "2 1/3", "C": "1"}),
    ("3", {"A": "1", "B": "2 -1", "C": "1 2", "log": "0 0 3/4"}),
    ("2", {"A": "-3/8 1", "B": "1 0 -2", "C": "2", "log": "0 5 0 1/3"}),
    ("3/2", {"B": "1 4", "C": "2", "log": "0 0 1 0 0 1/5"}),
    ("1/2", {"A": "0 1", "B": "1 2", "C": "3", "log": "0 1"}),
    ("2/3", {"A": "2 1", "B": "0 2", "C": "0 1", "log": "0 0 -7"}),
]


@pytest.mark.one_in(3)
@pytest.mark.parametrize(("alpha", "texts"), HOMOGENEOUS)
def test_the_coefficients_of_the_homogeneous_family_are_read(alpha, texts):
    on = body(3 * Fraction(alpha), 3)
    lists = {name: [Fraction(value) for value in text.split()] for name, text in texts.items()}
    found = decompose(on, homogeneous_potential(on, **lists))
    expected = Terms(Fraction(0), *(tuple(lists.get(name, ())) for name in ("A", "B", "C", "log")))
    assert set(found.terms.values()) == {expected}
    gamma = points(5, 3)
    assert departure(found, gamma) < 1e-12  # as above
    assert departure(without_formulas(found), gamma[:2]) < 1e-12


def test_an_F_that_is_zero_is_computed_as_zero():
    on = body(2)
    found = without_formulas(decompose(on, potential("(A*g1^2 + C*g3^2)*exp(g2)", on)))
    F = found.F_at("mm", [0.1, 3.0])
    assert np.all(F.value == 0.0)
    assert np.all(F.error < 1e-100)  # balls of 384 bits
    assert departure(found, points(8, 4)) < 1e-15  # nothing but Q G


def test_signs_are_read_in_each_quadrant():
    on = body(3)
    found = decompose(on, potential("abs(g1)^(4/3)*(2 + g1/abs(g1) + 5*g3/abs(g3))", on))
    assert [found.terms[quadrant].B for quadrant in SIGNS] == [(8,), (6,), (-2,), (-4,)]


def test_a_constant_is_an_energy_and_no_term():
    on = body(3)
    found = decompose(on, potential("5 + (A*g1^2 + C*g3^2)*g2", on))
    assert set(found.terms.values()) == {Terms(Fraction(5), (Fraction(0), Fraction(1)), (), (), ())}
    assert set(found.F.values()) == {"-5"}


@pytest.mark.parametrize(
    "text", ["pi*g1", "2^(1/3)*g1", "g1 + (A*g1^2 + C*g3^2)*exp(g2)", "(A*g1^2+C*g3^2)*abs(g2)"]
)
def test_what_is_no_sum_of_the_known_terms_has_formulas_all_the_same(text):
    on = body(2)
    found = decompose(on, potential(text, on))
    assert set(found.terms.values()) == {None}
    assert None not in (*found.F.values(), *found.G.values())
    assert departure(found, points(8, 5)) < 1e-13  # powers 1 and 2 only


def test_quadrants_without_values_have_no_functions():
    on = body(2)
    found = decompose(on, potential("sqrt(g1)^2", on))
    assert set(found.F) == set(found.G) == set(found.terms) == {"pp", "pm"}
    gamma = points(20, 7)
    assert np.array_equal(np.isnan(reconstruct(found, gamma).value), gamma[:, 0] < 0)


def test_an_energy_with_two_values_is_refused():
    on = body(2)
    with pytest.raises(NoDecompositionError):
        decompose(on, potential("g1*g2/abs(g2)", on))
    # Nothing is proved of what is not admissible; the two energies are met when F is asked for.
    found = decompose(on, potential("g1*g2 + g3", on))
    assert set(found.F.values()) == {None}
    with pytest.raises(NoDecompositionError) as refusal:
        found.F_at("pp", 0.5)
    assert refusal.value.code == "no_decomposition"


def test_the_general_family_is_decomposed_as_it_was_stated():
    on = body(3)
    V = general_potential(on, "exp(-w)", {"pp": "1", "mp": "g2", "pm": "g2^2", "mm": "0"}, {}, "pi/3")
    found = decompose(on, V)
    assert set(found.F.values()) == {"exp(-w)"}
    assert found.G["pm"] == "g2^2"
    assert found.reference_angle == "pi/3"
    assert departure(found, points(8, 9)) < 1e-13  # the same quadrature


def test_equal_moments_are_refused():
    on = body(2, 2)
    with pytest.raises(EqualMomentsError):
        decompose(on, potential("g1", on))
