"""Motions beside a separatrix at distances like exp(-N): their periods are like N, and as good as any."""

import json
from fractions import Fraction
from math import sqrt

import numpy as np
import pytest
from flint import arb, ctx

from service.dynamics.solution.dense_output import Period
from service.jobs.records import Refused, Solved
from service.storage.codecs.packing import decode_arrays
from tests.extremes.elliptic import elliptic
from tests.extremes.problems import STATE, require_claims, solve, three_terms
from tests.extremes.test_gaps import ONE, ZERO
from tests.support.effort import each_once, seldom
from workers.computation.compute import solve_checked
from workers.solvers.errors import PeriodNotKnownError, require_period_known

GOLDEN = "-g1+(1+sqrt(5))/4*(1{sign}exp(-{n}))*(g1^2-g2^2)"
"""On λ = 1 the separatrix is at n = ∞; with + the motion turns back before the equator, with − it passes."""
PERIOD = {"periods": 1, "samples": 5}


def reference(sign, n):
    """The motion in elliptic functions, in so many bits that the gap has a hundred of them."""
    bits = 4000 + 4 * n
    with ctx.workprec(bits):
        c1 = (1 + arb(5).sqrt()) / 4 * (1 + (1 if sign == "+" else -1) * arb(-n).exp())
    return elliptic("PW" if sign == "+" else "PE", nu=ONE, a1=-ONE, b1=ZERO, c1=c1, bits=bits), bits


def document(potential, *, body=("2", "1"), time=PERIOD, motion=None, **fields):
    return json.dumps(
        {
            "body": {"A": body[0], "C": body[1], "allow_unphysical": True},
            "potential": {"type": "expression", "expression": potential},
            "motion": {"type": "planar", "lambda": 1, **(motion or {})},
            "time": time,
            **fields,
        }
    )


