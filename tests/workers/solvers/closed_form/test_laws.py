"""What random motions in closed form obey, whatever their type."""

from fractions import Fraction

import numpy as np
from flint import arb, ctx
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from service.dynamics.potentials.families.coefficients import rational_potential
from service.dynamics.potentials.recognition import ThreeTerms
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.windows import find_windows
from tests.support.effort import examples
from tests.support.planar import body, planar
from tests.support.solving import solve_planar
from tests.workers.solvers.closed_form.test_motion import solve
from workers.solvers.closed_form import make_closed_form
from workers.solvers.three_terms import MirrorImage, RootsUndecidedError, intervals, make_curve, trip_time

coefficients = st.fractions(-3, 3, max_denominator=20)
repulsions = st.one_of(st.just(Fraction(0)), st.fractions(Fraction(1, 100), 1, max_denominator=100))
curves = st.fractions(Fraction(1, 10), 5, max_denominator=20)
signs = st.sampled_from([1, -1])


def found_intervals(terms, C, nu, g1_sign):
    with ctx.workprec(192):
        curve = make_curve(terms, C, arb(nu.numerator) / nu.denominator, g1_sign)
        try:
            return intervals(curve)
        except RootsUndecidedError:
            return None


@settings(max_examples=examples(6, 40), deadline=None)
@given(coefficients, repulsions, coefficients, curves, signs, signs, signs, st.floats(0.0, 6.28))
def test_integrals_and_equations(a1, b1, c1, nu, g1_sign, g2_sign, g3_sign, origin):
    """|g| = 1, the curve, the areas, the energy, and g1'² as the quartic in g1."""
    terms, C = ThreeTerms(a1, b1, c1), Fraction(3, 2)
    for interval in found_intervals(terms, C, nu, g1_sign) or ():
        if not interval.is_periodic:
            continue
        with ctx.workprec(192):
            motion = make_closed_form(interval, MirrorImage(g1_sign, g2_sign, g3_sign), arb(origin))
        p, q, r, g1, g2, g3 = motion.sample(np.linspace(0.0, motion.period.hi, 33)).T
        a, b, c, n, moment = float(a1), float(b1), float(c1), float(nu), float(C)
        # A few roundings of terms of the size given, through p up to √(nu/x) of the others.
        slack = 1e-14 * (1.0 + np.abs(p))
        assert np.all(np.abs(g1**2 + g2**2 + g3**2 - 1.0) <= slack)
        assert np.all(np.abs(g3**2 - n * g1_sign * g1) <= slack)
        assert np.all(q == 0.0)
        assert np.all(np.abs(2.0 * p * g1 + r * g3) <= slack)
        repulsion = b / g3**2 if b1 else 0.0
        V = a * g1 + c * (g1**2 - g2**2) + repulsion
        h = -a * g1_sign * n / 2.0 - 2.0 * b / n**2 - c
        kinetic = moment * (p**2 + r**2 / 2.0)
        assert np.all(
            np.abs(kinetic + V - h) <= 1e-13 * (1.0 + kinetic + np.abs(V) + abs(h) + abs(a) + abs(c))
        )
        x = g1_sign * g1
        P = 2.0 * b + n**2 * (a * g1_sign * x + 2.0 * c * x**2)
        quartic = 2.0 / (moment * n**2) * (1.0 - n * x - x**2) * -P
        size = (abs(b) + n**2 * (abs(a) + abs(c)) * x) / n**2
        # r g2 is one of the two equations that hold; the other, −p g2 = g3', follows with the areas.
        assert np.all(np.abs((r * g2) ** 2 - quartic) <= 1e-13 * (1.0 + size))


@settings(max_examples=examples(5, 25), deadline=None)
@given(coefficients, st.one_of(repulsions, coefficients), coefficients, curves, signs)
def test_intervals_are_the_windows_of_the_reduction(a1, b1, c1, nu, g1_sign):
    found = found_intervals(ThreeTerms(a1, b1, c1), Fraction(1), nu, g1_sign)
    assume(found is not None)
    potential = rational_potential([a1], [b1], [c1])
    windows = find_windows(body(2, 1), potential, PlanarMotion(None, nu=g1_sign * nu))
    kinds = [
        "collision" if i.lo_end == "collision" else "periodic" if i.is_periodic else "pole" for i in found
    ]
    assert [window.kind for window in windows] == kinds
    for interval, window in zip(found, windows, strict=True):
        lo_end = "pole" if interval.lo_end == "collision" else interval.lo_end
        assert window.ends == (lo_end, interval.hi_end)
        # The window's doubles are its balls rounded.
        np.testing.assert_allclose(np.abs(window.g1), [float(interval.lo), float(interval.hi)], rtol=1e-15)


@settings(max_examples=examples(4, 12), deadline=None, suppress_health_check=[HealthCheck.filter_too_much])
@given(coefficients, repulsions, coefficients, curves, signs, signs)
def test_motions_are_those_of_the_quadrature(a1, b1, c1, nu, g1_sign, g3_sign):
    rigid_body, potential = body(2, 1), rational_potential([a1], [b1], [c1])
    chosen = None
    for interval in found_intervals(ThreeTerms(a1, b1, c1), Fraction(1), nu, g1_sign) or ():
        if interval.is_periodic:
            chosen = interval
    assume(chosen is not None)
    windows = find_windows(rigid_body, potential, PlanarMotion(None, nu=g1_sign * nu))
    motion = PlanarMotion(None, nu=g1_sign * nu, g3_sign=g3_sign, window=len(windows) - 1)
    found = solve(rigid_body, potential, motion)
    other = solve_planar(planar(rigid_body, potential, motion, (0,))).dense
    gap = abs(found.period.hi - other.period.hi + (found.period.lo - other.period.lo))
    # The difference of the low parts rounds.
    assert gap <= found.period.error + other.period.error + 1e-30 * found.period.hi
    times = np.linspace(0.0, found.period.hi, 23)
    assert np.abs(found.sample(times) - other(times)).max() <= found.error() + other.error_at(times)


@settings(max_examples=examples(7, 20), deadline=None)
@given(coefficients, repulsions, coefficients, curves, signs)
def test_scaling_of_the_potential_and_of_the_moments(a1, b1, c1, nu, g1_sign):
    """V → 4 V halves all times, (A, C) → 4 (A, C) doubles them, exactly."""
    for scale, C, ratio in ((4, 1, 2), (1, 4, Fraction(1, 2))):
        first = found_intervals(ThreeTerms(a1, b1, c1), Fraction(1), nu, g1_sign) or ()
        second = (
            found_intervals(ThreeTerms(scale * a1, scale * b1, scale * c1), Fraction(C), nu, g1_sign) or ()
        )
        for one, other in zip(first, second, strict=True):
            if one.is_periodic:
                with ctx.workprec(192):
                    assert trip_time(one).overlaps(trip_time(other) * ratio.numerator / ratio.denominator)
