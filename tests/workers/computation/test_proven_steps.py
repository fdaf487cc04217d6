"""Certified motions that no quadrature encloses: from any state, aperiodic ones, and classical cases."""

import json
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx

from service.dynamics.formula.algebras.ball import ball
from service.jobs.records import Refused, Solved
from service.schemas.problem.problem import read_problem
from service.storage.codecs.packing import decode_arrays
from tests.conformance.classical.specimens import example
from workers.computation.compute import certified_samples, solve_checked
from workers.solvers.certified.certify import is_narrow
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


@pytest.mark.long
def test_a_collision_is_proven_until_shortly_before_it():
    """The time of the collision is that of its quadrature (32 digits): 1.066475594076…"""
    kept = solved(potential=COLLIDING, motion=NU_1, time={"stop": "1066475/1000000", "samples": 2}).summary
    assert kept["aperiodic"] == "collision"
    late = refused(potential=COLLIDING, motion=NU_1, time={"stop": 2, "samples": 2}).error
    assert late["code"] == "certified_unavailable"
    assert "proven until t = 1.06647559" in late["detail"]


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", ["goriatchev", "hess", "staude"])
def test_a_classical_motion_is_enclosed_from_its_exact_state(name):
    statement = example(name, accuracy={"tier": "certified"}, time={"stop": 2, "samples": 3})
    outcome = solve_checked(json.dumps(statement))
    high = solve_checked(json.dumps(statement | {"accuracy": {"tier": "high"}}))
    assert isinstance(outcome, Solved)
    assert isinstance(high, Solved)
    assert outcome.summary["error"] < 1e-14
    assert abs(float(outcome.summary["energy"]["value"]) - high.summary["energy"]["value"]) < 1e-13


def test_333_bits_of_a_classical_motion_begin_with_its_128():
    accuracies = ({"tier": "certified", "bits": bits} for bits in (128, 333))
    problems = (
        read_problem(example("goriatchev", accuracy=each, time={"times": [1]})) for each in accuracies
    )
    few, many = (certified_samples(each)[1].states[0] for each in problems)
    assert all(is_narrow(value, 333) for value in many)
    assert all(one.overlaps(other) for one, other in zip(few, many, strict=True))


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
        ({**example("goriatchev"), "time": {"periods": 1, "samples": 2}}, "/time/periods", "period"),
    ],
)
def test_what_steps_do_not_prove_is_refused_with_the_reason(sections, pointer, reason):
    error = refused(**sections).error
    assert error["code"] == "certified_unavailable"
    assert error["pointer"].startswith(pointer)
    assert reason in error["detail"]


def test_the_three_integrals_of_a_quick_state_are_enclosed_in_its_own_units():
    """ω of 1e4 is solved in other units; the areas integral is 2·1e4·3/5 + 4/5."""
    state = {"type": "state", "omega": [10**4, 0, 1], "gamma": ["3/5", 0, "4/5"]}
    found = solved(motion=state, time={"stop": "1/1000", "samples": 2}).summary["invariants"]
    V = -Fraction(3, 5)
    exact = {
        "energy": Fraction(2 * 10**8 + 1, 2) + V,
        "geometric": Fraction(1),
        "areas": Fraction(120008, 10),
    }
    for name, value in exact.items():
        number = found[name]["value"]
        # 88 bits of numbers up to 1e8.
        assert abs(Fraction(number["value"]) - value) <= Fraction(number["radius"]) < 1e-17


def test_the_attitude_is_proven_beside_the_variables():
    """The third row of the rotation is γ, the quaternion's length 1, and ψ1 the azimuth of the first axis."""
    _, proven, _ = certified_samples(read_problem(document(outputs=["orientation"])))
    assert proven.columns[-2:] == ("psi1", "psi3")
    for state in proven.states:
        with ctx.workprec(128):
            _require_attitude(*state)


