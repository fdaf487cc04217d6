"""A point of a sweep is the job of its document, whatever way the chunk took."""

import json
import time

import numpy as np
import pytest

from service.dynamics.verdict.verdict import decide
from service.jobs.outcome import Refused
from service.schemas.sweep.kept_numbers import kept_numbers
from service.schemas.sweep.reading import read_sweep
from service.storage.codecs.arrays import decode_arrays
from service.storage.codecs.points import SOLVED, decode_points
from service.verdicts import kept
from service.verdicts.examination import examine_problem
from workers.computation.compute import solve_checked
from workers.sweeping import chunk
from workers.sweeping.chunk import compute_chunk
from workers.sweeping.plan import make_plan

DOUBLE = {"A": 2, "B": "3/2", "C": 1}
THREE_TERMS = {"type": "expression", "expression": "a*g1 + b/g3^2", "parameters": {"a": -1, "b": "1/50"}}
TIME = {"stop": 20, "samples": 7}
LOOSE, DRAFT, HIGH = {"tolerance": 1e-9}, {"tier": "draft"}, {"tier": "high"}
A, B = "/potential/parameters/a", "/potential/parameters/b"
LAMBDA, NU = "/motion/lambda", "/motion/nu"


def sweep(*axes, base=None, combine="grid", keep=("period", "energy", "error"), series=True, **fields):
    problem = {
        "body": DOUBLE,
        "potential": THREE_TERMS,
        "motion": {"type": "planar", "lambda": 1},
        "time": TIME,
        "accuracy": LOOSE,
        **fields,
    }
    listed = [{"pointer": pointer, **values} for pointer, values in axes]
    return {"base": problem, "axes": listed, "combine": combine, "keep": list(keep), "series": series}


def values(*numbers):
    return {"values": list(numbers)}


def uniform(lo, hi, count=4, seed=1):
    return {"uniform": [lo, hi, count], "seed": seed}


def expression(text, **parameters):
    return {"type": "expression", "expression": text, "parameters": parameters}


