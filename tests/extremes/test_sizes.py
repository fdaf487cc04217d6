"""Sizes of curves, coefficients and moments; scaling laws and closed forms tell what is right.

Doubles hold 16 digits of r whatever its size, while the tolerance is absolute:
where r is 1e75, ``accuracy_not_met`` is the right answer.
"""

from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx

from service.dynamics.potentials.recognition import ThreeTerms
from tests.extremes.elliptic import elliptic
from tests.extremes.problems import METHODS, require_claims, solve, three_terms
from tests.support.effort import each_once, seldom
from tests.support.planar import body
from tests.support.witnesses.collision import collision_time

PERIODS = {"periods": "5/2", "samples": 11}
ONE, ZERO = Fraction(1), Fraction(0)
G1_PERIOD = 6.432310535121612580


@pytest.mark.one_in(3)
@each_once(exponent=[-12, -9, -6, -3, 3, 6, 9, 12], method=METHODS)
def test_lambda_from_1e_minus_12_to_1e12(method, exponent):
    nu = Fraction(10) ** (2 * exponent)
    # r grows like lambda, times a time that is known to 1e-16 of the period: 1e-16 lambda and some.
    tolerance = "1e-10" if exponent < 4 else "1e-8" if exponent < 7 else "1e-5" if exponent < 10 else "1e-2"
    for c1, ends in ((ZERO, "PE"), (Fraction(6, 5), "PW" if exponent < 0 else "PE")):
        answer = three_terms(-1, 0, c1, nu, PERIODS, method=method, tolerance=tolerance)
        require_claims(answer, elliptic(ends, nu=nu, a1=-ONE, b1=ZERO, c1=c1))
    reflected = three_terms(-1, "1/20", 0, nu, PERIODS, method=method, tolerance="1e-7")
    if exponent < 0:
        assert reflected.code == "no_motion"  # 2 b1/nu² is more than |a1| x1
    elif exponent == 3 or (method == "auto" and exponent < 12):
        require_claims(reflected, elliptic("WE", nu=nu, a1=-ONE, b1=Fraction(1, 20), c1=ZERO))
    else:
        # p turns within 1e-21 at lambda = 1e6: only balls see that; and half an ulp of r = 1e12 is 6e-5.
        assert reflected.code == "accuracy_not_met"


@pytest.mark.one_in(3)
@each_once(exponent=[-298, -150, -31, -12, 0, 6, 10], method=METHODS)
def test_coefficients_of_any_size_scale_the_time(method, exponent):
    k = Fraction(10) ** exponent
    b1, c1 = Fraction(1, 50), Fraction(6, 5)
    for a, b, c, ends in ((k, ZERO, ZERO, "PE"), (k, k / 20, ZERO, "WE"), (k, k * b1, k * c1, "WW")):
        answer = three_terms(-a, b, c, 1, PERIODS, method=method, tolerance="1e-8")
        require_claims(answer, elliptic(ends, nu=ONE, a1=-a, b1=b, c1=c))


@pytest.mark.parametrize("exponent", [31, 150, 300])
def test_speeds_of_1e15_and_more_cannot_be_had_to_an_absolute_tolerance(exponent):
    answer = three_terms(f"-1e{exponent}", 0, 0, 1, PERIODS, tolerance="1e-2")
    assert answer.code == "accuracy_not_met"


@pytest.mark.parametrize("k", [Fraction(10) ** 6, Fraction(1, 10**31)])
def test_s11_v_to_k_v_takes_t_to_t_over_root_k_and_omega_to_root_k_omega(k):
    # A body and a potential without closed form; 1e6 and 1e-31 are the factors the law was first tried with.
    law, motion = "k*(A*g1^2+C*g3^2)*(g2^2-1/2+g2^3/5)", {"lambda": "4/5"}
    samples = {"periods": 1, "samples": 5}
    plain = solve(law, motion, samples, body=("17/10", 1), parameters={"k": 1})
    scaled = solve(law, motion, samples, body=("17/10", 1), parameters={"k": k}, tolerance="1e-8")
    root = float(k) ** 0.5
    # Four roundings, of two doubles each with a claim of its own.
    assert scaled.period * root == pytest.approx(plain.period, rel=1e-15)
    energies = [answer.summary["energy"] for answer in (plain, scaled)]
    assert energies[1]["value"] / float(k) == pytest.approx(energies[0]["value"], abs=1e-15)
    factors = np.array([root, root, root, 1.0, 1.0, 1.0])
    bound = plain.error * factors + scaled.error + 1e-15 * root
    assert np.all(np.abs(scaled.states - plain.states * factors) <= bound)