def _require_attitude(*state):
    *six, a, b, c, d, psi1, psi3 = state
    g1, g2, g3 = six[3:]
    third = 2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d
    assert all(x.overlaps(y) and x.rad() < 2.0**-56 for x, y in zip(third, (g1, g2, g3), strict=True))
    assert (a * a + b * b + c * c + d * d).overlaps(arb(1))
    # The first axis of the body in space: (R11, R21); its azimuth turns from 0.
    first = a * a + b * b - c * c - d * d, 2 * (b * c + a * d)
    assert (first[0] * psi1.sin() - first[1] * psi1.cos()).contains(0)
    assert psi3.rad() < 2.0**-50


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("-g1", {"nu": 1}),  # through the poles, where q changes its sign in a period
        ("-g1 + 1/20/g3^2", {"lambda": 1}),
        ("-g1 + 1/(50*g3^2) + 6/5*(g1^2 - g2^2)", {"lambda": 1, "window": 0}),  # to and fro
    ],
)
def test_the_attitude_of_a_planar_motion_is_proven_by_one_period(text, asked):
    """It is that of steps which go all the way, in every period before t = 0 and after it."""
    sections = {
        "potential": {"type": "expression", "expression": text},
        "motion": {"type": "planar", **asked},
        "time": {"times": [-9, -4, 0, 1, 5, 8, 14]},
        "outputs": ["gamma", "orientation"],
    }
    _, proven, columns = certified_samples(read_problem(document(**sections)))
    _, all_the_way, _ = certified_samples(read_problem(document(**sections, method="integration")))
    assert proven.columns == all_the_way.columns
    assert proven.period is not None
    assert {round(float(t / proven.period)) for t in proven.times} >= {-1, 0, 1, 2}
    for one, other in zip(proven.states, all_the_way.states, strict=True):
        assert all(x.overlaps(y) for x, y in zip(one, other, strict=True))
        assert all(is_narrow(value, 64) for value in one)
        with ctx.workprec(128):
            _require_attitude(*one)
    assert {"q0", "q0.radius", "psi3", "psi3.radius"} <= set(columns)


def test_late_attitudes_of_a_planar_motion_are_theorems():
    """After 1e6 units of time; the azimuth has gone on by what it gains in each period."""
    sections = {
        "potential": {"type": "expression", "expression": "-g1"},
        "motion": NU_1,
        "time": {"times": [10**6]},
        "outputs": ["gamma", "orientation"],
    }
    outcome = solved(**sections)
    kinds, errors = outcome.summary["error_kind"], outcome.summary["errors"]
    assert kinds["orientation"] == kinds["precession.psi1"] == "theorem"
    (psi1,) = decode_arrays(outcome.samples)["psi1"]
    gained, period = outcome.summary["precession"]["psi1"], outcome.summary["period"]
    turns = Fraction(10**6) / Fraction(period["value"])
    # Within a period it gains no more than 4.
    assert abs(Fraction(psi1) - turns * Fraction(gained["value"])) < 4
    assert errors["psi1"]["absolute"] <= 2e-10  # a double of 6e5
    assert errors["quaternion"]["absolute"] <= 1e-15


def test_a_steady_spin_has_the_azimuth_of_its_time():
    """About the vertical first axis ψ3 = 2t, and ψ1 has no meaning."""
    state = {"type": "state", "omega": [2, 0, 0], "gamma": [1, 0, 0]}
    V = {"type": "expression", "expression": "-g1"}
    outcome = solved(motion=state, potential=V, outputs=["orientation"])
    assert [each["code"] for each in outcome.summary["warnings"]] == ["azimuth_undefined"]
    columns = decode_arrays(outcome.samples)
    assert "psi1" not in columns
    assert np.abs(columns["psi3"] - 2.0 * columns["t"]).max() == 0.0
    assert columns["psi3.radius"].max() < 1e-15


def test_the_limit_of_a_job_ends_steps_with_the_time_until_which_they_hold(monkeypatch):
    monkeypatch.setenv("POLHODE_JOB_SECONDS", "0.5")
    error = refused(time={"stop": 10**6, "samples": 2}).error
    assert error["pointer"].startswith("/time")
    assert "POLHODE_JOB_SECONDS" in error["detail"]
    assert "proven until t = " in error["detail"]


@pytest.mark.long
def test_a_chaotic_body_is_enclosed_to_t_50():
    """Neighbours part exponentially: what 64 bits say at the end, twice as many say too."""
    sections = {
        "body": {"A": 2, "B": 1, "C": "3/2"},
        "potential": {"type": "expression", "expression": "-4*g1 - 6*g2 + 2*g3 + 8*g1*g2 - 6*g3^2"},
        "motion": {"type": "state", "omega": [1, "3/2", "1/2"], "gamma": ["3/5", 0, "4/5"]},
        "time": {"stop": 50, "samples": 2},
    }
    accuracies = ({"tier": "certified", "bits": bits} for bits in (64, 128))
    problems = (read_problem(document(**sections, accuracy=each)) for each in accuracies)
    few, many = (certified_samples(each)[1] for each in problems)
    assert all(is_narrow(value, 64) for state in few.states for value in state)
    assert all(x.contains(arb(y.mid())) for x, y in zip(few.states[-1], many.states[-1], strict=True))
