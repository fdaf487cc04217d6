"""A value belongs to the exact time that was asked: 1/3, not the double beside it."""

import json
import math
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import given
from hypothesis import strategies as st

from service.dynamics.equations.orientation import trajectory_columns
from service.dynamics.motion import COLUMNS
from service.dynamics.problem import PlanarMotion, TimeList, TimePeriods, TimeSpan
from service.dynamics.sampling import exact_instants, sample_times
from service.dynamics.solution.dense_output import MAX_PARTS, RADIUS, Period, join
from service.jobs.records import Solved
from service.schemas.problem.problem import read_problem
from service.storage.codecs.packing import decode_arrays, decode_dense
from tests.support.planar import body, formula
from workers.computation.compute import solve, solve_document
from workers.solvers.choose import enclose

DOUBLE = body(2, 1, "3/2")
TEXT = "-g1 + 1/(20*g3^2)"
# Decimals whose doubles are off by 1e-9 and more, and a fraction that no decimal has.
LATE = ("12345678.9", "-98765432.1", "100000000/3")

EXACT = st.fractions(-(10**15), 10**15, max_denominator=10**30)


def document(times, accuracy, **fields):
    return {
        "body": {"A": 2, "B": "3/2", "C": 1},
        "potential": {"type": "expression", "expression": TEXT},
        "motion": {"type": "planar", "nu": 1},
        "time": times,
        "accuracy": accuracy,
        **fields,
    }


def solved(times, accuracy, **fields):
    outcome = solve_document(json.dumps(document(times, accuracy, **fields)))
    assert isinstance(outcome, Solved), outcome
    return outcome


def columns_of(times, accuracy, **fields):
    return decode_arrays(solved(times, accuracy, **fields).samples)


def balls(columns, name):
    parts = [
        columns[name],
        *(columns[f"{name}.{k}"] for k in range(1, MAX_PARTS) if f"{name}.{k}" in columns),
    ]
    rows = zip(*(part.tolist() for part in parts), strict=True)
    return [join(row, radius) for row, radius in zip(rows, columns[f"{name}.{RADIUS}"].tolist(), strict=True)]


def certified(times, bits=128):
    """The six variables at exact times, rounded to doubles."""
    motion = PlanarMotion(None, nu=Fraction(1))
    found = enclose(DOUBLE, formula(TEXT, DOUBLE), motion, [Fraction(t) for t in times], bits)
    return np.array([[float(value.mid()) for value in state] for state in found.states])


def is_split(exact, double, rest):
    """Say whether the two doubles are the nearest one and, to its last digit, what it leaves."""
    left = exact - Fraction(double)
    return double == float(exact) and abs(left - Fraction(rest)) <= abs(left) * Fraction(1, 2**52)


@given(st.lists(EXACT, min_size=1, max_size=5))
def test_listed_times_lose_nothing(times):
    found = sample_times(TimeList(tuple(times)), None)
    assert all(map(is_split, times, found.doubles.tolist(), found.low_parts.tolist()))
    assert exact_instants(TimeList(tuple(times))) == times


@given(EXACT, st.fractions("1e-6", 10**9, max_denominator=10**6), st.integers(1, 9))
def test_neither_do_those_of_a_span(start, length, samples):
    span = TimeSpan(start, start + length, samples)
    exact = [start + length * k / max(samples - 1, 1) for k in range(samples)]
    found = sample_times(span, None)
    assert exact_instants(span) == exact
    assert all(map(is_split, exact, found.doubles.tolist(), found.low_parts.tolist()))


@given(st.fractions("1e-3", 10**9, max_denominator=10**4), st.integers(1, 9), st.floats(1e-3, 1e3))
def test_periods_are_multiples_of_both_its_parts(periods, samples, hi):
    lo = math.ulp(hi) / 3.0
    found = sample_times(TimePeriods(periods, samples), Period(hi, lo, 0.0))
    for k, (double, rest) in enumerate(zip(found.doubles.tolist(), found.low_parts.tolist(), strict=True)):
        exact = periods * k / max(samples - 1, 1) * (Fraction(hi) + Fraction(lo))
        assert abs(exact - Fraction(double) - Fraction(rest)) <= exact * Fraction(1, 2**100)
        assert abs(exact - Fraction(double)) <= Fraction(math.ulp(double)) * Fraction(51, 100)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("time", ["1/3", "0.1"])