IN_BLOCKS = {
    "parameters and lambda": sweep(
        (A, uniform(-2, -0.5)), (B, uniform(0.01, 0.04)), (LAMBDA, uniform(0.7, 1.4)), combine="zip"
    ),
    "draft": sweep((A, uniform(-2, -0.5)), (LAMBDA, values("1/3", 0.9)), accuracy=DRAFT),
    "nothing in the potential": sweep((LAMBDA, {"logspace": [0.3, 2, 5]})),
    "every number that can be kept": sweep(
        (A, uniform(-2, -1)),
        keep=("period", "period.error", "energy", "energy.error", "error", "cross_check.disagreement"),
    ),
    "both signs of nu, and none": sweep(
        (NU, {"linspace": [-1, 1, 5]}), (A, values(-1, 1)), motion={"type": "planar", "nu": -1}
    ),
    "lambda that is none": sweep((LAMBDA, values(1, 0, -1))),
    "no motion": sweep((A, values(1, 2))),
    "from a motion to none": sweep((B, {"linspace": ["1/100", 1, 5]}), accuracy=DRAFT),
    "constants worked out from parameters": sweep(
        (A, uniform(-2, -1)),
        (B, values("1/70", "0.02")),
        potential=expression("a*g1/3 - 2*(b + 1/7)/(-g3^2)/20 + sqrt(2)*a*g1", a=-1, b=1),
    ),
    "parameters that shorten the formula": sweep(
        (A, values(-1, 1, 0, "-1/50")), (B, values("1/50", 1, 0)), potential=THREE_TERMS
    ),
    "one window or several": sweep(
        (A, values(0, "-1/2", -1)), potential=expression("g1 - 1/(20*g3^2) + a*(g1^2-g2^2)", a=-1)
    ),
    "gravity": sweep(("/potential/a", uniform(-2, 2)), potential={"type": "gravity", "a": 1}),
    "rational": sweep(
        ("/potential/a/0", uniform(-2, -1)),
        ("/potential/c/1", values(0, "1/5", -1)),
        potential={"type": "rational", "a": [-1], "b": ["1/50"], "c": [0, "1/5"]},
    ),
    "poles passed by convention": sweep(
        ("/potential/a/1", values(0, "1/50")),
        (LAMBDA, values(1, "3/2")),
        potential={"type": "rational", "a": [-1, "1/50"]},
    ),
    "homogeneous": sweep(
        ("/potential/B/0", uniform(-2, -1)),
        (LAMBDA, uniform("1/2", 1, 2)),
        body={"A": "17/10", "C": 1},
        potential={"type": "homogeneous", "A": [0, "1/10"], "B": [-1], "C": ["1/20"]},
    ),
    "A < C": sweep(
        (LAMBDA, uniform("1/2", 2)),
        body={"A": 1, "C": 2},
        potential=expression("-g3 + b/g1^2", b="1/50"),
    ),
    "in periods": sweep((A, uniform(-2, -1)), time={"periods": "5/2", "samples": 6}),
    "in periods, numbers alone": sweep(
        (A, uniform(-2, -1)), time={"periods": "5/2", "samples": 6}, series=False
    ),
    "listed times": sweep((A, uniform(-2, -1)), time={"times": [3, -1, "1/3"]}),
    "numbers alone": sweep((A, uniform(-2, -1)), series=False),
    "gamma alone": sweep((A, uniform(-2, -1)), outputs=["gamma"]),
    "periods alone": sweep((A, uniform(-2, -1)), outputs=["period"], series=False),
    "an energy of 0": sweep((LAMBDA, values(1, 2)), potential=expression("(2*g1^2+g3^2)*(g2^2-1/2)")),
    "from rest": sweep(
        (A, uniform(-2, -1)),
        motion={"type": "planar", "lambda": 1, "start": {"at": "rest", "g2_sign": -1}, "g3_sign": -1},
    ),
    "windows next to a pole that doubles do not see": sweep(
        (B, values("-1e-13", "-1e-20", "1e-20", "-1e-60")),
        potential=expression("g1 + b/g3^2 - 2*(g1^2-g2^2)", b=0),
    ),
    "too fine for doubles": sweep(
        (A, values(-1)), (LAMBDA, uniform(1, 2)), accuracy={"tolerance": "1.1e-10"}
    ),
}
IN_BLOCKS |= {
    "standard": sweep((A, uniform(-2, -1)), (LAMBDA, uniform("1/2", 2, 2)), accuracy={"tier": "standard"}),
    "1e-10, in periods": sweep(
        (A, uniform(-2, -1)), accuracy={"tolerance": 1e-10}, time={"periods": 3, "samples": 5}
    ),
    "starts": sweep(
        ("/motion/start/g1", values("1/2", "3/10", 1, -1, 0)),
        motion={"type": "planar", "lambda": 1, "start": {"g1": "1/2"}},
    ),
    "from a given start, in periods": sweep(
        (LAMBDA, uniform("1/2", 1)),
        motion={"type": "planar", "lambda": 1, "start": {"g1": "1/3", "g2_sign": -1, "s_sign": -1}},
        time={"periods": 3, "samples": 5},
    ),
    "starts at ends and next to them": sweep(
        ("/motion/start/g1", values("1/2", "0.1", "0.100000000000001", "0.1000001", "0.61803398874989")),
        motion={"type": "planar", "lambda": 1, "start": {"g1": "1/2"}},
        potential=expression("-g1 + b/g3^2", b="1/20"),
    ),
    "starts for A < C": sweep(
        ("/motion/start/g1", uniform("2/5", "3/5", 3)),
        (LAMBDA, uniform("3/4", "5/4", 2)),
        body={"A": 1, "C": 2},
        potential=expression("-g3 + b/g1^2", b="1/50"),
        motion={"type": "planar", "lambda": 1, "start": {"g1": "1/2"}},
    ),
    "the moment that planar motions do not depend on": sweep(
        ("/body/B", values("3/2", 1, 3, 4, "1/2", 0, -1))
    ),
    "that moment of a body that cannot be": sweep(
        ("/body/B", values("3/2", 4, 0, -1)), body={"A": 2, "B": 1, "C": 1, "allow_unphysical": True}
    ),
    "drifts": sweep(
        (A, uniform(-2, -1, 2)),
        (LAMBDA, uniform("1/2", 1, 2)),
        keep=("invariants.energy.drift", "invariants.geometric.drift", "invariants.areas.drift"),
        outputs=["gamma", "invariants"],
    ),
    "the drift of the areas alone, in periods": sweep(
        (LAMBDA, uniform("1/2", 1, 2)),
        keep=("invariants.areas.drift",),
        series=False,
        outputs=["invariants"],
        time={"periods": 2, "samples": 9},
    ),
    "not linear in its parameters": sweep(
        (A, uniform(-2, -1)),
        (B, values("1/7", 0, -1)),
        potential=expression("a^3*(b^2 + 2)*g1 + b^2/g3^2 - 3*(a - b)*a*g1", a=-1, b="1/7"),
    ),
    "powers that have no value for a parameter": sweep(
        (B, values("1/7", 0, "1/3")), potential=expression("-(1/b^2)*g1 + b/g3^2/50", b="1/7")
    ),
    "coefficients of a family, of both signs": sweep(
        ("/potential/a/0", uniform(-2, -1, 3)),
        ("/potential/c/0", values("-1/5", "1/7", 0, 1)),
        potential={"type": "rational", "a": [-1], "b": ["1/50"], "c": ["1/5"]},
    ),
}
IN_BLOCKS |= {
    "high": sweep(
        (A, uniform(-1, "-1/2", 3)),
        (B, values("1/20", "0.04")),
        (LAMBDA, uniform("1/2", 2, 2)),
        keep=("period", "period.error", "energy", "energy.error", "error"),
        time={"stop": 5, "samples": 7},
        accuracy=HIGH,
    ),
    "1e-12, in periods": sweep(
        (LAMBDA, uniform("1/2", 2)), accuracy={"tolerance": 1e-12}, time={"periods": "7/3", "samples": 5}
    ),
    "high, numbers alone, in periods": sweep(
        (LAMBDA, uniform("1/2", 2)), accuracy=HIGH, series=False, time={"periods": "7/3", "samples": 5}
    ),
    "high, periods alone": sweep((A, uniform(-2, -1)), accuracy=HIGH, outputs=["period"], series=False),
    "high, drifts": sweep(
        (LAMBDA, uniform("1/2", 1, 2)),
        keep=("energy", "invariants.energy.drift", "invariants.areas.drift"),
        outputs=["gamma", "invariants"],
        accuracy=HIGH,
    ),
    "high, of both signs of nu, and none": sweep(
        (NU, {"linspace": [-1, 1, 5]}), motion={"type": "planar", "nu": -1}, accuracy=HIGH
    ),
    "high, starts": sweep(
        ("/motion/start/g1", values("1/2", "3/10", "0.55", 1, -1, 0)),
        motion={"type": "planar", "lambda": 1, "start": {"g1": "1/2"}},
        potential=expression("-g1 + b/g3^2", b="1/20"),
        accuracy=HIGH,
    ),
    "high, for A < C": sweep(
        (LAMBDA, uniform("3/4", "5/4", 3)),
        ("/motion/start/g1", values("1/2", "3/5")),
        body={"A": 1, "C": 2},
        potential=expression("-g3 + b/g1^2", b="1/50"),
        motion={"type": "planar", "lambda": 1, "start": {"g1": "1/2"}},
        accuracy=HIGH,
    ),
    "high, one window or several": sweep(
        (A, values(0, "-1/2", -1)),
        potential=expression("g1 - 1/(20*g3^2) + a*(g1^2-g2^2)", a=-1),
        accuracy=HIGH,
    ),
    "high, parameters that shorten the formula": sweep(
        (A, values(-1, 1, 0, "-1/50")), (B, values("1/50", 1, 0)), potential=THREE_TERMS, accuracy=HIGH
    ),
    "high, of moments that are not double": sweep(
        (LAMBDA, uniform("3/4", 1, 2)),
        (A, values("1/5", "1/7")),
        body={"A": "17/10", "C": 1},
        potential=expression("(A*g1^2+C*g3^2)*(g2^2-1/2+a*g2^3)", a="1/5"),
        keep=("period", "period.error", "error"),
        accuracy=HIGH,
    ),
    "high, the same in periods, without a series": sweep(
        (LAMBDA, uniform("3/4", 1, 2)),
        body={"A": "17/10", "C": 1},
        potential=expression("(A*g1^2+C*g3^2)*(g2^2-1/2+g2^3/5)"),
        time={"periods": "7/3", "samples": 5},
        series=False,
        accuracy=HIGH,
    ),
    "high, late": sweep(
        (LAMBDA, uniform("1/2", 2, 3)), accuracy=HIGH, time={"start": 1e6, "stop": 1000010, "samples": 5}
    ),
}
IN_BLOCKS |= {
    "further invariants": sweep(
        (A, uniform(-2, -1, 2)),
        (LAMBDA, uniform("1/2", 1, 2)),
        keep=("invariants.energy.drift", "invariants.kovalevskaya", "invariants.kovalevskaya.drift"),
        outputs=["gamma", "omega", "invariants"],
        body={"A": 2, "B": 2, "C": 1},
        potential=expression("a*g1", a=-1),
    ),
    "a further invariant along areas of zero, and another that is none": sweep(
        (NU, values("-1/2", "1/2", 1)),
        keep=("invariants.goriachev", "invariants.goriachev.drift", "invariants.kovalevskaya"),
        outputs=["gamma", "invariants"],
        series=False,
        body={"A": 2, "B": 2, "C": 1},
        motion={"type": "planar", "nu": 1},
        potential=expression("-abs(g1) + b/g3^2", b="1/20"),
    ),
    "a further invariant that there is not": sweep(
        (LAMBDA, uniform("1/2", 1, 3)), keep=("invariants.kovalevskaya",), outputs=["gamma", "invariants"]
    ),
}
IN_SLICES = {
    "a moment": sweep(
        ("/body/A", values("17/10", 1, "9/5", -1, "19/10")),
        potential={"type": "homogeneous", "A": [0, "1/10"], "B": [-1], "C": ["1/20"]},
    ),
    "moments and lambda, and the largest moment last": sweep(
        ("/body/C", values(1, "9/10")),
        (LAMBDA, uniform("1/2", 1, 2)),
        ("/body/A", values("17/10", "9/5", "9/10", 2)),
        potential={"type": "homogeneous", "A": [0, "1/10"], "B": [-1], "C": ["1/20"]},
    ),
    "an exponent": sweep(
        ("/potential/parameters/k", values(2, 1, 3)),
        (LAMBDA, uniform("1/2", 1, 3)),
        potential=expression("a*g1 + b/g3^k", a=-1, b="1/50", k=2),
    ),
    "a parameter under a function": sweep(
        (A, uniform(1, 2, 2)),
        (LAMBDA, uniform("1/2", 1, 3)),
        potential=expression("-exp(a)*g1/4 + b/g3^2", a=1, b="1/50"),
        time={"stop": 5, "samples": 3},
    ),
    "no motion for some": sweep(
        (A, values(0, 3)),
        (LAMBDA, uniform(1, 2, 3)),
        potential=expression("cos(a)*g1 + b/g3^2", a=0, b="1/50"),
    ),
    "inadmissible for one value": sweep(
        (B, values(0, 1, -1)), (LAMBDA, uniform(1, 2, 3)), potential=expression("-g1 + b*(b-1)*g2*g1^3", b=0)
    ),
    "an exponent, high": sweep(
        ("/potential/parameters/k", values(2, 0)),
        (LAMBDA, uniform("1/2", 1, 3)),
        potential=expression("a*g1 + b/g3^k", a=-1, b="1/50", k=2),
        accuracy=HIGH,
        time={"stop": 1, "samples": 3},
    ),
}
ONE_BY_ONE = {
    "gravity that is not admissible but for c = 0": sweep(
        ("/potential/c", values(0, "1/2")), potential={"type": "gravity", "a": -1, "c": 0}
    ),
    "high, of what is no sum of powers": sweep(
        (A, uniform(1, 2, 2)),
        potential=expression("-a*g1*exp(2*g1^2+g3^2-2*g1^2-g3^2)+sqrt(2)*g1", a=1),
        accuracy=HIGH,
    ),
    "certified": sweep((A, uniform(-2, -1, 2)), keep=("period",), accuracy={"tier": "certified"}),
    "admissible for one value": sweep(
        (B, values(0, 1, -1)), potential=expression("-g1 + b*(b-1)*g2*g1^3", b=0)
    ),
    "times": sweep(("/time/stop", values(1, 10, -1))),
    "windows": sweep(
        ("/motion/window", values(0, 1, 2)), motion={"type": "planar", "lambda": 1, "window": 0}
    ),
    "further invariants along the moment that they depend on": sweep(
        ("/body/B", values(2, "3/2")),
        keep=("invariants.kovalevskaya",),
        outputs=["gamma", "omega", "invariants"],
        body={"A": 2, "B": 2, "C": 1},
        potential=expression("a*g1", a=-1),
    ),
    "orientation": sweep(
        (A, uniform(-2, -1, 2)), keep=("precession.psi1",), outputs=["gamma", "omega", "orientation"]
    ),
    "an integral": sweep(
        (LAMBDA, uniform(1, 2, 2)), potential={"type": "general", "F": "w^2", "G": "0"}, series=False
    ),
    "any state": sweep(
        ("/motion/omega/0", values(0, "2/5")),
        motion={"type": "state", "omega": [0, "1/10", 1], "gamma": ["3/5", 0, "4/5"]},
        keep=("energy", "error"),
        time={"stop": 1, "samples": 3},
    ),
    "zeros of no power": sweep(
        ("/potential/parameters/w", values("1/2", 2)),
        keep=("period",),
        series=False,
        outputs=["period"],
        potential=expression("-(2*g1^2+g3^2)*exp(-w/(g2-1/3)^2)*(g2+1/2)", w=1),
        motion={"type": "planar", "lambda": 1, "window": 1},
        time={"stop": 1, "samples": 3},
    ),
    "both methods": sweep(
        (A, values(-1)), method="both", keep=("cross_check.disagreement",), time={"stop": 1, "samples": 3}
    ),
}


