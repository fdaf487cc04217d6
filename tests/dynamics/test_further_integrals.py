"""The integrals of Kovalevskaya, Goriachev and Chaplygin: exact derivatives, recognition, drifts."""

from fractions import Fraction

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.body import RigidBody
from service.dynamics.equations.euler_poisson import areas_integral
from service.dynamics.further_integrals import (
    FurtherIntegral,
    find_further_integrals,
    integral_drift,
)
from service.dynamics.potentials.families.coefficients import gravity_potential, rational_potential
from service.dynamics.potentials.families.written import expression_potential
from service.dynamics.potentials.potential import NoClosedFormError
from tests.support.effort import examples
from workers.solvers.integration.solve import integrate_state

C = Fraction(17, 10)
BODY = RigidBody(2 * C, 2 * C, C)
UNIT = RigidBody(Fraction(2), Fraction(2), Fraction(1))
LONG = RigidBody(4 * C, 4 * C, C)
"""A body with A = B = 4C."""
FULL = "a*g1 + b*g2 + c1*(g1^2 - g2^2) + 2*c2*g1*g2 + b1/g3^2"
ZERO = Fraction(0)

NUMBERS = st.fractions(-3, 3, max_denominator=20)


def field(text=FULL, *, body=BODY, **parameters):
    named = {name: Fraction(parameters.get(name, 0)) for name in ("a", "b", "c1", "c2", "b1")}
    return expression_potential(text, named, body)


def found(text, *, body=BODY, g1_sign=None, **parameters):
    integrals = find_further_integrals(body, field(text, body=body, **parameters), g1_sign=g1_sign)
    return [(i.name, i.kind, i.a, i.b, i.c1, i.c2, i.b1) for i in integrals]


# --- the exact derivatives ------------------------------------------------------------

SYMBOLS = sp.symbols("p q r g1 g2 g3 C a b c1 c2 b1", real=True)
p, q, r, g1, g2, g3, c, a, b, c1, c2, b1 = SYMBOLS
V = a * g1 + b * g2 + c1 * (g1**2 - g2**2) + 2 * c2 * g1 * g2 + b1 / g3**2
W = (
    (p + sp.I * q) ** 2
    - (a + sp.I * b) * (g1 + sp.I * g2) / c
    + (c1 + sp.I * c2) * g3**2 / c
    - b1 * (g1 + sp.I * g2) ** 2 / (c * g3**2)
)
AREAS = 2 * c * p * g1 + 2 * c * q * g2 + c * r * g3


def rate(quantity, V=V, ratio=2):
    """The derivative along the Euler-Poisson equations with A = B = ``ratio`` C."""
    V1, V2, V3 = (sp.diff(V, g) for g in (g1, g2, g3))
    equations = {
        p: ((ratio - 1) * c * q * r + g2 * V3 - g3 * V2) / (ratio * c),
        q: ((1 - ratio) * c * p * r + g3 * V1 - g1 * V3) / (ratio * c),
        r: (g1 * V2 - g2 * V1) / c,
        g1: r * g2 - q * g3,
        g2: p * g3 - r * g1,
        g3: q * g1 - p * g2,
    }
    return sum(sp.diff(quantity, x) * derivative for x, derivative in equations.items())


def on_the_sphere(quantity):
    """The numerator, with g2² replaced by 1 - g1² - g3²: zero only if the quantity vanishes there."""
    numerator = sp.Poly(sp.fraction(sp.together(sp.expand(quantity)))[0], g2)
    return sp.expand(sp.rem(numerator, sp.Poly(g2**2 - (1 - g1**2 - g3**2), g2)).as_expr())


def test_W_turns_at_the_rate_of_the_body_where_the_areas_integral_is_zero():
    at_zero_areas = {r: -2 * (p * g1 + q * g2) / g3}
    assert on_the_sphere((rate(W) + sp.I * r * W).subs(at_zero_areas)) == 0


def test_K_is_constant_for_linear_fields_and_else_changes_with_the_areas():
    K = sp.expand(sp.re(W) ** 2 + sp.im(W) ** 2)
    change = rate(K)
    assert on_the_sphere(change.subs({c1: 0, c2: 0, b1: 0})) == 0
    # Proportional to the areas integral, each of the three terms by itself: none can do without it.
    for kept in (c1, c2, b1):
        alone = on_the_sphere(change.subs({x: 0 for x in (c1, c2, b1) if x != kept}))
        assert alone != 0
        assert on_the_sphere(sp.rem(sp.Poly(alone, r), sp.Poly(AREAS, r)).as_expr()) == 0


