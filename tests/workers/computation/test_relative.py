"""Errors relative to the size of a group of variables, and motions solved in units of their own."""

import json
import math
import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.dynamics.accuracy import TIER_TOLERANCES, GroupError, keeps
from service.dynamics.problem import Accuracy
from service.jobs.records import Refused, Solved
from service.schemas.problem.problem import check_problem, problem_digest, read_problem
from service.storage.codecs.packing import SOLVED, decode_arrays, decode_dense, decode_points
from tests.support.effort import each_once, seldom
from tests.support.golden import GOLDEN
from workers.computation import compute, outputs
from workers.computation.compute import solve, solve_document
from workers.solvers.units import Units, speed_of
from workers.sweeping import chunk
from workers.sweeping.chunk import compute_chunk

STATE = ("p", "r", "g1", "g2", "g3")
GRAVITY, REFLECTED = (next(each for each in GOLDEN if each.name == name) for name in ("G1", "G4"))
ROUNDING = 2.0**-52
"""Error of a number rounded to a double, and of the golden digits, relative to the size of its group."""
RELATIVE = {"relative": "1e-10"}


def quicker(golden, *, squared, accuracy, by_moments=False, **fields):
    """Return the golden problem in which t is t/f and ω is f ω, f² = ``squared``: V is f² V, or C is C/f²."""
    f = math.isqrt(squared)
    assert f * f == squared
    body, potential = dict(golden.body), dict(golden.potential)
    if by_moments:
        body = {name: str(Fraction(value) / squared) for name, value in body.items()}
    elif potential["type"] == "gravity":
        potential["a"] = str(Fraction(potential["a"]) * squared)
    else:
        potential["expression"] = f"{squared}*({potential['expression']})"
    times = [str(Fraction(t, f)) for t in golden.states]
    return {
        "body": body,
        "potential": potential,
        "motion": golden.motion,
        "time": {"times": times},
        "accuracy": accuracy,
        **fields,
    }


def departures(outcome, golden, f):
    """Return how far the samples are from the golden numbers, by groups, and the sizes of the groups."""
    columns = decode_arrays(outcome.samples)
    exact = np.array([[Fraction(x) for x in row] for row in golden.states.values()])
    exact[:, :2] *= Fraction(f)
    found = np.array([[Fraction(float(x)) for x in columns[name]] for name in STATE]).T
    off = np.abs(found - exact).astype(float)
    sizes = np.abs(exact).astype(float)
    return {"omega": off[:, :2].max(), "gamma": off[:, 2:].max()}, {
        "omega": sizes[:, :2].max(),
        "gamma": sizes[:, 2:].max(),
    }


def require_claims(outcome, golden, f, promise):
    """Require that no claim is below the departure, and that each is what was promised."""
    assert isinstance(outcome, Solved), outcome
    off, sizes = departures(outcome, golden, f)
    for name, claim in outcome.summary["errors"].items():
        assert off[name] <= claim["absolute"] + ROUNDING * sizes[name]
        assert claim["absolute"] <= promise(sizes[name])
        assert claim["relative"] == pytest.approx(claim["absolute"] / sizes[name], rel=1e-6)
    period = outcome.summary["period"]
    value, error = (Fraction(period[key]) for key in ("value", "radius" if "radius" in period else "error"))
    # The golden period has 33 digits.
    assert abs(value - Fraction(golden.period) / Fraction(f)) <= error + Fraction(1, 10**32) / Fraction(f)


@pytest.mark.parametrize("tier", ["draft", "standard", "high"])
@pytest.mark.parametrize("by_moments", [False, True])
@pytest.mark.parametrize("golden", [GRAVITY, REFLECTED], ids=lambda golden: golden.name)
def test_a_tier_is_kept_relative_to_sizes_above_1(golden, by_moments, tier):
    # f = 1e15 for V and 1e10 for the moments, which is a = 1e30 and C = 1e-20.
    f = 10**10 if by_moments else 10**15
    outcome = solve_document(
        json.dumps(quicker(golden, squared=f * f, accuracy={"tier": tier}, by_moments=by_moments))
    )
    require_claims(outcome, golden, f, lambda size: TIER_TOLERANCES[tier] * max(1.0, size))