@pytest.fixture(autouse=True)
def plans_are_made_anew():
    chunk._solver_of.cache_clear()


@pytest.fixture
def no_hurry(monkeypatch):
    """The first compiled point of an installation is compiled."""
    monkeypatch.setattr(chunk, "ENOUGH_SECONDS", 600.0)


def computed(document, first=0, count=None):
    points = read_sweep(document).points if count is None else count
    return compute_chunk(json.dumps({"sweep": document, "first": first, "count": points}))


def alone(swept, index):
    """The outcome, numbers and series of a point's job, or of what is refused before it."""
    problem = json.dumps(swept.document(index))
    outcome = solve_checked(problem) if "error" not in json.loads(examine_problem(problem)) else None
    if outcome is None:
        return json.loads(examine_problem(problem))["error"]["code"], [np.nan] * len(swept.keep), {}
    if isinstance(outcome, Refused):
        return outcome.error["code"], [np.nan] * len(swept.keep), {}
    return SOLVED, kept_numbers(outcome.summary, swept.keep), decode_arrays(outcome.samples)


@pytest.mark.usefixtures("no_hurry")
@pytest.mark.parametrize("name", [*IN_BLOCKS, *IN_SLICES, *ONE_BY_ONE])
def test_every_bit_of_a_point_is_that_of_its_job(name):
    document = {**IN_BLOCKS, **IN_SLICES, **ONE_BY_ONE}[name]
    swept = read_sweep(document)
    outcome = computed(document)
    assert outcome.count == swept.points
    points = decode_points(outcome.data)
    for index in range(swept.points):
        expected, numbers, series = alone(swept, index)
        assert points.outcomes[index] == expected, swept.document(index)
        found = [points.numbers[kept][index] for kept in swept.keep]
        assert np.array_equal(found, numbers, equal_nan=True), swept.document(index)
        for column in swept.series_columns:
            row = np.full(swept.samples, np.nan)
            # A motion that ends has only the samples before.
            row[: len(series.get(column, ()))] = series.get(column, ())
            assert np.array_equal(points.series[column][index], row, equal_nan=True), (index, column)


