"""Traces that are theorems: tables, other ways to them, and that wrong ones are outside."""

import json
import math
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, arb_mat, ctx

from service.dynamics.formula.algebras.ball import ball
from service.dynamics.solution.dense_output import exact_middle
from service.jobs.records import Solved
from service.schemas.problem.problem import read_problem
from service.schemas.replies.text import describe_solution
from service.schemas.sweep.sweep import kept_numbers
from service.storage.codecs.summary import summary_columns
from tests.conformance.classical.specimens import FREE, LOOPS, WORKED, document, placed, random_documents
from tests.support import doubled_series
from tests.support.effort import one_in
from tests.support.random_states import unit_vector
from tests.workers.solvers.stability.test_lame import MOMENTS, TRACES
from workers.computation.compute import solve_document
from workers.solvers.choose import enclose
from workers.solvers.stability.monodromy import transverse_stability
from workers.solvers.stability.proven import proven_time, proven_turn, weights_of_powers

CERTIFIED = {"tier": "certified"}


def summary(body, potential, motion, outputs=("stability",), **fields):
    text = {"type": "expression", "expression": potential} if isinstance(potential, str) else potential
    asked = {"body": body, "potential": text, "motion": motion, "time": {"stop": 1, "samples": 2}}
    outcome = solve_document(json.dumps({**asked, "outputs": ["gamma", "omega", *outputs], **fields}))
    assert isinstance(outcome, Solved), outcome
    return outcome.summary


def enclosed(number):
    return ball(Fraction(number["value"])) + arb(0, ball(Fraction(number["radius"])))


def certified(B, potential, nu):
    motion = {"type": "planar", "nu": nu}
    return summary({"A": 2, "B": B, "C": 1, "allow_unphysical": True}, potential, motion, accuracy=CERTIFIED)


@pytest.mark.parametrize(
    ("nu", "B", "trace"),
    one_in(4, [(nu, B, t) for nu in TRACES for B, t in zip(MOMENTS, TRACES[nu], strict=True)]),
)
def test_the_tabulated_trace_is_inside_and_wrong_ones_are_outside(nu, B, trace):
    found = certified(B, "-g1", nu)
    stability = found["stability"]
    assert (stability["proof"], found["error_kind"]["stability"]) == ("theorem", "theorem")
    # Both multipliers are 1 with B = 1, and how fast neighbours part is not told by the trace.
    assert found["error_kind"]["stability.trusted_time"] == ("estimate" if B == "1" else "theorem")
    inside = enclosed(stability["trace"])
    with ctx.workprec(128):
        exact = transverse_stability(Fraction(nu), Fraction(B)).trace
        assert inside.overlaps(exact)
        # Half a unit of the last digit printed.
        assert inside.overlaps(arb(trace, 5e-13))
        # Nor is it so wide that it says nothing: doubles carry the derivative of the flow.
        assert not inside.overlaps(exact + 1e-7 * (1 + abs(exact)))
        assert not inside.overlaps(exact - 1e-7 * (1 + abs(exact)))
    assert stability["verdict"] == ("marginal" if B == "1" else "unstable" if abs(trace) > 2 else "stable")


def test_what_is_exactly_2_stays_marginal_and_beside_it_is_not():
    """The energy of these motions has dh/dν = 0 where ν³ = 8 b: both multipliers are 1."""
    at = certified("3/2", "g1 + 1/8/g3^2 - 3*(g1^2 - g2^2)", "1")["stability"]
    assert at["verdict"] == "marginal"
    assert enclosed(at["trace"]).contains(2)
    beside = certified("3/2", "g1 + 1/10/g3^2 - 3*(g1^2 - g2^2)", "1")["stability"]
    assert beside["verdict"] == "unstable"
    # By a Taylor integration of the six equations, which vouches for 2e-12.
    assert enclosed(beside["trace"]).overlaps(arb(5.863685198505, 2e-12))