LONG_V = a * g1 + b * g2 + b1 / g3**2
LONG_K = r * (p**2 + q**2 + b1 / (2 * c * g3**2)) - g3 * (a * p + b * q) / c
LONG_AREAS = 4 * c * p * g1 + 4 * c * q * g2 + c * r * g3


def test_the_integral_of_goriachev_and_chaplygin_changes_with_the_areas_alone():
    """A = B = 4C; the rate is the multiple of the areas integral that the module states, everywhere."""
    assert sp.simplify(rate(LONG_K, LONG_V, 4) - (b * p - a * q) / (4 * c**2) * LONG_AREAS) == 0
    # No other ratio of the moments will do, also where the areas integral is zero.
    other = rate(LONG_K, LONG_V, 3).subs(r, -3 * (p * g1 + q * g2) / g3)
    assert on_the_sphere(other) != 0


@pytest.mark.parametrize(
    ("body", "text", "function"), [(BODY, FULL, W * sp.conjugate(W)), (LONG, "a*g1 + b*g2 + b1/g3^2", LONG_K)]
)
def test_the_numbers_are_those_of_the_formula(body, text, function):
    """In doubles and in balls: K by SymPy at a rational point."""
    values = [Fraction(n, 7) for n in (3, -2, 5, 6, 2, -3)]
    fifths = {"a": -3, "b": 2, "c1": 1, "c2": -4, "b1": 3}
    parameters = {name: Fraction(n, 5) for name, n in fifths.items()}
    (integral,) = find_further_integrals(body, field(text, body=body, **parameters))
    numbers = dict(
        zip(
            SYMBOLS,
            (sp.Rational(x.numerator, x.denominator) for x in (*values, C, *parameters.values())),
            strict=True,
        )
    )
    exact = float(sp.expand(function.subs(numbers)))
    state = np.array([float(x) for x in values])
    # Some thirty roundings of terms of the size of W, squared.
    assert float(integral(state[:3], state[3:])) == pytest.approx(exact, rel=2e-14)
    # The state's own roundings remain.
    assert integral_drift(integral, state[None])[0] == pytest.approx(exact, rel=2e-15)


# --- recognition ----------------------------------------------------------------------


@settings(max_examples=examples(8, 25), deadline=None)
@given(st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS, NUMBERS))
def test_any_way_to_write_the_field_is_recognised(numbers):
    parameters = dict(zip(("a", "b", "c1", "c2", "b1"), numbers, strict=True))
    kind = ("goriachev", "zero_areas") if any(numbers[2:]) else ("kovalevskaya", "general")
    for text in (
        FULL,
        "c1*(2*g1^2 + g3^2) + 2*g2*(c2*g1 + b/2) + a*g1*(g1^2 + g2^2 + g3^2) + b1*g3^(-2) + pi*(7/3 - 7/3)",
        "(a*g1^3 + b*g2*g1^2 + c1*g1^2*(1 - g3^2 - 2*g2^2) + 2*c2*g2*g1^3)/g1^2 + b1/(1 - g1^2 - g2^2) - 5",
        "a*g1 + b*g2 + c1*(1 - g3^2 - 2*sqrt(g2^2)^2) + 2*c2*g1*g2 + b1*abs(g3)^(-2) + g1^2 + g2^2 + g3^2",
    ):
        assert found(text, **parameters) == [(*kind, *numbers)]


@pytest.mark.parametrize(
    "text",
    [
        "g3",  # Lagrange's field
        "g1^2",  # quadratic, but not harmonic in g1, g2
        "g1^2 - g3^2",
        "g1*g3",
        "g1^3",
        "1/g3",
        "g1/g2",
        "g1 + 1/g1^2",
        "sin(g1)",
        "pi*g1",  # no exact rational
        "abs(g1)",  # two fields
        "log(g3)",
        "log(-1 - g1^2)",  # no field at all
        "(g1 + g2 + g3)^100",
    ],
)
def test_other_fields_have_none(text):
    assert found(text) == []


@pytest.mark.parametrize(
    "text", ["a*g1*(g1^2 + g2^2 + g3^2) + b*g2 + b1*g3^(-2) - 5", "a*abs(g1) + b*g2 + b1/g3^2"]
)
@pytest.mark.parametrize(("a", "b", "b1"), [(-1, 0, 0), (0, 2, Fraction(1, 3)), (1, -2, 3), (0, 0, 1)])
def test_the_field_of_goriachev_and_chaplygin_is_recognised(text, a, b, b1):
    # Without a force across the axis of symmetry, r and the energy are constant always.
    kind = "zero_areas" if a or b else "general"
    expected = [("goriachev_chaplygin", kind, a, b, 0, 0, b1)]
    assert found(text, body=LONG, g1_sign=1, a=a, b=b, b1=b1) == expected


