"""Gaps to a separatrix, down to what no double can see: the coefficients of a document are exact."""

from collections.abc import Sequence
from fractions import Fraction
from math import nextafter

import numpy as np
import pytest
from flint import arb

from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.windows import find_windows
from tests.extremes.elliptic import elliptic, time_to_collision
from tests.extremes.problems import METHODS, SEPARATRIX, Answer, require_claims, solve, three_terms
from tests.support.effort import each_once, seldom
from tests.support.planar import body, formula

ONE, ZERO = Fraction(1), Fraction(0)
PERIODS = {"periods": "5/2", "samples": 11}


def gap(bits: int, sign: int) -> Fraction:
    """c1* (1 ± 2^-bits), to 64 bits of the gap."""
    return Fraction(
        round(SEPARATRIX * (1 + sign * Fraction(1, 2**bits)) * 2 ** (bits + 64)), 2 ** (bits + 64)
    )


@each_once(method=METHODS, upward=[True, False])
def test_one_ulp_on_either_side_of_the_separatrix(method, upward):
    nearest = float(SEPARATRIX)
    c1 = Fraction(nextafter(nearest, 2.0 if upward else 0.0))
    ends = "PW" if c1 > SEPARATRIX else "PE"
    answer = three_terms(-1, 0, c1, 1, PERIODS, method=method)
    require_claims(answer, elliptic(ends, nu=ONE, a1=-ONE, b1=ZERO, c1=c1))


@pytest.mark.one_in(3)
@each_once(bits=[52, 60, 100, 210], sign=[1, -1])
def test_gaps_below_what_a_double_sees(bits, sign):
    c1 = gap(bits, sign)
    reference = elliptic("PW" if sign > 0 else "PE", nu=ONE, a1=-ONE, b1=ZERO, c1=c1)
    require_claims(three_terms(-1, 0, c1, 1, PERIODS), reference)
    require_claims(three_terms(-1, 0, c1, 1, PERIODS, method="quadrature"), reference)


@each_once(bits=[60, 100, 210], sign=[1, -1])
def test_gaps_at_the_pole(bits, sign):
    a1 = sign * Fraction(1, 2**bits)
    reference = elliptic("WE" if sign > 0 else "PE", nu=ONE, a1=a1, b1=ZERO, c1=-ONE)
    require_claims(three_terms(a1, 0, -1, 1, PERIODS), reference)


@pytest.mark.parametrize("bits", [210, *seldom(400)])
def test_a_gap_is_not_taken_for_none_when_the_motion_is_asked_long_enough(bits):
    """For 2^-210 the body rests near the equator for 70 units of time, and goes on."""
    late = {"start": 0, "stop": 997, "samples": 45}
    answer = three_terms(-1, 0, gap(bits, -1), 1, late, tolerance="1e-2")
    require_claims(answer, elliptic("PE", nu=ONE, a1=-ONE, b1=ZERO, c1=gap(bits, -1)))
    # It really comes back.
    assert np.abs(answer.columns["g2"]).max() > 0.1
    by_quadrature = three_terms(-1, 0, gap(bits, -1), 1, late, method="quadrature")
    require_claims(by_quadrature, elliptic("PE", nu=ONE, a1=-ONE, b1=ZERO, c1=gap(bits, -1)))


@pytest.mark.parametrize("bits", [60, *seldom(100, 210), 400])
def test_a_libration_smaller_than_doubles_resolve_is_still_one(bits):
    """(W,W) about a stable equilibrium: two rest points that agree in half of the bits."""
    c1 = Fraction(5, 4) * (1 - Fraction(1, 2**bits))
    answer = three_terms(-1, "1/20", c1, 1, PERIODS)
    require_claims(answer, elliptic("WW", nu=ONE, a1=-ONE, b1=Fraction(1, 20), c1=c1))
    beyond = Fraction(5, 4) * (1 + Fraction(1, 2**bits))
    assert three_terms(-1, "1/20", beyond, 1, PERIODS).code == "no_motion"


@pytest.mark.parametrize("bits", [60, *seldom(100), 210])
def test_a_gap_between_collision_and_oscillation(bits):
    b1 = -(1 - Fraction(1, 2**bits)) / 16
    answer = three_terms(1, b1, -1, 1, PERIODS, window=1)
    require_claims(answer, elliptic("WE", nu=ONE, a1=ONE, b1=b1, c1=-ONE))