@pytest.mark.usefixtures("no_hurry")
@pytest.mark.parametrize("name", IN_BLOCKS)
def test_a_sweep_that_says_so_goes_in_blocks(name, monkeypatch):
    document = IN_BLOCKS[name]
    assert make_plan(read_sweep(document)).quick is not None
    singly = []
    original = chunk.solve_point
    monkeypatch.setattr(
        chunk, "solve_point", lambda *point, **judged: singly.append(point) or original(*point, **judged)
    )
    points = decode_points(computed(document).data)
    # Each refusal but that of no motion, two points for comparison, and those that doubles leave in doubt.
    in_doubt = {"poles passed by convention", "one window or several", "high, one window or several"}
    allowed = sum(outcome not in (SOLVED, "no_motion") for outcome in points.outcomes) + 2
    assert any(outcome in (SOLVED, "no_motion") for outcome in points.outcomes)
    assert name in in_doubt or len(singly) <= allowed or name in SHORTER


SHORTER = {
    "parameters that shorten the formula",
    "high, parameters that shorten the formula",
    "too fine for doubles",
    "windows next to a pole that doubles do not see",
    "starts at ends and next to them",
    "not linear in its parameters",
    "coefficients of a family, of both signs",
}
"""Sweeps of which some points, though solved, leave the common way."""