def test_a_classical_motion_with_zero_areas_is_the_planar_one():
    """Bobylev's and Steklov's: by the case's state and period, and by Lamé's equation in theta functions."""
    (worked,) = (each for each in WORKED if each.name == "bobylev_steklov" and each.areas == 0.0)
    stability = summary(worked.body, {"type": "gravity", **worked.potential}, worked.document["motion"])[
        "stability"
    ]
    # ν = −2 C p²/a = −8/25, whose sign is that of g1; A = 2, C = 1.
    with ctx.workprec(128):
        exact = transverse_stability(Fraction(8, 25), Fraction(3, 2)).trace
        assert abs(arb(stability["trace"]) - exact) < stability["error"]
    assert stability["error"] <= 1e-8


@pytest.mark.parametrize("name", one_in(3, [name for name in LOOPS if name in FREE]))
def test_multipliers_of_classical_cases_are_those_of_series(name):
    (drawn,) = random_documents(name, 5, 1)
    found = summary(drawn["body"], drawn["potential"], drawn["motion"], ("stability", "period"))
    stability, there = found["stability"], placed(drawn)
    terms = [(each, *unit_vector(axis)) for axis, each in enumerate(there.motion.centre) if each]
    moments = (there.body.A, there.body.B, there.body.C)
    state = (*there.start.omega, *there.start.gamma)
    period = Fraction(found["period"]["value"])
    carried = doubled_series.Motion(moments, tuple(terms)).carried(state, period)
    trace = sum(row[n] for n, row in enumerate(carried)) - 4
    # The period is that of doubles, 1e-15 of itself; its share of the trace is below the radius.
    assert abs(Fraction(stability["trace"]) - trace) <= Fraction(stability["error"])
    assert stability["proof"] == found["error_kind"]["stability.trusted_time"] == "theorem"


def turn_of(nu, B):
    """Return the proven turn of A = 2, C = 1, V = -g1, the state at t = 0, and Lamé's |μ|."""
    document = {"body": {"A": 2, "B": B, "C": 1, "allow_unphysical": True},
                "potential": {"type": "expression", "expression": "-g1"},
                "motion": {"type": "planar", "nu": nu}, "time": {"stop": 1, "samples": 2}}  # fmt: skip
    problem = read_problem(document)
    proven = enclose(problem.body, problem.potential, problem.motion, [Fraction(0)], 128)
    turn = proven_turn(problem.body, problem.potential.tape, lambda: proven.states[0], proven.period)
    with ctx.workprec(128):
        size = abs(transverse_stability(Fraction(nu), Fraction(B)).trace)
        multiplier = float((size + (size * size - 4).sqrt()) / 2) if size > 2 else 1.0
    return turn, tuple(map(exact_middle, proven.states[0])), multiplier


COUNTS = (0, 1, 3, 10, 40)


def largest_sums(turn, state, B):
    """Return Σ‖Φ(t) M^k‖, k ≤ n, for each n of COUNTS, the largest over some t, by doubled series."""
    motion = doubled_series.Motion((2, Fraction(B), 1), ((Fraction(-1), 1, 0, 0),))
    period = exact_middle(turn.period)
    unit = max(1, Fraction(2 * math.pi / float(period)))
    scale = [unit] * 3 + [1] * 3

    def carried(share):
        rows = motion.carried(state, share * period)
        return arb_mat(
            [[ball(x * scale[j] / scale[i]) for j, x in enumerate(row)] for i, row in enumerate(rows)]
        )

    with ctx.workprec(256):
        ways = [carried(Fraction(share, 8)) for share in range(9)]
        sums, found, power = np.zeros(len(ways)), [], carried(0)
        for n in range(COUNTS[-1] + 1):
            for k, way in enumerate(ways):
                sums[k] += float(sum(x * x for x in (way * power).entries()).sqrt().mid())
            found += [sums.max()] if n in COUNTS else []
            power = ways[-1] * power
    return np.array(found)


