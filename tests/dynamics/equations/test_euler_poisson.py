"""The signs of the equations, and their integrals stationary on random states."""

import operator
import re
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.equations import euler_poisson
from service.dynamics.equations.euler_poisson import (
    FourOperations,
    areas_integral,
    energy_integral,
    euler_poisson_rhs,
    geometric_integral,
    integrals_in,
    moments_of,
    rates_in,
)
from service.dynamics.errors import MissingMomentError
from service.dynamics.potentials.families.coefficients import gravity_potential, rational_potential
from service.dynamics.potentials.families.written import expression_potential
from service.dynamics.potentials.potential import Potential
from tests.support.formulas import POTENTIALS

FloatArray = NDArray[np.float64]

EPSILON = float(np.finfo(np.float64).eps)
BODY = RigidBody(Fraction(2), Fraction(17, 10), Fraction(1))
FIELD = expression_potential("-g1 + 1/(20*g3^2) + 0.3*g2^3", {}, BODY)

COEFFICIENTS = st.fractions(min_value=-2, max_value=2, max_denominator=50)
LISTS = st.lists(COEFFICIENTS, max_size=4)
FIELDS: st.SearchStrategy[Potential] = st.one_of(
    st.builds(gravity_potential, COEFFICIENTS, COEFFICIENTS, COEFFICIENTS),
    st.builds(rational_potential, LISTS, LISTS, LISTS),
    st.sampled_from(POTENTIALS).map(lambda text: expression_potential(text, {}, BODY)),
)
PARTS = st.floats(0.2, 1.0)
RATES = st.integers(-3000, 3000).map(lambda thousandths: thousandths / 1000)
"""Zero or of ordinary size: the squares of tiny rates would underflow in the bound itself."""


NUMBERS = st.fractions(min_value=-9, max_value=9, max_denominator=9)
EXACT: FourOperations[Fraction] = FourOperations(operator.add, operator.sub, operator.mul, operator.truediv)
OWN_EQUATIONS = {"workers/solvers/compiled/general/steps.py": "its sums of products share what they read"}
"""Other modules that write the six rates, and why they do."""


@given(st.lists(NUMBERS, min_size=9, max_size=9), st.lists(st.fractions(1, 9), min_size=3, max_size=3))
def test_the_integrals_are_stationary_exactly(numbers: list[Fraction], moments: list[Fraction]) -> None:
    """In rational numbers, for any slopes of V; each rate of an integral is that of its own formula."""
    state, slopes, zero = numbers[:6], numbers[6:], Fraction(0)
    A, B, C = moments
    body = RigidBody(A, B, C, allow_unphysical=True)
    rates = rates_in(EXACT)(moments_of(body), state, slopes)
    # Integrals are of the second degree but for V: the middle of two neighbours tells their derivative.
    before, after = ([x + sign * rate for x, rate in zip(state, rates, strict=True)] for sign in (-1, 1))
    gain = sum((slope * rate for slope, rate in zip(slopes, rates[3:], strict=True)), zero)
    ends = [
        integrals_in(EXACT)(moments_of(body), each, sign * gain, Fraction(1, 2))
        for each, sign in ((before, -1), (after, 1))
    ]
    assert ends[0] == ends[1]


def test_every_other_place_where_the_rates_are_written_is_listed_here() -> None:
    root = Path(euler_poisson.__file__).parents[3]
    sources = (path for folder in ("service", "workers") for path in (root / folder).rglob("*.py"))
    written = {
        path.relative_to(root).as_posix()
        for path in sources
        if re.search(r"\bq \* g3\b|\bg3 \* q\b", path.read_text(encoding="utf-8"))
    }
    assert written == set(OWN_EQUATIONS)


@settings(deadline=None)
@given(FIELDS, st.tuples(PARTS, PARTS, PARTS), st.tuples(RATES, RATES, RATES), st.tuples(PARTS, PARTS, PARTS))
def test_the_three_integrals_are_stationary(
    potential: Potential,
    gamma_parts: tuple[float, ...],
    omega_parts: tuple[float, ...],
    masses: tuple[float, ...],
) -> None:
    # Moments of a mass with these second moments, so that the triangle inequalities hold.
    x, y, z = (Fraction(mass) for mass in masses)
    body = RigidBody(y + z, z + x, x + y)
    inertia = np.array([float(body.A), float(body.require_B("a test")), float(body.C)])
    gamma, omega = np.array(gamma_parts), np.array(omega_parts)
    rates = euler_poisson_rhs(body, potential, omega, gamma)
    force = potential.gradient(gamma)

    energy = inertia * omega @ rates.omega + force @ rates.gamma
    geometric = 2 * gamma @ rates.gamma
    areas = inertia * rates.omega @ gamma + inertia * omega @ rates.gamma

    # Each is a sum of at most 18 triple products that cancel in pairs; every product is rounded at
    # most 6 times, and is below the product of the lengths. The potential's own error drops out:
    # the same gradient is on both sides.
    w, g, f, m = (float(np.linalg.norm(u)) for u in (omega, gamma, force, inertia * omega))
    assert abs(energy) <= 30 * EPSILON * (w * w * m + 2 * w * g * f)
    assert abs(geometric) <= 30 * EPSILON * g * g * w
    assert abs(areas) <= 30 * EPSILON * g * (m * w + g * f)