@pytest.mark.parametrize(
    "name",
    ["certified", "times", "any state"],
)
def test_other_sweeps_go_point_by_point(name):
    plan = make_plan(read_sweep(ONE_BY_ONE[name]))
    assert plan.quick is None
    assert chunk.ChunkSolver(plan)._blocks is None


@pytest.mark.usefixtures("no_hurry")
@pytest.mark.parametrize("name", IN_SLICES)
def test_slices_of_a_sweep_go_in_blocks(name, monkeypatch):
    document = IN_SLICES[name]
    singly = []
    original = chunk.solve_point
    monkeypatch.setattr(
        chunk,
        "solve_point",
        lambda sweep, index, **judged: singly.append(index) or original(sweep, index, **judged),
    )
    points = decode_points(computed(document).data)
    together = {index for index in range(len(points.outcomes)) if index not in singly}
    # The first of both is compared with its single job.
    assert {points.outcomes[index] for index in together} <= {SOLVED, "no_motion"}
    assert len(together) > 1


@pytest.mark.parametrize(
    ("name", "is_judged"),
    [
        ("certified", True),
        ("times", True),
        ("admissible for one value", False),
        ("any state", False),
    ],
)
def test_a_verdict_is_shared_only_if_it_is_proved_for_all(name, is_judged):
    assert make_plan(read_sweep(ONE_BY_ONE[name])).is_judged == is_judged