@pytest.mark.one_in(3)
@each_once(
    n__tier=[(40, "standard"), (100, "draft"), (600, "standard"), (1500, "draft"), (10_000, "standard")],
    sign=["+", "-"],
)
def test_periods_and_samples_are_within_their_claims(sign, n, tier):
    exact, bits = reference(sign, n)
    outcome = solve_checked(document(GOLDEN.format(sign=sign, n=n), accuracy={"tier": tier}))
    assert isinstance(outcome, Solved), outcome
    period = outcome.summary["period"]
    columns = decode_arrays(outcome.samples)
    with ctx.workprec(bits):
        true = exact.period
        assert abs(true - arb(period["value"])) <= period["error"]
        # A few units of the last digit of a double: the rounding of the value is counted in.
        assert period["error"] < 4e-16 * period["value"]
        aside = true * arb(2) ** -(bits // 2)
        instants = (0, 0.25, 0.5, 0.75, 1)
        for k, share in enumerate(instants):
            for name, value in zip(STATE, exact.state(true * arb(share) + aside), strict=True):
                assert abs(value - arb(float(columns[name][k]))) <= outcome.summary["error"]


@pytest.mark.one_in(2)
@pytest.mark.parametrize("outputs", [["period"], ["period", "gamma", "omega"]])
def test_far_beyond_doubles_a_motion_is_solved_or_refused_by_name(outputs):
    exact, bits = reference("-", 30_000)
    outcome = solve_checked(document(GOLDEN.format(sign="-", n=30_000), outputs=outputs))
    if isinstance(outcome, Refused):
        # Samples are not better than doubles tell times of 1e5 units of time.
        assert outputs != ["period"]
        assert outcome.error["code"] == "accuracy_not_met"
        return
    with ctx.workprec(bits):
        assert (
            abs(exact.period - arb(outcome.summary["period"]["value"])) <= outcome.summary["period"]["error"]
        )


@pytest.mark.one_in(2)
@pytest.mark.parametrize("body", [("17/10", "1"), ("1", "17/10")])
def test_a_rest_beside_an_equilibrium_off_the_equator_with_general_moments(body):
    """f = ((g2 − 1/3)² − e)(3/4 − g2): from one gap to another the period grows like log(1/e)/κ.

    With g2 = 1/3 + √e cosh y the motion has dt/dy = √(AC/2) / (Q √(3/4 − 1/3)) in the limit, and
    y ends at ½ log(1/e) + a constant, up to corrections like e.
    """
    potential = "-(A*g1^2+C*g3^2)*((g2-1/3)^2-exp(-{n}))*(3/4-g2)"
    periods = []
    for n in (90, 290, 1100):
        text = potential.format(n=n)
        outcome = solve_checked(document(text, body=body, motion={"window": 0}, outputs=["period"]))
        assert isinstance(outcome, Solved), outcome
        periods.append(outcome.summary["period"]["value"])
    A, C = 1.7, 1.0
    low, high = 0.0, 1.0
    for _ in range(200):
        x = 0.5 * (low + high)
        low, high = (x, high) if x**2 + x ** (2 * C / A) < 8 / 9 else (low, x)
    Q = A * x**2 + C * x ** (2 * C / A)
    slope = sqrt(A * C / 2) / (Q * sqrt(5 / 12))
    # Twice y, which grows by half of n.
    assert np.diff(periods) == pytest.approx([200 * slope, 810 * slope], rel=1e-14)


def test_a_place_off_the_equator_that_is_all_but_reached_is_passed_in_time():
    """V = V1 + Q G with G = (g2 − 1/3)²: the motion passes 1/3 ever slower, by log(1/e)/(2κ) each time."""
    # −g1 has h = ν/2 on the curve, so that −(h − V1)/Q is what G is compared with; here they touch at 1/3.
    text = "-(A*g1^2+C*g3^2)*((g2-1/3)^2+exp(-{n}))*(3/4-g2)*(g2+1/2)"
    periods = []
    for n in (90, 290):
        outcome = solve_checked(document(text.format(n=n), body=("17/10", "1"), outputs=["period"]))
        assert isinstance(outcome, Solved), outcome
        periods.append(outcome.summary["period"]["value"])
    low, high = 0.0, 1.0
    for _ in range(200):
        x = 0.5 * (low + high)
        low, high = (x, high) if x**2 + x ** (2 / 1.7) < 8 / 9 else (low, x)
    slope = sqrt(0.85) / ((1.7 * x**2 + x ** (2 / 1.7)) * sqrt(25 / 72))
    # There and back it passes twice, with y from −n/2 to n/2 and constants.
    assert periods[1] - periods[0] == pytest.approx(400 * slope, rel=1e-14)


def test_a_period_that_is_not_known_is_refused():
    require_period_known(None, 1e-10)
    require_period_known(Period(1000.0, 0.0, 9e-8), 1e-10)
    for error in (1.1e-7, 242.0, float("nan"), float("inf")):
        with pytest.raises(PeriodNotKnownError) as refusal:
            require_period_known(Period(1000.0, 0.0, error), 1e-10)
        assert refusal.value.code == "accuracy_not_met"


@pytest.mark.long
def test_a_motion_that_turns_back_at_once_has_its_period_and_no_samples_in_doubles():
    """It comes as near to the pole as |g1| = 1e-31: p jumps for every double."""
    given = {
        "body": {"A": "101/150", "B": "1/10", "C": "2/3", "allow_unphysical": True},
        "potential": {
            "type": "homogeneous",
            "A": ["-3/16", "1/2", "-46/97"],
            "B": ["-10/7"],
            "C": ["27/100", "-13/500"],
        },
        "motion": {"type": "planar", "lambda": 1, "g1_sign": -1, "g3_sign": -1},
        "time": {"stop": 1, "samples": 3},
    }
    outcome = solve_checked(json.dumps(given))
    assert outcome.error["code"] == "accuracy_not_met"
    outcome = solve_checked(json.dumps({**given, "outputs": ["period"]}))
    assert outcome.summary["period"]["error"] < 1e-15


def test_no_proof_and_no_gap_is_refused_by_name():
    answer = solve(
        "-g1+(1+sqrt(5))/4*(1+exp(-9)*(exp(2)-exp(1)^2))*(g1^2-g2^2)", {"lambda": 1}, {"times": [0]}
    )
    assert answer.code == "separatrix_undecided"


@pytest.mark.parametrize("sign", [1, *seldom(-1)])
def test_beside_a_separatrix_at_the_pole_the_period_is_that_of_the_enclosures(sign):
    """There doubles lose it; the function of time says so, and the samples are right."""
    a1 = Fraction(sign, 10**150)
    exact = elliptic("WE" if sign > 0 else "PE", nu=ONE, a1=a1, b1=ZERO, c1=-ONE)
    answer = three_terms(a1, 0, -1, 1, PERIOD)
    require_claims(answer, exact)
    assert answer.period_error < 1e-12
    assert three_terms(a1, 0, -1, 1, PERIOD, method="quadrature").code == "accuracy_not_met"
