"""The references of hostile problems: closed forms, an integrator, and walls where they are known to be."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from tests.support.euler_poisson import rates_of
from tests.support.hostile_documents import draw_smooth
from tests.support.hostile_features import SHAPES, Feature, exact
from tests.support.hostile_known import Known
from tests.support.hostile_motions import BITS, TrueMotion, motion_of, setting_of
from tests.support.jets import Jet, power

FloatArray = NDArray[np.float64]

PERIODS = {
    "2": "6.432310535121612579869958267408499",
    "3": "9.853280909959509831372235188172033",
    "4": "13.36298407186977234524483136555792",
    "17/10": "5.42877277657139620106515",
}
"""Periods for V = −|g1|^(2(α−1)/α), C = λ = 1, by α: elliptic, hyperelliptic integrals, 24 digits and
more."""


def known_motion(known: Known, seed: int = 1) -> TrueMotion:
    with ctx.workprec(BITS):
        found = motion_of(setting_of(known), np.random.default_rng(seed))
    assert found is not None
    return found


def pendulum(alpha: str, *features: Feature) -> Known:
    ratio = Fraction(alpha)
    one, zero = Fraction(1), Fraction(0)
    return Known(ratio, one, one, 1, 1, (zero,), features, Fraction(-1), zero)


@pytest.mark.parametrize("alpha", PERIODS)
def test_periods_of_closed_forms(alpha):
    with ctx.workprec(BITS):
        away = known_motion(pendulum(alpha)).period - arb(PERIODS[alpha])
    # The digits that are given are rounded, at the 23rd after the point or later.
    assert float(abs(away).abs_lower()) < 1e-23
    assert float(away.rad()) < 1e-22


def test_a_period_is_that_of_the_mirrored_body():
    """(A, C; g1, g3) → (C, A; g3, g1) changes no time: V = −g1 with A = 2C and V = −g3 with C = 2A."""
    mirrored = Known(
        Fraction(1), Fraction(2), Fraction(1), 1, 1, (Fraction(0),), (), Fraction(0), Fraction(-1)
    )
    with ctx.workprec(BITS):
        assert known_motion(mirrored).period.overlaps(known_motion(pendulum("2")).period)


@pytest.mark.parametrize("width", ["1/1000", "1/100000000"])
def test_a_wall_parts_the_loop_where_it_is(width):
    """V = −g1 + (2g1² + g3²) f has p² = 1/2 − g3² f: it vanishes at both sides of a wall of height 2."""
    wall = Feature("gaussian", "g2", Fraction(2), Fraction(3, 10), Fraction(width))
    with ctx.workprec(BITS):
        setting = setting_of(pendulum("2", wall))
        before, after = sorted((window.stretch for window in setting.windows), key=lambda s: float(s.lower))
        assert before.upper < after.lower
        for v in (before.upper, after.lower):
            t = (setting.curve.g2(v) - exact(wall.place)) / exact(wall.width)
            g3 = setting.curve.Z * v.sin()
            assert (2 * (-t * t).exp() * g3 * g3).overlaps(arb(1) / 2)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("shape", SHAPES)
def test_states_against_an_integrator(shape):
    """The six Euler-Poisson equations, for features wide enough to be integrated over."""
    draws = np.random.default_rng(SHAPES.index(shape))
    place = Fraction(5, 4) if shape == "pole" else Fraction(3, 10)
    feature = Feature(shape, "g2", Fraction(1, 50), place, Fraction(1, 4))
    while True:
        known = replace(draw_smooth(draws), features=(feature,))
        motion = known_motion(known)
        # A pole may be passed in several ways, and what repels from it is stiff.
        if motion.period is not None and max(map(abs, motion.window.g2)) < 0.9:
            break
    times, period = [float(t) for t in motion.times], float(motion.period)
    assert times[0] == 0.0
    for sign in (1, -1):
        early = sorted((sign * t, k) for k, t in enumerate(times) if 0.0 < sign * t < period)
        if early:
            found = integrated(known, motion.states[0], [sign * t for t, _ in early])
            for row, (_, k) in zip(found, early, strict=True):
                # DOP853 at 1e-12 a step, times what grows across the plane in one period.
                assert np.abs(row - [float(x.mid()) for x in motion.states[k]]).max() < 1e-8


def integrated(known: Known, state: tuple[arb, ...], times: list[float]) -> FloatArray:
    """Return the six variables at times of one sign, in their order, shape (n, 6)."""
    A, C = float(known.A), float(known.C)
    B, alpha = max(A, C), A / C
    powers = ((float(known.b), 2 * (alpha - 1) / alpha), (float(known.c), -2 * (alpha - 1)))

    def gradient(g1: float, g2: float, g3: float) -> tuple[float, float, float]:
        y = Jet(arb(g2), arb(1))
        total = sum((exact(a) * power(y, k) for k, a in enumerate(known.powers)), arb(0))
        for feature in known.features:
            total = total + feature.value(y)
        g, slope = float(total.value.mid()), float(total.slope.mid())
        terms = (
            size * e * abs(at) ** (e - 1) * np.sign(at)
            for (size, e), at in zip(powers, (g1, g3), strict=True)
        )
        of_g1, of_g3 = (float(term) if known.b or known.c else 0.0 for term in terms)
        return 2 * A * g1 * g + of_g1, (A * g1**2 + C * g3**2) * slope, 2 * C * g3 * g + of_g3

    rates = rates_of((A, B, C), gradient)
    start = [float(x.mid()) for x in state]
    found = solve_ivp(rates, (0.0, times[-1]), start, method="DOP853", t_eval=times, rtol=1e-12, atol=1e-12)
    return np.asarray(found.y.T)