def test_certified_digits_of_quick_motions_have_the_radii_that_are_promised():
    f = 10**15
    outcome = solve_document(json.dumps(quicker(GRAVITY, squared=f * f, accuracy={"tier": "certified"})))
    require_claims(outcome, GRAVITY, f, lambda size: 2.0**-52 * size)
    columns = decode_arrays(outcome.samples)
    for name in STATE:
        size = float(f) if name in ("p", "r") else 1.0
        # Of 64 bits, as documented.
        assert np.all(columns[f"{name}.radius"] <= 2.0 ** (8 - 64) * size)
    # The function of time between them has as many digits as a double.
    assert decode_dense(outcome.dense).errors["p"] <= 1e-13 * f


@each_once(
    relative=["1e-6", "1e-10", "1e-13", "1e-15"], squared__f=[(10**30, Fraction(10**15)), (1, Fraction(1))]
)
def test_a_relative_tolerance_is_of_the_size_of_the_group(squared, f, relative):
    outcome = solve_document(json.dumps(quicker(GRAVITY, squared=squared, accuracy={"relative": relative})))
    require_claims(outcome, GRAVITY, f, lambda size: float(relative) * size)


@pytest.mark.parametrize("relative", ["1e-6", "1e-10", "1e-13"])
def test_a_relative_tolerance_keeps_the_digits_of_slow_motions(relative):
    # (A, C) → 1e26 (A, C): ω is 1e-13 of the golden one, and an absolute error of 1e-13 would leave nothing.
    slow = quicker(GRAVITY, squared=1, accuracy={"relative": relative})
    slow["body"] = {"A": "2e26", "C": "1e26"}
    slow["time"] = {"times": [str(t * 10**13) for t in GRAVITY.states]}
    outcome = solve_document(json.dumps(slow))
    require_claims(outcome, GRAVITY, Fraction(1, 10**13), lambda size: float(relative) * size)


def test_lambda_of_1e9_is_solved_to_the_last_digits():
    def answer(accuracy):
        problem = quicker(GRAVITY, squared=1, accuracy=accuracy)
        problem |= {"motion": {"type": "planar", "lambda": "1e9"}, "time": {"periods": 1, "samples": 9}}
        return solve_document(json.dumps(problem))

    proven = decode_arrays(answer({"tier": "certified", "bits": 128}).samples)
    for accuracy in ({"tier": "standard"}, {"tier": "high"}, {"relative": "1e-12"}):
        outcome = answer(accuracy)
        assert isinstance(outcome, Solved), outcome
        found = decode_arrays(outcome.samples)
        for group, names in (("omega", "pqr"), ("gamma", ("g1", "g2", "g3"))):
            claim = outcome.summary["errors"][group]
            size = max(np.abs(proven[name]).max() for name in names)
            off = max(np.abs(found[name] - proven[name]).max() for name in names)
            # The first double of each proven number is rounded.
            assert off <= claim["absolute"] + 2.0**-53 * size
            assert claim["relative"] <= 1e-10