@pytest.mark.usefixtures("no_hurry")
def test_points_refused_one_by_one_share_a_verdict(monkeypatch):
    asked = []
    monkeypatch.setattr(kept, "decide", lambda *question: asked.append(question) or decide(*question))
    outcomes = decode_points(computed(IN_SLICES["inadmissible for one value"]).data).outcomes
    assert outcomes.count("inadmissible_potential") == 3
    assert len(asked) == 1


@pytest.mark.usefixtures("no_hurry")
def test_a_chunk_may_begin_anywhere():
    document = IN_BLOCKS["constants worked out from parameters"]
    whole, part = decode_points(computed(document).data), decode_points(computed(document, 3, 2).data)
    for name, numbers in part.numbers.items():
        assert np.array_equal(numbers, whole.numbers[name][3:5])
    for name, rows in part.series.items():
        assert np.array_equal(rows, whole.series[name][3:5])


@pytest.mark.parametrize("name", ["standard", "parameters and lambda", "no motion"])
def test_a_chunk_without_time_hands_back_at_least_one_point(name, monkeypatch):
    document = {**IN_BLOCKS, **ONE_BY_ONE}[name]
    monkeypatch.setattr(chunk, "ENOUGH_SECONDS", 0.0)
    monkeypatch.setattr(chunk, "BLOCK_POINTS", 1)
    outcome = computed(document)
    assert outcome.count == 1
    assert len(decode_points(outcome.data).outcomes) == 1


@pytest.mark.usefixtures("no_hurry")
def test_blocks_that_differ_from_a_point_alone_are_not_used(monkeypatch):
    document = IN_BLOCKS["numbers alone"]
    expected = computed(document)
    chunk._solver_of.cache_clear()
    solver = chunk._solver_of(json.dumps(document))
    solve = solver._blocks.solve

    def off_by_one_ulp(first, count):
        block = solve(first, count)
        block.numbers["period"][:] = np.nextafter(block.numbers["period"], np.inf)
        return block

    monkeypatch.setattr(solver._blocks, "solve", off_by_one_ulp, raising=False)
    found = solver.solve(0, expected.count, time.perf_counter() + 60.0)
    assert np.array_equal(found.numbers["period"], decode_points(expected.data).numbers["period"])


def test_the_outcome_counts_refusals_and_bounds_its_numbers():
    outcome = computed(ONE_BY_ONE["times"])
    assert (outcome.count, outcome.refused) == (3, 1)
    low, high = outcome.bounds["period"]
    assert low == high == decode_points(outcome.data).numbers["period"][0]


@pytest.mark.parametrize(
    ("accuracy", "stop", "way"),
    [
        ({"tolerance": "1e-9"}, 20, "compiled"),
        ({"tolerance": "1e-10"}, 20, "compiled"),
        ({"tier": "standard"}, 20, "compiled"),
        ({"tolerance": "1e-12"}, 20, "compiled"),
        # Late, that error of the period has added up: the kernel of high knows it in balls.
        ({"tolerance": "1e-9"}, 20_000, "compiled"),
    ],
)
def test_a_loose_tolerance_takes_a_single_job_the_way_of_blocks(accuracy, stop, way):
    document = read_sweep(sweep((LAMBDA, values("7/10")), accuracy=accuracy)).document(0)
    outcome = solve_checked(json.dumps({**document, "time": {"stop": stop, "samples": 5}}))
    assert way in outcome.summary["evidence"]
    assert outcome.summary["error"] <= float(accuracy.get("tolerance", "1e-10"))
