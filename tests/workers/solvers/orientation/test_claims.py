"""What is claimed of the attitude of whole jobs, against proven places and the integral along the curve.

The attitude is a function of the place: dψ1/dv = A g1 Z/(C c (1 − g1²)) and dψ3/dv = −Z g1/(c (1 − g3²)) in
the loop's coordinate v (for A < C with both axes exchanged and turned round). The places come from the
certified tier, the integrals from rigorous quadrature: no series, no time, and no digit of a job is in them.
"""

import json
from dataclasses import replace
from fractions import Fraction
from functools import cache
from itertools import accumulate, pairwise

import numpy as np
import pytest
from flint import acb, arb, ctx
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.accuracy import TIER_TOLERANCES
from service.dynamics.equations.orientation import (
    QUATERNION,
    orientation_columns,
    orientation_errors,
    trajectory_errors,
)
from service.dynamics.motion import COLUMNS, PlaceError
from service.dynamics.reduction.geometry.loop import make_loop
from service.jobs.records import Refused, Solved
from service.schemas.problem.problem import read_problem
from service.storage.codecs.packing import decode_arrays, decode_dense
from tests.support.effort import examples
from tests.support.witnesses.rotation_matrix import rotation_matrix
from workers.computation.compute import solve, solve_document
from workers.solvers.choose import enclose
from workers.solvers.orientation.solve import with_orientation

TIMES = [Fraction(k, 4) for k in range(41)]
BITS = 64


def document(body, text, motion, tier="standard", **fields):
    return {
        "body": dict(zip("ABC", body, strict=True)),
        "potential": {"type": "expression", "expression": text},
        "motion": {"type": "planar", **motion},
        "time": {"stop": 10, "samples": 41},
        "outputs": ["gamma", "omega", "orientation"],
        "accuracy": {"tier": tier},
        **fields,
    }


MOTIONS = {
    "through the poles": ((2, "3/2", 1), "-g1", {"nu": 1}),
    "rest to equator": ((2, "3/2", 1), "-g1 + 1/20/g3^2", {"lambda": 1}),
    "rest to rest": ((2, "3/2", 1), "-g1 + 1/(50*g3^2) + 6/5*(g1^2 - g2^2)", {"lambda": 1, "window": 0}),
    "A = 3C": ((3, "5/2", 1), "(3*g1^2 + g3^2)*(g2^2 - 1/2 + g2^3/5)", {"lambda": "4/5", "window": 0}),
    "A = 4C": ((4, "7/2", 1), "-g1*(4*g1^2 + 3*g3^2) + (4*g1^2 + g3^2)/10", {"lambda": "9/10"}),
    "C = 2A": ((1, "3/2", 2), "-g3", {"lambda": "4/5"}),
    "a function": ((2, "3/2", 1), "(2*g1^2 + g3^2)*(exp(g2) - 2) - g1", {"lambda": 1}),
}


@cache
def attitude_at_times(text):
    """γ, ψ1 and ψ3 at TIMES as doubles, from balls, by the place on the curve; α is a whole number."""
    problem = read_problem(json.loads(text))
    proven = enclose(problem.body, problem.potential, problem.motion, TIMES, BITS)
    with ctx.workprec(2 * BITS):
        loop = make_loop(problem.body, problem.potential, problem.motion).refined()
        places = list[arb]()
        for state in proven.states:
            place = _place(loop, state)
            # Between neighbouring times it goes on by less than half a turn.
            turns = round((float(places[-1]) - float(place)) / (2 * np.pi)) if places else 0
            places.append(place + 2 * arb.pi() * turns)
        first, third = (_sums(loop, axis, places) for axis in (1, 3))
        assert all(psi.rad() < 1e-17 for psi in first + third)
    if loop.mirrored:
        first, third = [-psi for psi in third], [-psi for psi in first]
    rows = [
        [float(x) for x in (*state[3:], one, three)]
        for state, one, three in zip(proven.states, first, third, strict=True)
    ]
    return np.array(rows)


