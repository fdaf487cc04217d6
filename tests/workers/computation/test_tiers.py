"""What each tier promises, kept; and the tier that a tolerance or a budget stands for."""

import json
import re

import numpy as np
import pytest

from service.dynamics.accuracy import TIER_TOLERANCES
from service.jobs.records import Refused, Solved
from service.schemas.problem.problem import read_problem
from service.storage.codecs.packing import decode_arrays, decode_dense
from tests.support.golden import GOLDEN
from workers.computation.compute import solve_checked, solve_document


def document(golden, accuracy, **fields):
    return {
        "body": golden.body,
        "potential": golden.potential,
        "motion": golden.motion,
        "time": {"times": list(golden.states)},
        "accuracy": accuracy,
        **fields,
    }


def gap(outcome, golden):
    columns = decode_arrays(outcome.samples)
    rows = np.array([[float(x) for x in row] for row in golden.states.values()])
    return float(np.abs(np.stack([columns[n] for n in ("p", "r", "g1", "g2", "g3")], axis=1) - rows).max())


@pytest.mark.parametrize("tier", ["draft", "standard", "high", "certified"])
@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden.name)
def test_every_tier_keeps_its_promise_on_the_golden_numbers(golden, tier):
    outcome = solve_document(json.dumps(document(golden, {"tier": tier})))
    assert isinstance(outcome, Solved), outcome
    assert outcome.summary["tier"] == tier
    claimed = outcome.summary["error"]
    # The golden digits, rounded to doubles as the samples are, add an ulp of a number of size 1.
    assert gap(outcome, golden) <= claimed + 2.3e-16
    assert claimed <= max(TIER_TOLERANCES[tier], 3e-16)


@pytest.mark.parametrize(
    ("tolerance", "tier"), [("1e-3", "draft"), ("1e-6", "draft"), ("1e-9", "standard"), ("1e-12", "high")]
)
def test_a_tolerance_stands_for_the_cheapest_tier_that_keeps_it(tolerance, tier):
    golden = GOLDEN[0]
    outcome = solve_document(json.dumps(document(golden, {"tolerance": tolerance})))
    assert isinstance(outcome, Solved), outcome
    assert outcome.summary["tier"] == tier
    assert outcome.summary["error"] <= float(tolerance)


@pytest.mark.parametrize("tolerance", ["2e-15", "1e-15"])
@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: golden.name)
def test_the_least_tolerance_is_kept_by_rounded_enclosures(golden, tolerance):
    outcome = solve_document(json.dumps(document(golden, {"tolerance": tolerance})))
    assert isinstance(outcome, Solved), outcome
    claimed = outcome.summary["error"]
    assert claimed <= float(tolerance)
    assert gap(outcome, golden) <= claimed + 2.3e-16  # as above
    assert outcome.summary["evidence"]["proven_samples"] in ("elliptic", "integral")
    # What lies between the samples says that it is worse.
    assert [notice["code"] for notice in outcome.summary["warnings"]] == ["proven_samples"]
    assert decode_dense(outcome.dense).error_at(decode_arrays(outcome.samples)["t"]) > claimed


LATE = {"time": {"times": ["1e9"]}}
LATER = {"time": {"times": ["1e14"]}}
"""Without a closed form the error of a period adds up; that of compiled code, 1e-25, by the later one."""


def test_late_times_that_doubles_do_not_reach_come_from_enclosures():
    golden = GOLDEN[4]  # A = 3C
    doubles, balls = (
        solve_document(json.dumps(document(golden, {"tier": tier}) | LATER)) for tier in ("high", "certified")
    )
    assert doubles.summary["error"] <= TIER_TOLERANCES["high"]
    mine, proven = decode_arrays(doubles.samples), decode_arrays(balls.samples)
    for name in ("p", "r", "g1", "g2", "g3"):
        assert mine[name] == proven[name]  # both are the doubles nearest to midpoints


def test_what_a_method_cannot_promise_at_that_time_is_refused_with_the_figure():
    late = document(GOLDEN[4], {"tier": "high"}, method="quadrature") | LATE
    outcome = solve_document(json.dumps(late))
    assert outcome.error["code"] == "accuracy_not_met"