@pytest.mark.parametrize(
    "text", ["g1 + g1*g2", "g1 + g1^2 - g2^2", "g3", "g1/g3^2", "g1 + 1/g3^4", "abs(g1)"]
)
def test_other_fields_have_none_with_these_moments(text):
    assert found(text, body=LONG) == []


@pytest.mark.parametrize(
    "moments",
    [("2", "1", "1"), ("2", "3/2", "1"), ("3", "3", "1"), ("1", "2", "2"), ("4", "2", "1"), ("1", "4", "4")],
)
def test_other_bodies_have_none(moments):
    body = RigidBody(*(Fraction(moment) for moment in moments), allow_unphysical=True)
    assert found("g1", body=body) == []
    assert found("g1", body=RigidBody(Fraction(2), None, Fraction(1))) == []


class GivenByAnIntegral:
    @property
    def tape(self):
        raise NoClosedFormError("no formula")


def test_potentials_without_a_formula_have_none():
    assert find_further_integrals(BODY, GivenByAnIntegral()) == ()


def test_fields_with_signs_are_recognised_where_the_sign_is_kept():
    """The homogeneous family writes |g1| and |g3|: a g1 for one sign of g1."""
    text = "a*abs(g1) + b1*abs(g3)^(-2) + c1*(2*g1^2 + g3^2)"
    numbers = {"a": -1, "b1": Fraction(1, 20), "c1": 2}
    assert found(text, **numbers) == []
    for sign in (1, -1):
        expected = ("goriachev", "zero_areas", -sign, 0, 2, 0, Fraction(1, 20))
        assert found(text, g1_sign=sign, **numbers) == [expected]
    # A root that is defined for one sign of g1 only says which one.
    assert found("sqrt(g1)^2") == [("kovalevskaya", "general", 1, 0, 0, 0, 0)]
    assert found("g3^2/abs(g3)*g1/abs(g3)*abs(g3)/sqrt(g3^2)") == [("kovalevskaya", "general", 1, 0, 0, 0, 0)]


def test_the_rational_family_has_it_up_to_its_first_terms():
    one, two = Fraction(1), Fraction(2)
    (integral,) = find_further_integrals(UNIT, rational_potential([-one], [one / 20], [two]))
    assert (integral.name, integral.a, integral.b1, integral.c1) == ("goriachev", -1, one / 20, 2)
    assert find_further_integrals(UNIT, rational_potential([-one, one], [], [])) == ()


# --- along motions ---------------------------------------------------------------------


def scale(integral: FurtherIntegral, samples):
    """The size of the squares whose sum K is."""
    terms = np.hypot(samples[:, 0], samples[:, 1]) ** 2 + (
        abs(float(integral.a)) + abs(float(integral.b)) + abs(float(integral.c1)) + abs(float(integral.c2))
    ) / float(integral.C)
    terms += abs(float(integral.b1)) / (float(integral.C) * samples[:, 5] ** 2) if integral.b1 else 0.0
    return float(terms.max() ** 2)


STATES = [
    ((0.4, -0.3, 0.8), (6 / 7, 2 / 7, -3 / 7)),
    ((1.5, 0.7, -0.2), (0.0, 0.6, 0.8)),
    ((0.0, 0.0, 2.5), (0.48, -0.64, 0.6)),
]


@pytest.mark.parametrize("omega", [state[0] for state in STATES])
def test_linear_fields_keep_K_along_any_motion(omega):
    gamma = (Fraction(6, 7), Fraction(2, 7), Fraction(-3, 7))
    potential = gravity_potential(Fraction(-1), Fraction(2, 5), ZERO)
    (integral,) = find_further_integrals(BODY, potential)
    motion = integrate_state(BODY, potential, omega, gamma, np.linspace(0, 40, 201), tolerance=1e-10)
    value, drift = integral_drift(integral, motion.samples)
    assert value == pytest.approx(
        float(integral(np.array(omega), np.array([float(g) for g in gamma]))), rel=1e-14
    )
    # Local errors of 1e-14 of some five hundred steps.
    assert drift < 1e-12 * scale(integral, motion.samples)