def test_a_certified_value_is_that_at_the_exact_time(time):
    columns = columns_of({"times": [0, time]}, {"tier": "certified", "bits": 128})
    exact = Fraction(time)
    with mpmath.workdps(60):
        start = [mpmath.mpf(balls(columns, name)[0].mid().str(55, radius=False)) for name in COLUMNS]

        def rates(_, state):
            # Euler's and Poisson's equations with q = 0, A = 2, C = 1 and V = -g1 + 1/(20 g3²).
            p, _q, r, g1, g2, g3 = state
            V1, V3 = -1, -1 / (10 * g3**3)
            return [g2 * V3 / 2, 0, -g2 * V1, r * g2, p * g3 - r * g1, -p * g2]

        expected = mpmath.odefun(rates, 0, start)(mpmath.mpf(exact.numerator) / exact.denominator)
        printed = [mpmath.nstr(value, 50) for value in expected]
    with ctx.workprec(400):
        assert balls(columns, "t")[1].contains(arb(exact.numerator) / exact.denominator)
        for name, text in zip(COLUMNS, printed, strict=True):
            ball = balls(columns, name)[1]
            assert abs(ball.mid() - arb(text)) <= ball.rad() + arb("1e-45"), name
            assert ball.rad() <= arb(2) ** -120


def test_a_number_and_its_decimal_are_one_time():
    certain = {"tier": "certified", "bits": 128}
    first, second = (columns_of({"times": [time]}, certain) for time in (0.1, "0.1"))
    assert all(np.array_equal(first[name], second[name]) for name in first)
    # The double nearest to 0.1 is another time.
    nearest = columns_of({"times": [str(Fraction(0.1))]}, certain)
    assert not balls(first, "g2")[0].overlaps(balls(nearest, "g2")[0])
    assert f"t.{RADIUS}" not in nearest


@pytest.mark.parametrize(
    "accuracy", [{"tier": "certified", "bits": 128}, {"tier": "high"}, {"tier": "standard"}]
)
def test_whole_periods_change_nothing(accuracy):
    # The fifth of each span is after 10^12 periods, or 10^12 and a quarter.
    whole, more = (
        solved({"periods": periods, "samples": 5}, accuracy) for periods in (10**12, "4000000000001/4")
    )
    within = solved({"periods": 1, "samples": 5}, accuracy)
    here, there, once = (decode_arrays(outcome.samples) for outcome in (whole, more, within))
    for name in COLUMNS:
        if accuracy["tier"] == "certified":
            assert balls(here, name)[4].overlaps(balls(here, name)[0])
            assert balls(there, name)[4].overlaps(balls(once, name)[1])
            assert balls(there, name)[4].rad() < 1e-36
        else:
            assert abs(here[name][4] - here[name][0]) <= 2e-14
            assert abs(there[name][4] - once[name][1]) <= 2e-14


@pytest.mark.parametrize(
    ("accuracy", "method"),
    [
        ({"tier": "high"}, "auto"),
        ({"tier": "standard"}, "auto"),
        ({"tolerance": "1e-9"}, "auto"),
        ({"tolerance": "1e-8"}, "quadrature"),
    ],
)
def test_late_decimals_are_within_the_claim_of_every_tier(accuracy, method):
    outcome = solved({"times": list(LATE)}, accuracy, method=method)
    columns = decode_arrays(outcome.samples)
    assert columns["t"].tolist() == [float(Fraction(t)) for t in LATE]
    found = np.stack([columns[name] for name in COLUMNS], axis=1)
    assert np.abs(found - certified(LATE)).max() <= outcome.summary["error"]
    assert outcome.summary["error"] <= 1e-9


def test_a_solution_evaluated_later_takes_the_exact_time_too():
    outcome = solved({"times": [0]}, {"tier": "high"}, outputs=["omega", "gamma", "orientation"])
    dense = decode_dense(outcome.dense)
    times = sample_times(TimeList(tuple(map(Fraction, LATE))), None)
    columns = trajectory_columns(dense, times.doubles, times.low_parts)
    found = np.stack([columns[name] for name in COLUMNS], axis=1)
    assert np.abs(found - certified(LATE)).max() <= dense.error_at(times.doubles)
    # The third row of the rotation is gamma: the quaternion is of the same time.
    q0, q1, q2, q3 = (columns[f"q{k}"] for k in range(4))
    third = np.stack([2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), 1 - 2 * (q1**2 + q2**2)], axis=1)
    assert np.abs(third - found[:, 3:]).max() <= 1e-12


def test_integrated_motions_take_the_rest_of_a_time():
    times = {"times": ["1/3", "20/3"]}
    outcome = solved(times, {"tolerance": "1e-11"}, method="integration")
    columns = decode_arrays(outcome.samples)
    found = np.stack([columns[name] for name in COLUMNS], axis=1)
    assert np.abs(found - certified(["1/3", "20/3"])).max() <= outcome.summary["error"]
    motion = solve(read_problem(document(times, {"tolerance": "1e-11"}, method="integration")))
    assert motion.low_parts is not None
    # What the double leaves out moves the place on its piece, which is seen where it is made large.
    moved = motion.dense(motion.times[:1], motion.low_parts[:1] + 1e-3)
    assert np.abs(moved - motion.dense(motion.times[:1] + 1e-3)).max() <= 1e-14
