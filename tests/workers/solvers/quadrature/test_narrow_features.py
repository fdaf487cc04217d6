"""V = −g1 + (2 g1² + g3²) f(g2) on g3² = g1, for f as narrow as it likes, against integrals of its own.

For A = 2C the energy is 1/2 whatever f is, since L(Q f(g2)) = 0 and H of it vanishes, and with C = 1

    p² = 1/2 − g1 f(g2),   T = 2 ∫ Z dv / (c p) over 0 ≤ v ≤ π,

where g1 = G sin²v, g3 = Z sin v, g2 = c cos v, c² = 1 + G² sin²v, G = Z² = (√5 − 1)/2. The integral is
taken by Petras' algorithm (acb.integral), which shares nothing with the quadrature but the balls.
"""

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from flint import acb, arb, ctx

from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.window import starting_point
from service.dynamics.reduction.windows import find_windows
from tests.support.planar import body, formula, planar
from workers.solvers.choose import find_motion
from workers.solvers.errors import WindowBlockedError
from workers.solvers.orbits.orbit import Rotation, make_orbit
from workers.solvers.quadrature.squared_speed import time_map_of

Function = Callable[[acb], acb]
BODY = body(2, 1)
MOTION = PlanarMotion(Fraction(1))
REFERENCE_BITS = 128

# Exponents of the width, places and heights: spikes, a well, one next to the pole, one at the equator.
FEATURES = [
    (1, "3/10", "1/100"),
    (2, "-7/10", "-2"),
    (3, "3/10", "1/100"),
    (4, "999/1000", "1/3"),
    (5, "0", "-1/10"),
    (6, "1/7", "3/4"),
    (8, "3/10", "1/100"),
]


def feature_text(exponent: int, place: str, height: str) -> str:
    return f"-g1 + (2*g1^2+g3^2)*({height})*exp(-10^{2 * exponent}*(g2-({place}))^2)"


def feature(exponent: int, place: str, height: str) -> Function:
    centre, size = (arb(x.numerator) / x.denominator for x in (Fraction(place), Fraction(height)))

    def f(g2: acb) -> acb:
        return size * (-(acb(10) ** (2 * exponent)) * (g2 - centre) ** 2).exp()

    return f


def half_turn(f: Function, first: arb, last: arb) -> arb:
    """Return the time of v from ``first`` to ``last``."""
    G = (arb(5).sqrt() - 1) / 2

    def rate(v: acb, analytic: bool) -> acb:
        sine, cosine = v.sin_cos()
        c = (1 + G * G * sine * sine).sqrt(analytic)
        squared = acb("0.5") - G * sine * sine * f(c * cosine)
        return G.sqrt() * squared.rsqrt(analytic) / c

    return acb.integral(rate, first, last).real


def place_of(g2: Fraction) -> arb:
    """Return v with c cos v = g2: (1 + G² (1 − u)) u = g2² for u = cos²v."""
    G, value = (arb(5).sqrt() - 1) / 2, arb(g2.numerator) / g2.denominator
    b = 1 + G * G
    u = (b - (b * b - 4 * G * G * value * value).sqrt()) / (2 * G * G)
    return (u.sqrt() if value > 0 else -u.sqrt()).acos()


def claimed_gap(period, exact: arb) -> tuple[arb, float]:
    return abs(arb(period.hi) + arb(period.lo) - exact), period.error


@pytest.mark.one_in(3)
@pytest.mark.parametrize(("exponent", "place", "height"), FEATURES)
def test_periods_see_features_of_any_width(exponent, place, height):
    text = feature_text(exponent, place, height)
    motion = find_motion(planar(BODY, text, MOTION, (0,)))
    with ctx.workprec(REFERENCE_BITS):
        exact = 2 * half_turn(feature(exponent, place, height), arb(0), arb.pi())
        gap, error = claimed_gap(motion.dense.period, exact)
        # lo is rounded to 2^-53 of a number that is at most 2^-53 of the period.
        assert gap < error + motion.dense.period.hi * 2.0**-104
    # The bound of NEGLIGIBLE for each of some dozens of panels.
    assert error <= 1e-15 * motion.dense.period.hi