def beyond_the_gap(bits: int, times: Sequence[str], *, tolerance: str = "1e-10") -> Answer:
    """Ask for the motion that all but rests at g1 = 1/4, and ends in collisions before and after that."""
    return three_terms(1, past_the_gap(bits), -1, 1, {"times": list(times)}, tolerance=tolerance)


def past_the_gap(bits: int) -> Fraction:
    return -(1 + Fraction(1, 2**bits)) / 16


@pytest.mark.one_in(2)
@pytest.mark.parametrize("bits", [8, 60])
def test_beyond_the_gap_the_motion_lasts_until_its_collision(bits):
    end = time_to_collision(nu=ONE, a1=ONE, b1=past_the_gap(bits), c1=-ONE)
    times = [str(share * float(end)) for share in (0, 0.25, 0.5, 0.999, 1.001, 1.5)]
    answer = beyond_the_gap(bits, times)
    assert (answer.code, answer.summary["aperiodic"]) == (None, "collision")
    for side, name in ((-1, "past"), (1, "future")):
        found = answer.summary["asymptotes"][name]["time"]
        assert found["error"] <= 1e-10
        assert abs(side * end - arb(found["value"])) <= found["error"]
    assert len(answer.states) == 4
    assert beyond_the_gap(bits, times[-2:]).code == "motion_ended"


@pytest.mark.long
@pytest.mark.parametrize("bits", [95, *seldom(210)])
def test_a_collision_whose_time_is_not_known_ends_no_motion(bits):
    """A near rest narrower than the panels of a motion that ends makes its time a guess.

    It comes after t = 40: to say that the motion is over at t = ½ is wrong.
    """
    end = time_to_collision(nu=ONE, a1=ONE, b1=past_the_gap(bits), c1=-ONE)
    assert end > 40
    assert beyond_the_gap(bits, ["1/2"], tolerance="1e-2").code in (None, "accuracy_not_met")


@pytest.mark.parametrize(("order", "precision"), [(2, 160), (2, 2560), (4, 160)])
def test_zeros_of_even_order_are_one_at_every_precision(order, precision):
    """P ∝ ∓(g2 − 1/3)^n: an equilibrium alone, or one that two separatrices lead to."""
    rigid_body = body("17/10", 1)

    def kinds(potential: Potential) -> list[str]:
        windows = find_windows(rigid_body, potential, PlanarMotion(ONE), precision=precision)
        return [window.kind for window in windows]

    assert kinds(formula(f"(A*g1^2+C*g3^2)*(g2-1/3)^{order}", rigid_body)) == ["equilibrium"]
    if order == 2:
        assert kinds(formula("-(A*g1^2+C*g3^2)*(g2-1/3)^2", rigid_body)) == ["separatrix"] * 2


def test_a_gap_with_general_moments():
    """G = g2⁴ − g2²/4 + e: the librations of two hemispheres join at e = 0."""
    motion = {"lambda": 1}
    joined = solve("(A*g1^2+C*g3^2)*(g2^4-g2^2/4)", motion, {"times": [0]}, body=("17/10", 1))
    assert joined.summary["aperiodic"] == "separatrix"
    lifted = "(A*g1^2+C*g3^2)*(g2^4-g2^2/4+e)"
    before = half = 0.0
    for bits in (30, 60, 100):
        e = Fraction(1, 2**bits)
        split = solve(lifted, motion, {"periods": 1, "samples": 3}, body=("17/10", 1), parameters={"e": e})
        over = solve(lifted, motion, {"periods": 1, "samples": 3}, body=("17/10", 1), parameters={"e": -e})
        assert list(split.summary["window"]["ends"]) == ["rest", "rest"]
        assert list(over.summary["window"]["ends"]) == ["rest", "equator"]
        # A passage of the equator takes (1/κ) ln(1/e) + constant, up to e ln e, which is 2e-8 at the
        # widest gap. The full motion passes it twice a period, the northern one comes near it once.
        if bits > 30:
            assert over.period - before == pytest.approx(2 * (split.period - half), rel=1e-6)
        before, half = over.period, split.period
