"""What the outputs ask for beyond the six variables, from the document to the solution."""

import json
import math
from fractions import Fraction

import numpy as np
import pytest

from service.jobs.records import Refused, Solved
from service.schemas.replies.text import describe_solution
from service.storage.codecs.packing import decode_arrays
from workers.computation.compute import solve_document

NU_1 = {"type": "planar", "nu": 1}


def solve(potential, motion=NU_1, outputs=("stability",), body=None, **fields):
    document = {
        "body": body or {"A": 2, "B": 2, "C": 1},
        "potential": potential
        if isinstance(potential, dict)
        else {"type": "expression", "expression": potential},
        "motion": motion,
        "time": {"stop": 3, "samples": 7},
        "outputs": ["gamma", "omega", *outputs],
        **fields,
    }
    outcome = solve_document(json.dumps(document))
    assert isinstance(outcome, Solved), outcome
    return outcome


def test_nothing_is_computed_that_is_not_asked():
    summary = solve("-g1", outputs=()).summary
    assert [summary[name] for name in ("invariants", "stability", "precession", "warnings")] == [None] * 3 + [
        []
    ]


def test_a_solution_says_which_known_case_its_problem_is():
    summary = solve("-g1", outputs=()).summary
    assert [each["name"] for each in summary["known_cases"]] == ["kovalevskaya", "bobylev_steklov"]
    assert "known case  kovalevskaya (S. Kovalevskaya, 1889)" in list(describe_solution(summary))


@pytest.mark.parametrize("method", ["auto", "integration"])
def test_stability_is_that_of_the_table(method):
    # A = 2, B = 3, C = 1, a = −1, nu = 2: mu + 1/mu and the larger |mu|, to the printed digits.
    found = solve("-g1", {"type": "planar", "nu": 2}, body={"A": 2, "B": 3, "C": 1}, method=method)
    stability = found.summary["stability"]
    assert abs(stability["trace"] - 7.205281206786) <= stability["error"] + 5e-13
    assert stability["verdict"] == "unstable"
    # Lamé's equation in theta functions: another way to the same number.
    closed = stability["closed_form_trace"]
    assert abs(stability["trace"] - closed["value"]) <= stability["error"] + closed["error"]
    assert closed["error"] <= 1e-15
    (mu, zero), (inverse, _) = stability["multipliers"]
    assert (round(mu, 5), zero) == (7.06371, 0.0)
    assert mu * inverse == pytest.approx(1.0, abs=1e-14)


def test_stability_of_a_motion_without_period_is_a_warning():
    summary = solve("-(g1^2-g2^2)").summary
    assert summary["stability"] is None
    assert [warning["code"] for warning in summary["warnings"]] == ["stability_undefined"]


def test_stability_where_the_force_jumps_at_a_pole_is_a_warning():
    summary = solve(
        "-abs(g1)^(4/3)", {"type": "planar", "lambda": 1}, body={"A": 3, "B": "5/2", "C": 1}
    ).summary
    assert summary["stability"] is None
    assert [warning["code"] for warning in summary["warnings"]] == ["stability_undefined"]


def test_precession_is_that_of_the_table_and_its_columns_are_served():
    outcome = solve("-g1", outputs=("orientation",))
    precession = outcome.summary["precession"]
    # nu = 1; the other angle is 2 pi less. A double rounds to 4e-16.
    assert abs(precession["psi1"]["value"] - 3.61050523508724966610354854487) <= precession["psi1"]["error"]
    assert abs(precession["psi1"]["value"] - precession["psi3"]["value"] - 2 * math.pi) <= 1e-15
    columns = decode_arrays(outcome.samples)
    assert set(columns) == {"t", "p", "q", "r", "g1", "g2", "g3", "q0", "q1", "q2", "q3", "psi1", "psi3"}
    q0, q1, q2, q3 = (columns[f"q{k}"] for k in range(4))
    third_row = [2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), q0**2 - q1**2 - q2**2 + q3**2]
    # The third row of the rotation is gamma; products of a few roundings.
    assert np.abs(np.array(third_row) - [columns[f"g{k}"] for k in (1, 2, 3)]).max() <= 1e-14
    assert max(abs(columns["psi1"][0]), abs(columns["psi3"][0])) <= 1e-16  # rounding of a series' sum


def test_a_libration_does_not_precess():
    precession = solve("-g1 + 1/20/g3^2", outputs=("orientation",), accuracy={"tier": "high"})
    for angle in precession.summary["precession"].values():
        assert abs(angle["value"]) <= angle["error"] <= 1e-12


STATE = {"type": "state", "omega": ["0.3", "0.2", "-0.5"], "gamma": ["0.6", "0", "0.8"]}


def test_a_state_has_kovalevskayas_integral_in_a_linear_field_only():
    invariants = solve("-g1", STATE, ("invariants",)).summary["invariants"]
    assert invariants["kovalevskaya"]["kind"] == "general"
    assert invariants["kovalevskaya"]["drift"] <= 1e-9  # the tolerance is 1e-10 in each variable of size 1
    assert set(solve("-g1 + 1/20/g3^2", STATE, ("invariants",)).summary["invariants"]) == {
        "energy",
        "geometric",
        "areas",
    }


def test_goriachevs_integral_is_there_on_zero_areas():
    found = solve("-g1 + 1/20/g3^2 + (g1^2-g2^2)/2", outputs=("invariants",)).summary["invariants"]
    # On the family K = (nu² + 4)(a1 nu + 2 b1)²/(4 C² nu²), here 1.0125; rounding of numbers of size 1.
    assert found["goriachev"]["kind"] == "zero_areas"
    assert abs(found["goriachev"]["value"] - 1.0125) <= 1e-13
    assert found["goriachev"]["drift"] <= 1e-13