@pytest.mark.parametrize("accuracy", [{"tier": "standard"}, {"tier": "high"}, {"relative": "1e-9"}])
def test_a_quick_motion_from_a_state_is_integrated_in_units_of_its_own(accuracy):
    f = 10**15
    problem = quicker(GRAVITY, squared=f * f, accuracy=accuracy)
    start = GRAVITY.states[0]
    p, r = (str(Fraction(number) * f) for number in start[:2])
    # The golden gamma has 33 digits, of which its length is 1 as closely as is accepted.
    problem |= {
        "body": {**problem["body"], "B": "3/2"},
        "motion": {"type": "state", "omega": [p, 0, r], "gamma": list(start[2:])},
        "time": {"times": ["0", str(Fraction(1, f))]},
    }
    outcome = solve_document(json.dumps(problem))
    assert isinstance(outcome, Solved), outcome
    first = replace(GRAVITY, states={t: GRAVITY.states[t] for t in (0, 1)})
    off, sizes = departures(outcome, first, f)
    for name, claim in outcome.summary["errors"].items():
        assert off[name] <= claim["absolute"] + ROUNDING * sizes[name]
        assert claim["relative"] <= 1e-9


def test_what_is_told_of_the_end_of_a_motion_is_told_in_the_units_of_the_client():
    # S5 of the collisions: V = −g1 − 1/(20 g3²) − (g1² − g2²)/2 on nu = 1 from the equator ends at this time.
    ends, f = Fraction("1.06647559407919763218981408942"), 10**15
    problem = quicker(GRAVITY, squared=1, accuracy=RELATIVE)
    expression = f"{f * f}*(-g1-1/(20*g3^2)-(g1^2-g2^2)/2)"
    problem["potential"] = {"type": "expression", "expression": expression}
    problem["motion"] = {"type": "planar", "nu": 1, "start": {"at": "equator"}}
    problem["time"] = {"times": ["0", str(Fraction(1, f))]}
    outcome = solve_document(json.dumps(problem))
    assert isinstance(outcome, Solved), outcome
    limits = [outcome.summary["asymptotes"][when]["time"] for when in ("past", "future")]
    assert any(abs(abs(Fraction(end["value"])) - ends / f) <= Fraction(end["error"]) for end in limits)
    problem["time"] = {"times": [str(Fraction(3, f))]}
    late = solve_document(json.dumps(problem))
    assert late.error["code"] == "motion_ended"
    assert re.search(r"1\.06647559407\d*e-15", late.error["detail"])


def test_the_attitude_of_a_quick_motion_is_that_of_the_slow_one():
    outputs = ["gamma", "omega", "orientation", "stability", "invariants"]
    slow, quick = (
        solve_document(
            json.dumps(
                quicker(GRAVITY, squared=f * f, accuracy=RELATIVE, outputs=outputs)
                | {"body": {"A": 2, "B": "3/2", "C": 1}}
            )
        )
        for f in (1, 10**15)
    )
    one, other = decode_arrays(slow.samples), decode_arrays(quick.samples)
    for name, group in {**dict.fromkeys(("q0", "q1", "q2", "q3"), "quaternion"), "psi1": "psi1"}.items():
        allowed = sum(each.summary["errors"][group]["absolute"] for each in (slow, quick))
        assert np.abs(one[name] - other[name]).max() <= allowed
    first, second = (each.summary["stability"] for each in (slow, quick))
    assert abs(first["trace"] - second["trace"]) <= first["error"] + second["error"]
    # Exponents are rates; energies go like f², and I3 like f.
    assert quick.summary["energy"]["value"] == pytest.approx(0.5e30, rel=1e-13)
    assert quick.summary["invariants"]["energy"]["drift"] <= 1e-13 * 1e30


@pytest.mark.parametrize("k", [-3, 1, 40])
def test_units_change_a_motion_by_powers_of_two_alone(k):
    problem = read_problem(quicker(GRAVITY, squared=1, accuracy={"tolerance": "1e-9"}))
    plain, units = solve(problem), Units(k)
    posed = units.pose(problem)
    assert problem.body.A * Fraction(4) ** k == posed.body.A
    again = units.motion(solve(replace(posed, accuracy=problem.accuracy)))
    assert np.array_equal(again.times, plain.times)
    # Both are within their claims of one motion; bits differ where a threshold is an absolute one.
    for column in range(6):
        name = "omega" if column < 3 else "gamma"
        allowed = sum(each.group_errors[name].absolute for each in (again, plain))
        assert np.abs(again.samples[:, column] - plain.samples[:, column]).max() <= allowed
    assert again.dense.period.hi == pytest.approx(plain.dense.period.hi, rel=1e-12)