@pytest.mark.parametrize(("nu", "B"), [("1", "3"), ("2", "3")], ids=["on the unit circle", "real"])
def test_the_growth_of_all_periods_is_bounded_and_wrong_bounds_are_caught(nu, B):
    turn, state, _ = turn_of(nu, B)
    truth = largest_sums(turn, state, B)

    def bounds(trace, sizes):
        return np.array([sizes @ weights_of_powers(trace, n) for n in COUNTS])

    sizes = turn.sizes[-1, 1:]
    claimed = bounds(turn.trace, sizes)
    assert np.all(truth <= claimed)
    # Norms of four parts are added, whatever their directions are: up to 1.9 times what is there.
    assert np.all(claimed <= 4.0 * truth)
    # A shear that is left out, a multiplier that is a tenth too small.
    wrong = bounds(turn.trace, sizes * [1, 0, 1, 1]) if nu == "1" else bounds(0.9 * turn.trace, sizes)
    assert not np.all(truth <= wrong)


def test_proven_times_of_an_unstable_motion_are_those_of_its_multiplier():
    turn, _, multiplier = turn_of("2", "3")
    one, other = (proven_time(turn, tolerance) for tolerance in (1e-10, 1e-10 * multiplier**5))
    # The other parts of what grows are smaller than a step of the enclosed motion tells.
    assert abs(other - one - 5.0 * float(turn.period)) <= max(np.diff(turn.begins))
    # No multiplier is 1 for good: a rounding of the largest number is where the tolerance is below it.
    assert proven_time(turn, 1e-16) == 0.0
    assert proven_time(turn_of("1", "3")[0], 1e3) is None


def test_the_precession_is_enclosed():
    found = summary(
        {"A": 2, "B": 2, "C": 1}, "-g1", {"type": "planar", "nu": 1}, ("orientation",),
        accuracy={**CERTIFIED, "bits": 128},
    )["precession"]  # fmt: skip
    with ctx.workprec(128):
        # Two independent quadratures, to 28 digits.
        known = ball(Fraction("3.61050523508724966610354854487"))
        assert enclosed(found["psi1"]).overlaps(known + arb(0, 1e-29))
        assert enclosed(found["psi3"]).overlaps(known - 2 * arb.pi() + arb(0, 1e-29))
    assert all(Fraction(each["radius"]) < Fraction(1, 10**30) for each in found.values())
    still = summary({"A": 2, "B": 2, "C": 1}, "-g1 + 1/20/g3^2", {"type": "planar", "nu": 1},
                    ("orientation",), accuracy=CERTIFIED)  # fmt: skip
    assert still["precession"]["psi1"] == {"value": "0", "radius": "0"}


def test_a_trace_in_balls_is_a_number_to_lists_sweeps_and_people():
    found = certified("3", "-g1", "2")
    trace = found["stability"]["trace"]
    assert summary_columns(found["problem"], found)["trace"] == float(trace["value"])
    value, error = kept_numbers(found, ["stability.trace", "stability.trace.error"])
    # The error is that of the double, a rounding more than the radius.
    assert (value, error) == (float(trace["value"]), pytest.approx(float(trace["radius"]), rel=1e-2))
    (line,) = (line for line in describe_solution(found) if line.startswith("stability"))
    assert line.endswith(f"unstable, trace {trace['value']} ± {trace['radius']} (theorem)")


def test_a_motion_that_does_not_close_has_no_multipliers():
    staude = document("staude", {"A": 3, "B": 2, "C": "3/2"}, {"a": 1, "b": "1/2", "c": "1/4"},
                      {"gamma": [1, -1, None]})  # fmt: skip
    found = summary(staude["body"], staude["potential"], staude["motion"])
    assert found["stability"] is None
    assert [warning["code"] for warning in found["warnings"]] == ["stability_undefined"]