def test_the_integral_of_goriachev_and_chaplygin_is_there_on_zero_areas():
    body = {"A": 4, "B": 4, "C": 1}
    # 4 (p g1 + q g2) + r g3 = 0.
    on_zero = {"type": "state", "omega": ["0.3", "0.2", "-0.9"], "gamma": ["0.6", "0", "0.8"]}
    found = solve("-g1", on_zero, ("invariants",), body=body).summary["invariants"]["goriachev_chaplygin"]
    # r (p² + q²) + g3 p at the start, by its own rounding; the tolerance is 1e-10 in each variable of size 1.
    assert found["kind"] == "zero_areas"
    assert abs(found["value"] - (-0.9 * 0.13 + 0.8 * 0.3)) <= 1e-15
    assert found["drift"] <= 1e-9
    elsewhere = solve("-g1", STATE, ("invariants",), body=body).summary["invariants"]
    assert set(elsewhere) == {"energy", "geometric", "areas"}


def test_a_body_without_these_moments_has_no_further_integral():
    found = solve("-g1", outputs=("invariants",), body={"A": 2, "B": "3/2", "C": 1}).summary["invariants"]
    assert set(found) == {"energy", "geometric", "areas"}


def test_a_job_that_ends_where_p_squared_is_infinite_says_when():
    document = {
        "body": {"A": 2, "C": 1},
        "potential": {"type": "expression", "expression": "-g1-(2*g1^2+g3^2)/20/(1/2-g2)"},
        "motion": {"type": "planar", "lambda": 1, "window": 1, "start": {"at": "equator", "s_sign": -1}},
        "time": {"stop": 1, "samples": 11},
    }
    outcome = solve_document(json.dumps(document))
    assert isinstance(outcome, Solved)
    summary = outcome.summary
    assert (summary["aperiodic"], summary["period"]) == ("collision", None)
    assert tuple(summary["window"]["ends"]) == ("pole", "equator")
    future = summary["asymptotes"]["future"]
    # 0.3640004182936566138400526, by a Taylor series at 300 bits.
    assert abs(future["time"]["value"] - 0.3640004182936566) <= future["time"]["error"] <= 1e-14
    assert (future["kind"], future["gamma"][1]) == ("collision", 0.5)
    assert decode_arrays(outcome.samples)["t"].tolist() == [0.0, 0.1, 0.2, 0.3]
    refused = solve_document(json.dumps({**document, "time": {"times": ["2/5", 1]}}))
    assert isinstance(refused, Refused)
    assert refused.error["code"] == "motion_ended"
    assert "0.36400041829365" in refused.error["detail"]


def bounded(document, path=""):
    """Yield the paths of all numbers of a document that have an error or a radius beside them."""
    if isinstance(document, dict):
        if {"value", "error"} <= set(document) or {"value", "radius"} <= set(document):
            yield path
        for name, part in document.items():
            yield from bounded(part, f"{path}.{name}" if path else name)


@pytest.mark.parametrize(
    ("potential", "motion", "fields", "known"),
    [
        ("-g1", NU_1, {}, {"samples": "estimate", "energy": "theorem", "stability": "estimate"}),
        ("-g1", NU_1, {"accuracy": {"tier": "certified"}}, {"samples": "theorem", "period": "theorem"}),
        # Doubles do not keep 1e-15: the samples are rounded enclosures, the function of time is not.
        ("-g1", NU_1, {"accuracy": {"tolerance": 1e-15}}, {"samples": "theorem", "function": "estimate"}),
        ("-g1", NU_1, {"method": "integration"}, {"samples": "difference", "energy": "estimate"}),
        ("-g1 + 1/20/g3^2", NU_1, {}, {"precession.psi1": "theorem", "precession.psi3": "theorem"}),
        # A double zero is approached like an exponential, whose rate is seen in two places.
        (
            "-g1 + (1+sqrt(5))/4*(g1^2-g2^2)",
            {**NU_1, "start": {"g1": "0.3"}},
            {},
            {"asymptotes.future.rate": "difference", "samples": "estimate"},
        ),
    ],
)
def test_every_error_says_how_it_is_known(potential, motion, fields, known):
    outputs = ("stability", *(["orientation"] if "precession.psi1" in known else []))
    summary = solve(potential, motion, outputs, **fields).summary
    kinds = summary["error_kind"]
    assert {**kinds, **known} == kinds
    assert set(bounded(summary)) <= set(kinds)
    assert ("stability" in kinds) == (summary["stability"] is not None)
    assert summary["stability"] is None or summary["stability"]["proof"] == kinds["stability"]


def test_a_period_that_is_a_theorem_is_within_a_narrower_theorem():
    exact = {"tier": "certified", "bits": 333}
    proven = solve("-g1 + 1/20/g3^2", outputs=(), accuracy=exact).summary
    told = solve("-g1 + 1/20/g3^2", outputs=(), accuracy={"tolerance": 1e-15}).summary
    assert told["error_kind"]["energy"] == "theorem"
    for name in ("period", "energy"):
        middle, radius = (Fraction(proven[name][part]) for part in ("value", "radius"))
        apart = abs(Fraction(repr(told[name]["value"])) - middle)
        assert apart <= Fraction(told[name]["error"]) + radius