@given(st.floats(min_value=1e-250, max_value=1e250))
def test_in_its_own_units_a_speed_is_from_1_to_2(speed):
    body = read_problem(quicker(GRAVITY, squared=1, accuracy=RELATIVE)).body
    units = Units.of(speed, body)
    if units.k:
        assert 1.0 <= speed / units.quick < 2.0
    else:
        # Moments of such a body would be no doubles.
        assert 1.0 <= speed < 2.0 or abs(math.log10(speed)) > 150


def test_the_speed_is_about_the_largest_angular_velocity():
    problem = read_problem(quicker(GRAVITY, squared=10**30, accuracy=RELATIVE))
    # r at the equator is the largest: 1.1117859405 for a = -1.
    assert speed_of(problem) == pytest.approx(1.1117859405028423e15, rel=1e-2)


@pytest.mark.parametrize("accuracy", [RELATIVE, {"tier": "certified"}])
def test_compiled_code_is_kept_from_the_first_kernel_on(monkeypatch, accuracy):
    order = list[str]()
    keep, speed = compute.keep_compiled_code, outputs.speed_of
    monkeypatch.setattr(compute, "keep_compiled_code", lambda: (order.append("keep"), keep())[1])
    monkeypatch.setattr(outputs, "speed_of", lambda problem: (order.append("speed"), speed(problem))[1])
    solve_document(json.dumps(quicker(GRAVITY, squared=1, accuracy=accuracy)))
    assert order[:2] == ["keep", "speed"]
    assert order.count("keep") == 1


@pytest.mark.parametrize(
    ("measure", "size", "error", "kept"),
    [
        ("absolute", 1e9, 1e-6, True),
        ("absolute", 1e9, 2e-6, False),
        ("above 1", 1e9, 1e3, True),
        ("above 1", 1e9, 2e3, False),
        ("above 1", 1e-9, 1e-6, True),
        ("relative", 1e-9, 1e-15, True),
        ("relative", 1e-9, 2e-15, False),
        ("relative", 0.0, 0.0, True),
        ("relative", 0.0, 1e-300, False),
        ("above 1", math.nan, 1e-9, False),
        ("above 1", math.inf, math.inf, False),
        ("relative", 1.0, math.nan, False),
    ],
)
def test_what_an_error_is_compared_with(measure, size, error, kept):
    assert keeps(Accuracy(1e-6, measure=measure), [GroupError(0.0, 1.0), GroupError(error, size)]) == kept


def test_a_relative_tolerance_is_a_part_of_the_problem():
    asked = [quicker(GRAVITY, squared=1, accuracy=each) for each in (RELATIVE, {"tolerance": "1e-10"})]
    relative, absolute = (check_problem(document).canonical for document in asked)
    assert relative["accuracy"] == {"relative": "1/10000000000"}
    assert problem_digest(relative) != problem_digest(absolute)
    assert read_problem({**asked[0], "accuracy": {"relative": 1e-10}}).tolerance == 1e-10


def test_an_absolute_tolerance_that_is_missed_tells_the_relative_error_too():
    quick = quicker(GRAVITY, squared=10**30, accuracy={"tolerance": "1e-6"})
    missed = solve_document(json.dumps(quick))
    assert isinstance(missed, Refused)
    assert (missed.error["code"], missed.error["pointer"]) == ("accuracy_not_met", "/accuracy/tolerance")
    told = re.search(
        r"as (\S+), and the tolerance is 1.0e-06; it is (\S+) of the largest angular velocity, (\S+);",
        missed.error["detail"],
    )
    absolute, relative, size = map(float, told.groups())
    assert size == pytest.approx(1.1e15, rel=0.05)
    assert relative == pytest.approx(absolute / size, rel=0.1)
    advised = re.search(r'\{"relative": (\S+)\} or more', missed.error["detail"])[1]
    answer = solve_document(json.dumps({**quick, "accuracy": {"relative": advised}}))
    assert isinstance(answer, Solved), answer


