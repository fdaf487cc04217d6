"""Certified motions that no quadrature encloses: from any state, aperiodic ones, and classical cases."""

import json
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx

from service.dynamics.formula.algebras.ball import ball
from service.jobs.records import Refused, Solved
from service.schemas.problem.problem import read_problem
from tests.conformance.classical.specimens import example
from workers.computation.compute import certified_samples, solve_checked
from workers.solvers.certified.validated.enclose import is_narrow
from workers.solvers.choose import enclose

BODY = {"A": 2, "B": "3/2", "C": 1}
STATE = {"type": "state", "omega": ["1/3", "1/2", 1], "gamma": ["3/5", 0, "4/5"]}
NU_1 = {"type": "planar", "nu": 1}
COLLIDING = {"type": "rational", "a": [-1], "b": ["-1/20"], "c": ["-1/2"]}


def document(**sections: object) -> dict[str, object]:
    return {
        "body": BODY,
        "potential": {"type": "expression", "expression": "-g1 + g2*g3/3"},
        "motion": STATE,
        "time": {"start": -1, "stop": 2, "samples": 4},
        "accuracy": {"tier": "certified"},
        "outputs": ["gamma", "omega", "invariants"],
    } | sections


def solved(**sections: object) -> Solved:
    outcome = solve_checked(json.dumps(document(**sections)))
    assert isinstance(outcome, Solved), outcome
    return outcome


def refused(**sections: object) -> Refused:
    outcome = solve_checked(json.dumps(document(**sections)))
    assert isinstance(outcome, Refused)
    return outcome


def test_the_function_of_time_of_a_state_is_proven_and_its_claim_is_not_far_above_its_error():
    problem = read_problem(document(time={"times": [Fraction(k, 7) for k in range(-9, 15)]}))
    motion, proven, columns = certified_samples(problem)
    times = np.array([float(t) for t in problem.time.times])
    with ctx.workprec(100):
        low = np.array(
            [float(ball(exact) - arb(t)) for exact, t in zip(problem.time.times, times, strict=True)]
        )
        values = motion.dense(times, low)
        actual = [
            float(abs(arb(value) - state).abs_upper())
            for row, states in zip(values.tolist(), proven.states, strict=True)
            for value, state in zip(row, states, strict=True)
        ]
    assert all(is_narrow(value, 64) for state in proven.states for value in state)
    # A theorem about all roundings of an evaluation, of which few go the same way.
    assert max(actual) <= motion.dense.error <= 200.0 * max(actual)
    assert {f"{name}.radius" for name in ("p", "q", "r", "g1", "g2", "g3")} <= set(columns)


def test_the_energy_of_a_state_is_enclosed_and_its_motion_has_no_period():
    summary = solved().summary
    # (2/9 + 3/8 + 1)/2 - 3/5 = 143/720
    energy = summary["energy"]
    assert abs(Fraction(energy["value"]) - Fraction(143, 720)) <= Fraction(energy["radius"]) < 1e-20
    assert (summary["period"], summary["method"], summary["tier"]) == (None, "integration", "certified")
    assert summary["error"] < 1e-15
    assert summary["invariants"]["energy"]["drift"] < 1e-14


def test_an_integration_of_a_planar_motion_encloses_what_its_quadrature_does():
    sections = {
        "potential": {"type": "expression", "expression": "-g1"},
        "motion": {"type": "planar", "lambda": 1},
    }
    problem = read_problem(document(**sections, method="integration"))
    _, by_steps, _ = certified_samples(problem)
    by_quadrature = enclose(problem.body, problem.potential, problem.motion, [Fraction(2)], 128)
    assert all(x.overlaps(y) for x, y in zip(by_steps.states[-1], by_quadrature.states[0], strict=True))


def test_a_collision_is_proven_until_shortly_before_it():
    """The time of the collision is that of its quadrature (32 digits): 1.066475594076…"""
    kept = solved(potential=COLLIDING, motion=NU_1, time={"stop": "1066475/1000000", "samples": 2}).summary
    assert kept["aperiodic"] == "collision"
    late = refused(potential=COLLIDING, motion=NU_1, time={"stop": 2, "samples": 2}).error
    assert late["code"] == "certified_unavailable"
    assert "proven until t = 1.06647559" in late["detail"]


@pytest.mark.parametrize("name", ["goriatchev", "hess", "staude"])
def test_a_classical_motion_is_enclosed_from_its_exact_state(name):
    statement = example(name, accuracy={"tier": "certified"}, time={"stop": 2, "samples": 3})
    outcome = solve_checked(json.dumps(statement))
    high = solve_checked(json.dumps(statement | {"accuracy": {"tier": "high"}}))
    assert isinstance(outcome, Solved)
    assert isinstance(high, Solved)
    assert outcome.summary["error"] < 1e-14
    assert abs(float(outcome.summary["energy"]["value"]) - high.summary["energy"]["value"]) < 1e-13


@pytest.mark.parametrize(
    ("sections", "pointer", "reason"),
    [
        ({"potential": {"type": "expression", "expression": "abs(g2)"}}, "/accuracy", "kink"),
        (
            {
                "potential": {"type": "general", "F": "exp(-w)", "G": "g2"},
                "body": {"A": "17/10", "B": "7/5", "C": 1},
            },
            "/potential",
            "formula",
        ),
        ({**example("goriatchev"), "accuracy": {"tier": "certified", "bits": 333}}, "/accuracy/bits", "333"),
        ({**example("goriatchev"), "time": {"periods": 1, "samples": 2}}, "/time/periods", "period"),
    ],
)
def test_what_steps_do_not_prove_is_refused_with_the_reason(sections, pointer, reason):
    error = refused(**sections).error
    assert error["code"] == "certified_unavailable"
    assert error["pointer"].startswith(pointer)
    assert reason in error["detail"]
