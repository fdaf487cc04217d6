"""Exact symmetries of the heavy body and its integrals, for any state (Hypothesis)."""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.body import RigidBody
from service.dynamics.equations.euler_poisson import areas_integral, energy_integral, geometric_integral
from service.dynamics.motion import Motion
from service.dynamics.potentials.families.coefficients import gravity_potential
from tests.support.effort import examples
from tests.support.heyoka_integrator import HEYOKA
from workers.solvers.integration.solve import integrate_state

pytestmark = pytest.mark.random_law

LAW = settings(max_examples=examples(3, 8), deadline=None)
TIMES = np.linspace(-2.0, 6.0, 41)
Triple = tuple[Fraction, Fraction, Fraction]


@dataclass(frozen=True)
class Top:
    """A heavy body and a state, all rational: the symmetries map the data without rounding."""

    moments: Triple
    centre: Triple
    omega: Triple
    gamma: Triple

    def motion(self, times=TIMES, integrator=HEYOKA, tolerance=1e-10) -> Motion:
        return integrate_state(
            RigidBody(*self.moments),
            gravity_potential(*self.centre),
            self.omega,
            self.gamma,
            times,
            tolerance=tolerance,
            integrator=integrator,
        )


def scaled(triple: Triple, *factors) -> Triple:
    factors = factors if len(factors) == 3 else factors * 3
    return tuple(x * factor for x, factor in zip(triple, factors, strict=True))


def permuted(triple: Triple, order) -> Triple:
    return tuple(triple[index] for index in order)


@st.composite
def tops(draw) -> Top:
    def triple(numbers) -> Triple:
        return draw(st.tuples(numbers, numbers, numbers))

    # Second moments of a mass, so that the triangle inequalities hold, with fewer digits than a double.
    x, y, z = triple(st.integers(8, 40).map(lambda n: Fraction(n, 16)))
    signed = st.integers(-24, 24).map(lambda n: Fraction(n, 16))
    # Rational points of the sphere, by stereographic projection from (0, 0, 1).
    u, v = draw(signed), draw(signed)
    norm = u**2 + v**2 + 1
    gamma = (2 * u / norm, 2 * v / norm, (norm - 2) / norm)
    return Top((y + z, z + x, x + y), triple(signed), triple(signed), gamma)


def assert_same(one: Motion, two: Motion, *, factors=(1.0,) * 6, order=range(6)) -> None:
    """``two`` is ``one`` after its columns are put in order and multiplied."""
    mapped = two.samples[:, list(order)] * np.array(factors)
    # Both are off by what they claim, and the map multiplies one claim.
    allowed = one.error + max(map(abs, factors)) * two.error
    assert np.abs(one.samples - mapped).max() <= allowed <= 1e-8


@LAW
@given(tops(), st.sampled_from(["taylor", HEYOKA, "dop853"]))
def test_the_three_integrals_stay(top, integrator):
    motion = top.motion(integrator=integrator)
    omega, gamma = motion.samples[:, :3], motion.samples[:, 3:]
    body, potential = RigidBody(*top.moments), gravity_potential(*top.centre)
    size = float(max(top.moments)) * (1.0 + np.abs(motion.samples).max()) + float(sum(map(abs, top.centre)))
    for values in (
        energy_integral(body, potential, omega, gamma),
        areas_integral(body, omega, gamma),
        geometric_integral(gamma),
    ):
        # At most six terms, each with a slope below the size; some roundings of values of that size.
        assert np.abs(values - values[0]).max() <= 12 * size * motion.error


@LAW
@given(tops(), st.sampled_from([Fraction(3), Fraction(1, 7), Fraction(1000)]))
def test_moments_and_centre_have_a_common_unit(top, factor):
    """S1: (A, B, C, a, b, c) → μ (A, B, C, a, b, c): the same motion."""
    heavier = Top(scaled(top.moments, factor), scaled(top.centre, factor), top.omega, top.gamma)
    assert_same(top.motion(), heavier.motion())