@pytest.mark.parametrize(
    "accuracy", [{"tier": "standard"}, {"tier": "high"}, RELATIVE, {"tolerance": "1e-8"}]
)
# A state is followed through all its turns: at the quickest a million in the longer time, a hundred else.
@pytest.mark.parametrize(
    ("motion", "stop"), [("planar", "1e-9"), ("state", "1e-13"), *seldom(("state", "1e-9"))]
)
def test_a_point_of_a_sweep_is_its_job_however_quick(monkeypatch, motion, stop, accuracy):
    monkeypatch.setattr(chunk, "MOST_CHUNK_SECONDS", 3600.0)
    base = quicker(GRAVITY, squared=1, accuracy=accuracy)
    base["body"], base["time"] = {"A": 2, "B": "3/2", "C": 1}, {"stop": stop, "samples": 3}
    if motion == "state":
        base["motion"] = {"type": "state", "omega": [0, 1, 2], "gamma": ["3/5", 0, "4/5"]}
    axis = {"pointer": "/potential/a", "values": ["-1", "-1e5", "-1e18", "-1e30"]}
    sweep = {"base": base, "axes": [axis], "keep": ["energy", "error"], "series": True}
    found = compute_chunk(json.dumps({"sweep": sweep, "first": 0, "count": 4}))
    for place, a in enumerate(axis["values"]):
        alone = solve_document(json.dumps({**base, "potential": {"type": "gravity", "a": a}}))
        assert_same(found, place, alone)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("accuracy", [{"tier": "standard"}, {"tier": "high"}, RELATIVE])
@pytest.mark.parametrize("time", [{"stop": "1e-14", "samples": 5}, {"periods": 2, "samples": 5}])
def test_sweeps_of_quick_motions_go_in_blocks(monkeypatch, time, accuracy):
    monkeypatch.setattr(chunk, "MOST_CHUNK_SECONDS", 3600.0)
    alone = list[int]()
    solve_point = chunk.solve_point

    def counted(sweep, index, **options):
        alone.append(index)
        return solve_point(sweep, index, **options)

    monkeypatch.setattr(chunk, "solve_point", counted)
    base = quicker(REFLECTED, squared=10**30, accuracy=accuracy)
    base |= {"time": time, "motion": {"type": "planar", "lambda": 1}}
    axis = {"pointer": "/motion/lambda", "linspace": ["4/5", "6/5", 24]}
    keep = ["period", "period.error", "energy", "energy.error", "error"]
    sweep = {"base": base, "axes": [axis], "keep": keep, "series": True}
    found = compute_chunk(json.dumps({"sweep": sweep, "first": 0, "count": 24}))
    # One is compared with its job.
    assert len(alone) <= 2
    document = {**base, "motion": {"type": "planar", "lambda": "4/5"}}
    assert_same(found, 0, solve_document(json.dumps(document)))
    points = decode_points(found.data)
    assert set(points.outcomes) == {SOLVED}
    assert all(np.all(np.isfinite(points.numbers[name])) for name in keep)


def assert_same(found, place, alone):
    """Require that a point has the bits and the outcome of its job."""
    points = decode_points(found.data)
    if isinstance(alone, Refused):
        assert points.outcomes[place] == alone.error["code"]
        return
    assert points.outcomes[place] == SOLVED
    assert points.numbers["error"][place] == alone.summary["error"]
    assert points.numbers["energy"][place] == alone.summary["energy"]["value"]
    columns = decode_arrays(alone.samples)
    for name in ("p", "r", "g1", "g3"):
        assert np.array_equal(points.series[name][place], columns[name])