def test_a_function_of_time_too_rough_to_be_cross_checked_is_refused_in_the_certified_tier():
    late = document(GOLDEN[4], {"tier": "certified"}) | {"time": {"times": ["1e12"]}}
    late["body"] = {**late["body"], "B": "5/2"}
    assert isinstance(solve_document(json.dumps(late)), Solved)
    checked = solve_document(json.dumps(late | {"method": "both"}))
    assert checked.error["code"] == "accuracy_not_met"


def test_numbers_whose_very_rounding_is_larger_than_the_tolerance_are_refused():
    fast = document(GOLDEN[0], {"tolerance": "1e-15"})
    fast["potential"] = {"type": "gravity", "a": "-1e6"}  # half an ulp of r = 1112 is 1e-13
    outcome = solve_document(json.dumps(fast))
    assert outcome.error["code"] == "accuracy_not_met"
    told = re.search(r"as (\S+), and the tolerance is 1.0e-15", outcome.error["detail"])
    # That, and as much for the decimals that are written, of the largest of the samples.
    assert 1e-14 < float(told[1]) <= 2.3e-13


def test_a_motion_without_enclosures_is_refused():
    endless = document(GOLDEN[0], {"tolerance": "1e-15"})
    endless["potential"] = {"type": "expression", "expression": "g2^2-g1^2"}  # falls into the pole for ever
    outcome = solve_document(json.dumps(endless))
    assert outcome.error["code"] == "accuracy_not_met"


def test_a_budget_becomes_a_tier():
    # An hour is enough for proofs.
    outcome = solve_checked(json.dumps(document(GOLDEN[0], {"budget_seconds": "3600"})))
    assert isinstance(outcome, Solved), outcome
    assert outcome.summary["tier"] == "certified"
    assert outcome.summary["problem"]["accuracy"] == {"tier": "certified"}


def test_a_budget_that_nothing_fits_is_told():
    outcome = solve_checked(json.dumps(document(GOLDEN[0], {"budget_seconds": "1e-9"})))
    assert isinstance(outcome, Refused)
    assert (outcome.error["code"], outcome.error["pointer"]) == (
        "budget_too_small",
        "/accuracy/budget_seconds",
    )
    assert "is expected to take" in outcome.error["detail"]


def test_the_way_of_a_tier_is_told_in_the_evidence():
    golden = GOLDEN[0]
    for tier in ("draft", "standard"):
        assert "compiled" in solve_document(json.dumps(document(golden, {"tier": tier}))).summary["evidence"]
    forced = document(golden, {"tier": "standard"}, method="quadrature")
    assert "nodes" in solve_document(json.dumps(forced)).summary["evidence"]
    assert read_problem(forced).method == "quadrature"


@pytest.mark.one_in(2)
@pytest.mark.parametrize("asked", [{"accuracy": {"tier": t}} for t in ("draft", "standard", "high")])
def test_a_potential_given_by_an_integral_is_left_to_the_balls(asked):
    # A = 2C, where the others have closed forms.
    potential = {"type": "general", "F": "exp(-w)", "G": "-3*(6/10-g2^2) + 3/10*g2"}
    motion = {"type": "planar", "lambda": 1}
    problem = {
        "body": {"A": 2, "B": 2, "C": 1},
        "potential": potential,
        "motion": motion,
        "time": {"periods": 1, "samples": 5},
        "outputs": ["gamma", "omega", "invariants", "stability"],
        **asked,
    }
    outcome = solve_document(json.dumps(problem))
    assert isinstance(outcome, Solved), outcome
    # h = −F(w0), and w0 = C nu² = 1.
    assert abs(outcome.summary["energy"]["value"] + np.exp(-1.0)) <= 1e-15
    assert outcome.summary["invariants"]["energy"]["drift"] <= 1e-13
    columns = decode_arrays(outcome.samples)
    # It closes: each end has the claimed error.
    for name in ("p", "r", "g1", "g2", "g3"):
        assert abs(columns[name][0] - columns[name][-1]) <= 2 * outcome.summary["error"]