@pytest.mark.parametrize(("omega", "gamma"), STATES)
def test_zero_areas_keep_K_in_the_full_field(omega, gamma):
    potential = field(a=-1, b=Fraction(2, 5), c1=Fraction(1, 2), c2=Fraction(-1, 3), b1=Fraction(1, 20))
    (integral,) = find_further_integrals(BODY, potential)
    at_zero = (*omega[:2], -2 * (omega[0] * gamma[0] + omega[1] * gamma[1]) / gamma[2])
    times = np.linspace(0, 40, 201)
    motion = integrate_state(BODY, potential, at_zero, gamma, times, tolerance=1e-10)
    _, drift = integral_drift(integral, motion.samples)
    assert drift < 1e-12 * scale(integral, motion.samples)
    # Elsewhere the same function wanders by a part of itself: it is no integral there.
    elsewhere = integrate_state(
        BODY, potential, (*omega[:2], at_zero[2] + 1.0), gamma, times, tolerance=1e-10
    )
    assert abs(float(areas_integral(BODY, elsewhere.samples[0, :3], elsewhere.samples[0, 3:]))) > 0.3
    assert integral_drift(integral, elsewhere.samples)[1] > 1e-2


@pytest.mark.parametrize(("omega", "gamma"), [*STATES[:2], ((0.7, -1.1, 0.0), (6 / 7, 2 / 7, -3 / 7))])
@pytest.mark.parametrize("b1", [0, Fraction(1, 20)])
def test_zero_areas_keep_the_integral_of_goriachev_and_chaplygin(omega, gamma, b1):
    potential = field("a*g1 + b*g2 + b1/g3^2", body=LONG, a=-1, b=Fraction(2, 5), b1=b1)
    (integral,) = find_further_integrals(LONG, potential)
    at_zero = (*omega[:2], -4 * (omega[0] * gamma[0] + omega[1] * gamma[1]) / gamma[2])
    times = np.linspace(0, 40, 201)
    motion = integrate_state(LONG, potential, at_zero, gamma, times, tolerance=1e-10)
    value, drift = integral_drift(integral, motion.samples)
    # Local errors of 1e-14 of some five hundred steps, of a cubic of the size of its terms.
    p, q, r, *_, g3 = np.abs(motion.samples).T
    size = (r * (p**2 + q**2 + float(b1) / (2 * float(C) * g3**2)) + g3 * (p + q) / float(C)).max()
    assert drift < 1e-12 * size
    assert abs(value) > 1e-3 * size
    # On another level it wanders.
    elsewhere = integrate_state(
        LONG, potential, (*omega[:2], at_zero[2] + 1.0), gamma, times, tolerance=1e-10
    )
    assert integral_drift(integral, elsewhere.samples)[1] > 1e-2


@pytest.mark.parametrize(
    ("nu", "C", "expected"), [("1", "1", 1.0125), ("13/10", "17/10", 0.41940173215126635409)]
)
def test_K_on_the_planar_family(nu, C, expected):
    """K = (nu² + 4)(a1 nu + 2 b1)² / (4 C² nu²), whatever c1: a1 = -1, b1 = 1/20, c1 = 1/2."""
    body = RigidBody(2 * Fraction(C), 2 * Fraction(C), Fraction(C))
    potential = rational_potential([Fraction(-1)], [Fraction(1, 20)], [Fraction(1, 2)])
    (integral,) = find_further_integrals(body, potential)
    # Along |g3| = sqrt(nu g1) with s² = D / ((A-C) A C g1 g3), p = -C g3 s, r = A g1 s.
    x1 = 2 / (float(Fraction(nu)) + np.sqrt(float(Fraction(nu)) ** 2 + 4))
    x = np.linspace(0.3, 1.0, 29) * x1
    x3 = np.sqrt(float(Fraction(nu)) * x)
    gamma = np.stack([x, np.sqrt(np.maximum(1 - x**2 - x3**2, 0.0)), x3], axis=-1)
    m = float(body.C)
    s = np.sqrt(potential.D(gamma) / (2 * m**3 * x * x3))
    omega = np.stack([-m * x3 * s, 0 * s, 2 * m * x * s], axis=-1)
    # Some thirty roundings, squared.
    assert integral(omega, gamma) == pytest.approx(np.full(len(x), expected), rel=1e-14)
    value, drift = integral_drift(integral, np.hstack([omega, gamma]))
    assert value == pytest.approx(expected, rel=1e-14)
    assert drift < 1e-14


def test_a_pole_of_the_field_is_left_out():
    (integral,) = find_further_integrals(UNIT, field(body=UNIT, a=-1, b1=1))
    rows = np.array([[1.0, 0, 0, 0.6, 0, 0.8], [1.0, 0, 0, 1, 0, 0], [1.0, 0, 0, 0.6, 0, 0.8]])
    assert np.isnan(integral(rows[:, :3], rows[:, 3:])).tolist() == [False, True, False]
    assert integral_drift(integral, rows)[1] == 0.0