def _c(loop, sine):
    alpha = int(loop.alpha)
    return (loop.Z**2 + loop.G**2 * sum((sine ** (2 * k) for k in range(1, alpha)), 1)).sqrt()


def _place(loop, state):
    g1, g2, g3 = state[3:]
    sine = (g1 if loop.mirrored else g3) / loop.Z
    return arb.atan2(sine, g2 / _c(loop, sine))


def _sums(loop, axis, places):
    """∫ dψ/dv dv of the primed axes from the first place on; for an odd α sin v keeps its sign."""
    alpha = int(loop.alpha)

    def rate(v, _):
        sine = v.sin()
        g1, g3, c = loop.g1_sign * loop.G * sine**alpha, loop.Z * sine, _c(loop, sine)
        return alpha * g1 * loop.Z / (c * (1 - g1 * g1)) if axis == 1 else -loop.Z * g1 / (c * (1 - g3 * g3))

    steps = (acb.integral(rate, acb(one), acb(other)).real for one, other in pairwise(places))
    return list(accumulate(steps, initial=arb(0)))


def rotation(gamma, psi1):
    """The matrix with γ in its third row, whose first column has the azimuth ψ1."""
    g1, g2, g3 = gamma.T
    c, zero = np.hypot(g2, g3), 0.0 * g1
    u = np.stack([-g1 * np.cos(psi1), -g1 * np.sin(psi1), c], axis=1)
    n = np.stack([np.sin(psi1), -np.cos(psi1), zero], axis=1)
    e1 = np.stack([c * np.cos(psi1), c * np.sin(psi1), g1], axis=1)
    e2, e3 = (
        (g2[:, None] * u - g3[:, None] * n) / c[:, None],
        (g3[:, None] * u + g2[:, None] * n) / c[:, None],
    )
    return np.stack([e1, e2, e3], axis=2)


def held_against_the_curve(asked):
    """Return the largest errors of ψ1, ψ3 and the rotation, and the claims of a trajectory."""
    outcome = solve_document(json.dumps(asked))
    assert isinstance(outcome, Solved), outcome
    times = np.array([float(t) for t in TIMES])
    dense = decode_dense(outcome.dense)
    columns, claims = orientation_columns(dense, times), trajectory_errors(dense, times)
    exact = attitude_at_times(json.dumps({**asked, "accuracy": {"tier": "high"}}))
    R = rotation_matrix(np.stack([columns[name] for name in QUATERNION], axis=1))
    errors = {
        name: float(np.abs(columns[name] - exact[:, k]).max()) for name, k in (("psi1", 3), ("psi3", 4))
    }
    errors["R"] = float(np.abs(R - rotation(exact[:, :3], exact[:, 3])).max())
    return errors, claims


# Of an angle of 6 rad, and of the doubles that the reference and the rotation are told in.
ROUNDING = 4e-15


@pytest.mark.one_in(4)
@pytest.mark.parametrize("tier", ["draft", "standard", "high"])
@pytest.mark.parametrize("name", MOTIONS)
def test_a_tier_keeps_its_promise_for_the_attitude_and_claims_no_less_than_it_errs(name, tier):
    errors, claims = held_against_the_curve(document(*MOTIONS[name], tier))
    assert errors["psi1"] <= claims["psi1"] + ROUNDING
    assert errors["psi3"] <= claims["psi3"] + ROUNDING
    # Every entry of a rotation is quadratic in the quaternion, of length 1.
    assert errors["R"] <= 4 * claims["q0"] + ROUNDING
    # Relative where an angle is above 1: these get to 6.
    assert claims["q0"] <= TIER_TOLERANCES[tier]
    assert max(claims["psi1"], claims["psi3"]) <= 6 * TIER_TOLERANCES[tier]