def test_the_equations_are_those_of_the_formula_sheet() -> None:
    p, q, r, g1, g2, g3 = 0.3, -0.7, 1.1, 0.6, -0.5, 0.4
    A, B, C = 2.0, 1.7, 1.0
    V_1, V_2, V_3 = -1.0, 0.9 * g2**2, -0.1 / g3**3
    rates = euler_poisson_rhs(BODY, FIELD, np.array([p, q, r]), np.array([g1, g2, g3]))
    expected_omega = [
        ((B - C) * q * r + g2 * V_3 - g3 * V_2) / A,
        ((C - A) * p * r + g3 * V_1 - g1 * V_3) / B,
        ((A - B) * p * q + g1 * V_2 - g2 * V_1) / C,
    ]
    expected_gamma = [r * g2 - q * g3, p * g3 - r * g1, q * g1 - p * g2]
    # A dozen roundings of numbers of order one.
    assert rates.omega == pytest.approx(expected_omega, rel=1e-14)
    assert rates.gamma == pytest.approx(expected_gamma, rel=1e-14)


def test_integrals_are_their_definitions() -> None:
    omega, gamma = np.array([0.3, -0.7, 1.1]), np.array([0.6, -0.5, 0.4])
    kinetic = (2 * 0.3**2 + 1.7 * 0.7**2 + 1.1**2) / 2
    field = -0.6 + 1 / (20 * 0.4**2) - 0.3 * 0.5**3
    # A dozen roundings of numbers of order one.
    assert float(energy_integral(BODY, FIELD, omega, gamma)) == pytest.approx(kinetic + field, rel=1e-14)
    assert float(geometric_integral(gamma)) == pytest.approx(0.36 + 0.25 + 0.16, rel=1e-14)
    areas = 2 * 0.3 * 0.6 + 1.7 * 0.7 * 0.5 + 1.1 * 0.4
    assert float(areas_integral(BODY, omega, gamma)) == pytest.approx(areas, rel=1e-14)


def test_many_states_at_once() -> None:
    source = np.random.default_rng(3)
    omega, gamma = source.uniform(0.2, 1.0, (2, 4, 3, 3))
    rates = euler_poisson_rhs(BODY, FIELD, omega, gamma)
    assert rates.omega.shape == rates.gamma.shape == (4, 3, 3)
    assert energy_integral(BODY, FIELD, omega, gamma).shape == (4, 3)
    assert geometric_integral(gamma).shape == (4, 3)
    assert areas_integral(BODY, omega, gamma).shape == (4, 3)
    one = euler_poisson_rhs(BODY, FIELD, omega[2, 1], gamma[2, 1])
    # Powers of arrays and of single numbers may differ by an ulp.
    assert one.omega == pytest.approx(rates.omega[2, 1], rel=1e-14)
    assert one.gamma == pytest.approx(rates.gamma[2, 1], rel=1e-14)


def _planar_state(body: RigidBody, g1: float, g3: float, s: float) -> tuple[FloatArray, FloatArray]:
    g2 = np.sqrt(1 - g1**2 - g3**2)
    return np.array([-float(body.C) * g3 * s, 0.0, float(body.A) * g1 * s]), np.array([g1, g2, g3])


@pytest.mark.parametrize("signs", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_the_signed_amplitude_keeps_the_motion_in_its_plane(signs: tuple[int, int]) -> None:
    # With s² = D/((A-C) A C g1 g3) the rate of q and the areas integral vanish, in every quadrant.
    g1, g3 = 0.4 * signs[0], 0.5 * signs[1]
    potential = gravity_potential(Fraction(-signs[0]), Fraction(1, 3), Fraction(0))
    body = BODY
    _, gamma = _planar_state(body, g1, g3, 0.0)
    A, C = float(body.A), float(body.C)
    s = np.sqrt(float(potential.D(gamma)) / ((A - C) * A * C * g1 * g3))
    omega, gamma = _planar_state(body, g1, g3, s)
    # Sums of two numbers below one that cancel.
    assert abs(float(euler_poisson_rhs(body, potential, omega, gamma).omega[1])) < 4 * EPSILON
    assert abs(float(areas_integral(body, omega, gamma))) < 4 * EPSILON
    # And the energy is the value of H there.
    h = float(energy_integral(body, potential, omega, gamma))
    assert h == pytest.approx(float(potential.H(body, gamma)), abs=8 * EPSILON)


def test_planar_states_need_no_B() -> None:
    body = RigidBody(Fraction(2), None, Fraction(1))
    omega, gamma = _planar_state(body, 0.4, 0.5, 0.7)
    assert energy_integral(body, FIELD, omega, gamma) == energy_integral(BODY, FIELD, omega, gamma)
    assert areas_integral(body, omega, gamma) == areas_integral(BODY, omega, gamma)
    omega[1] = 1e-300
    for call in (
        lambda: energy_integral(body, FIELD, omega, gamma),
        lambda: areas_integral(body, omega, gamma),
        lambda: euler_poisson_rhs(body, FIELD, omega, gamma),
    ):
        with pytest.raises(MissingMomentError):
            call()