@pytest.mark.parametrize("exponent", [-150, -12, 12, 150, 299])
def test_s11_a_heavier_body_is_slower(exponent):
    answer = solve(
        "-g1",
        {"nu": 1},
        {"periods": 1, "samples": 5},
        body=(f"2e{exponent}", f"1e{exponent}"),
        tolerance="1e-6",
    )
    if exponent == -150:
        assert answer.code == "accuracy_not_met"  # r is 1e75
        return
    # (A, C) → k (A, C) takes t to √k t; a few roundings of the law itself and the claim.
    expected = G1_PERIOD * 10.0 ** (exponent / 2)
    assert abs(answer.period - expected) <= answer.period_error + 1e-15 * expected
    assert abs(answer.states[0, 2] - 1.1117859405028423 * 10.0 ** (-exponent / 2)) <= answer.error


def test_moments_beyond_what_can_be_computed_with_are_refused_at_the_door():
    heavy = ("2e300", "1e300")
    assert solve("-g1", {"nu": 1}, PERIODS, body=heavy).code == "invalid_problem"


@pytest.mark.parametrize(
    ("a1", "b1", "c1", "code"),
    [
        ("-1e150", "1e-150", 0, "accuracy_not_met"),
        ("-1e-150", "1e150", 0, "no_motion"),
        ("-1", "1e150", 0, "no_motion"),
        ("-1e150", 0, "1e-150", "accuracy_not_met"),
    ],
)
def test_coefficients_that_differ_by_1e300(a1, b1, c1, code):
    assert three_terms(a1, b1, c1, 1, {"periods": 1, "samples": 5}, tolerance="1e-2").code == code


@pytest.mark.parametrize("a1", ["-1", "-1e-150"])
def test_a_libration_next_to_the_pole_is_found_however_small(a1):
    # g1 < 5e-151 and 5e-301.
    answer = three_terms(a1, 0, "1e150", 1, PERIODS)
    reference = elliptic("PW", nu=ONE, a1=Fraction(a1), b1=ZERO, c1=Fraction(10) ** 150)
    require_claims(answer, reference)
    # It is harmonic to all digits: 2π / √(2 c1 / 2).
    assert answer.period == pytest.approx(2e-75 * np.pi, rel=1e-15)


@pytest.mark.long
def test_a_reflection_at_1e_minus_300_is_not_taken_for_an_end_at_the_pole():
    # 2 b1 / nu² = |a1| x there: p turns, g3 does not. A motion said to end at the pole would be another one.
    start_turn_start = {"periods": 1, "samples": 3}
    answer = three_terms(-1, "1e-299", 0, 1, start_turn_start)
    require_claims(answer, elliptic("WE", nu=ONE, a1=-ONE, b1=Fraction("1e-299"), c1=ZERO))
    assert three_terms(-1, "1e-299", 0, 1, start_turn_start, method="quadrature").code == "accuracy_not_met"


@pytest.mark.long
@pytest.mark.parametrize("b1", [*seldom("-1e-20", "-1e-100", "-1e-250"), "-1e-150"])
def test_a_collision_that_tiny_terms_decide_comes_in_finite_time(b1):
    """V = −(g1² − g2²) alone tends to the pole for ever; b1/g3² takes over at x² ~ |b1| and ends it."""
    answer = three_terms(0, b1, -1, 1, {"start": 0, "stop": "1e4", "samples": 2001})
    future = answer.summary["asymptotes"]["future"]
    assert future["kind"] == "collision"
    # Carlson's integral, in balls: the same motion without any quadrature.
    terms = ThreeTerms(ZERO, Fraction(b1), -ONE)
    with ctx.workprec(3000):
        arrival = collision_time(terms, body(2, 1), ONE)
        assert abs(arrival - arb(future["time"]["value"])) <= future["time"]["error"]
    assert answer.columns["t"][-1] < future["time"]["value"]
    assert three_terms(0, b1, -1, 1, {"times": [1000]}).code == "motion_ended"