@pytest.mark.parametrize("name", MOTIONS)
def test_the_attitude_is_claimed_about_as_well_as_the_variables(name):
    """Errors of the variables do not add up along a planar motion: by the place they count at both ends."""
    _, claims = held_against_the_curve(document(*MOTIONS[name]))
    six = max(claims[column] for column in COLUMNS)
    # |dψ| is at most 1.5 times the largest component of |dg| here, twice; and roundings of the series.
    assert max(claims["psi1"], claims["psi3"]) <= 3 * six + 1e-13


@settings(max_examples=examples(6, 200), deadline=None)
@given(
    nu=st.fractions(Fraction(1, 5), 5, max_denominator=20),
    wall=st.fractions(0, Fraction(1, 5), max_denominator=50),
    well=st.fractions(-1, 1, max_denominator=20),
    tier=st.sampled_from(["draft", "standard", "high"]),
)
def test_no_claim_of_an_attitude_is_exceeded(nu, wall, well, tier):
    text = f"-g1 + ({wall})/g3^2 + ({well})*(2*g1^2 + g3^2)*g2"
    asked = document((2, "3/2", 1), text, {"nu": str(nu)}, tier)
    if isinstance(solve_document(json.dumps(asked)), Refused):
        return  # several windows, none, or a promise that is not kept
    errors, claims = held_against_the_curve(asked)
    assert errors["psi1"] <= claims["psi1"] + ROUNDING
    assert errors["psi3"] <= claims["psi3"] + ROUNDING
    assert errors["R"] <= 4 * claims["q0"] + ROUNDING


FROM_A_STATE = {"type": "state", "omega": ["2/5", "1/10", "9/10"], "gamma": ["3/5", 0, "4/5"]}


@pytest.mark.parametrize(
    ("tier", "stop"), [("draft", 10), ("draft", 100), ("standard", 10), ("standard", 1000)]
)
def test_a_promise_that_cannot_be_kept_for_the_attitude_is_refused(tier, stop):
    """Errors of the variables do add up from a state: a finer motion is tried, and else none is given."""
    plain = document((2, "3/2", 1), "g1 - g3/2", {}, tier)
    asked = {**plain, "motion": FROM_A_STATE, "time": {"stop": stop, "samples": 9}}
    outcome = solve_document(json.dumps(asked))
    if isinstance(outcome, Refused):
        assert (outcome.error["code"], outcome.error["pointer"]) == ("accuracy_not_met", "/accuracy/tier")
        assert stop == 1000
        return
    columns = decode_arrays(outcome.samples)
    claims = orientation_errors(decode_dense(outcome.dense), columns["t"])
    assert set(claims) == {*QUATERNION, "psi1", "psi3"}
    for name, claim in claims.items():
        assert claim <= TIER_TOLERANCES[tier] * max(1.0, np.abs(columns[name]).max())


@pytest.mark.parametrize("name", ["rest to equator", "A = 3C"])
def test_an_attitude_claims_what_a_place_that_is_late_makes_of_it(name):
    """A time that is off turns the body on by its rates: by its own function of time, a little later."""
    motion, late = solve(read_problem(document(*MOTIONS[name]))), 1e-7
    # Errors of p and r that are large hide nothing of it.
    wide = replace(motion, dense=replace(motion.dense, error=1.0))
    dense = with_orientation(replace(wide, place_error=PlaceError(late))).dense
    times = np.linspace(0.0, dense.period.hi, 400)
    here, there = (orientation_columns(dense, times + by) for by in (0.0, late))
    for each in ("psi1", "psi3"):
        moved = there[each] - here[each]
        # ψ is 0 at t = 0, wherever the body is then: the start is as late as the rest.
        apart = np.abs(moved - moved[0]).max()
        # Twice the largest rate, for both ends, and roundings.
        assert apart <= dense.errors[each] <= 2.01 * np.abs(moved).max()
    # An error of p and r alone is none of the attitude.
    alone = with_orientation(
        replace(motion, place_error=PlaceError(), dense=replace(motion.dense, error=late))
    )
    assert max(alone.dense.errors.values()) <= 1e-3 * late