@LAW
@given(tops(), st.sampled_from([Fraction(2), Fraction(1, 3), Fraction(10)]))
def test_time_has_a_unit(top, factor):
    """S2: ω → L ω, (a, b, c) → L² (a, b, c), t → t/L."""
    faster = Top(top.moments, scaled(top.centre, factor**2), scaled(top.omega, factor), top.gamma)
    rate = float(factor)
    motion = faster.motion(TIMES / rate)
    assert_same(top.motion(), motion, factors=(*[1 / rate] * 3, 1.0, 1.0, 1.0))


@LAW
@given(tops())
def test_upside_down(top):
    """S3: (a, b, c) → -(a, b, c), γ → -γ."""
    turned = Top(top.moments, scaled(top.centre, -1), top.omega, scaled(top.gamma, -1))
    assert_same(top.motion(), turned.motion(), factors=(1, 1, 1, -1, -1, -1))


@LAW
@given(tops())
def test_time_runs_backwards(top):
    """S4: ω → -ω, t → -t."""
    reversed_ = Top(top.moments, top.centre, scaled(top.omega, -1), top.gamma)
    assert_same(top.motion(), reversed_.motion(-TIMES), factors=(-1, -1, -1, 1, 1, 1))


@LAW
@given(tops(), st.sampled_from([0, 1, 2]))
def test_half_turns_about_the_axes(top, axis):
    """S5: ω and γ turned by π about a principal axis, with the centre: (x, y, z) → (x, -y, -z)."""
    signs = [1 if index == axis else -1 for index in range(3)]
    turned = Top(
        top.moments, scaled(top.centre, *signs), scaled(top.omega, *signs), scaled(top.gamma, *signs)
    )
    assert_same(top.motion(), turned.motion(), factors=(*signs, *signs))


@LAW
@given(tops(), st.sampled_from([(1, 2, 0), (2, 0, 1)]))
def test_names_of_the_axes(top, order):
    """S5: a cyclic change of the axes changes nothing."""
    renamed = Top(*(permuted(triple, order) for triple in (top.moments, top.centre, top.omega, top.gamma)))
    back = [order.index(index) for index in range(3)]
    assert_same(top.motion(), renamed.motion(), order=(*back, *(3 + index for index in back)))


@LAW
@given(tops())
def test_exchange_of_two_axes_reverses_the_time(top):
    """S5: axes 2 and 3 exchanged, with B and C; a left-handed frame turns the other way, so t → -t."""
    order = (0, 2, 1)
    mirrored = Top(*(permuted(triple, order) for triple in (top.moments, top.centre, top.omega, top.gamma)))
    assert_same(top.motion(), mirrored.motion(-TIMES), order=(0, 2, 1, 3, 5, 4))


@LAW
@given(tops(), st.sampled_from(["taylor", HEYOKA, "dop853"]))
def test_a_later_state_starts_the_same_motion(top, integrator):
    motion = top.motion(TIMES[TIMES >= 0], integrator)
    restart = motion.samples[10]
    shift = motion.times[10]
    later = Top(top.moments, top.centre, tuple(restart[:3].tolist()), tuple(restart[3:].tolist()))
    again = later.motion(motion.times[10:] - shift, integrator)
    # The error at the restart is carried on, as one of the start of the second would be: that grows, over
    # these short times by two orders at the most.
    assert np.abs(again.samples - motion.samples[10:]).max() <= 100 * motion.error + again.error


@LAW
@given(tops())
def test_kovalevskaya(top):
    """A = B = 2C and c = 0: K = (p² - q² - (a g1 - b g2)/C)² + (2 p q - (a g2 + b g1)/C)², any areas."""
    C, (a, b, _) = Fraction(5, 4), top.centre
    special = Top((2 * C, 2 * C, C), (a, b, Fraction(0)), top.omega, top.gamma)
    motion = special.motion()
    p, q, _, g1, g2, _ = motion.samples.T
    first = p**2 - q**2 - (float(a) * g1 - float(b) * g2) / float(C)
    second = 2 * p * q - (float(a) * g2 + float(b) * g1) / float(C)
    K = first**2 + second**2
    size = np.abs(p).max() + np.abs(q).max() + float(abs(a) + abs(b))
    # dK = 2 first d(first) + ..., with |d(first)| ≤ 2 size · error and so on.
    assert np.abs(K - K[0]).max() <= 16 * (1 + size) ** 3 * motion.error