@pytest.mark.one_in(2)
@pytest.mark.parametrize(("exponent", "place", "height"), [FEATURES[2], FEATURES[3], FEATURES[5]])
def test_functions_of_time_see_features_of_any_width(exponent, place, height):
    """p² is that of the energy on all of the way, and looked at where the feature is passed."""
    motion = find_motion(planar(BODY, feature_text(exponent, place, height), MOTION, (0,)))
    dense = motion.dense
    times = np.linspace(0.0, dense.period.hi, 20001)
    g2 = dense(times)[:, 4]
    nearest = times[np.argmin(np.abs(g2 - float(Fraction(place))))]
    # Ten widths on both sides at steps of 1/100 of one; g2 moves by about 0.5 in unit time.
    around = nearest + np.linspace(-20.0, 20.0, 4001) * max(10.0**-exponent, 2e-5)
    states = dense(np.concatenate([times, around]))
    p, g1, g2 = states[:, 0], states[:, 3], states[:, 4]
    bump = np.exp(-(10.0 ** (2 * exponent)) * (g2 - float(Fraction(place))) ** 2)
    expected = 0.5 - g1 * float(Fraction(height)) * bump
    # The slope of the bump in g2 is at most one over its width, that of the rest at most 1.
    allowed = (4.0 + 10.0**exponent) * dense.error_at(np.array([0.0]))
    assert np.abs(p * p - expected).max() <= allowed
    assert bump.max() > 0.5


def test_what_is_seen_is_not_slow_to_see():
    """Panels shrink geometrically towards a feature: their number grows with the logarithm of its width."""
    counts = []
    for exponent in (2, 4, 8):
        motion = find_motion(planar(BODY, feature_text(exponent, "3/10", "1/100"), MOTION, (0,)))
        counts.append(motion.evidence["panels"])
    # log2(10) halvings for each factor 10, on both sides of two passages.
    assert counts[1] - counts[0] <= 2 * 4 * 3.4
    assert counts[2] - counts[1] <= 4 * 4 * 3.4


def round_the_loop(text: str) -> Rotation:
    """Return the motion round the whole loop, whatever the windows of the potential are."""
    (window,) = find_windows(BODY, formula("-g1", BODY), MOTION)
    start = starting_point(window, MOTION)
    loop = replace(start.arc.loop, potential=formula(text, BODY))
    orbit = make_orbit(replace(start, arc=replace(start.arc, loop=loop)))
    assert isinstance(orbit, Rotation)
    return orbit


@pytest.mark.parametrize("exponent", [2, 5, 8])
def test_a_wall_in_a_window_is_no_motion_through_it(exponent):
    """Given the window of −g1 by force, the quadrature proves that p² is negative in it."""
    with ctx.workprec(160), pytest.raises(WindowBlockedError):
        time_map_of(round_the_loop(feature_text(exponent, "3/10", "2")))


@pytest.mark.parametrize(
    ("text", "sides"),
    [
        ("abs(g2-3/10)/5", (lambda x: x / 5, lambda x: -x / 5)),
        ("abs(g2-3/10)^3/5", (lambda x: x**3 / 5, lambda x: -(x**3) / 5)),
        ("abs(g2-3/10)/(g2-3/10)/20", (lambda _: acb("0.05"), lambda _: acb("-0.05"))),
    ],
    ids=["kink", "third power", "jump"],
)
def test_kinks_are_enclosed(text, sides):
    """Where f is not analytic no ellipse is proved; panels shrink until an enclosure of the rate does."""
    with ctx.workprec(160):
        period = time_map_of(round_the_loop(f"-g1 + (2*g1^2+g3^2)*({text})")).period
    with ctx.workprec(REFERENCE_BITS):
        centre = arb(3) / 10
        cut = place_of(Fraction(3, 10))
        above, below = ((lambda g2, of=of: of(g2 - centre)) for of in sides)
        exact = 2 * (half_turn(above, arb(0), cut) + half_turn(below, cut, arb.pi()))
        gap, error = claimed_gap(period, exact)
        assert gap < error
    # A jump is charged with the whole of the shortest panels it is in.
    assert error <= 1e-13
