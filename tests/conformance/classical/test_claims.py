"""Claims of the quadratures of classical cases, against Taylor series of the six equations with 90 digits."""

from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx

from service.dynamics.classical.classification import relations_of
from service.schemas.problem.problem import read_problem
from tests.conformance.classical.specimens import LOOPS, example, placed, random_documents
from tests.support.effort import examples, one_in, seldom
from tests.support.taylor import BITS, Equations, ball, integrate, state_at
from workers.computation.compute import solve

OTHERS = (
    "bobylev_steklov", "dokshevich_1965", "elliptic_x_minus_k_over_x", "goriatchev", "grioli",
    "konosevich_pozdnyakovich", "kowalewski", "steklov",
)  # fmt: skip
ORDER = 60


def error_and_claim(statement, tolerance=1e-10, stop=4, samples=9):
    """Return the largest error of the six variables over the asked times, and what is claimed."""
    asked = {"time": {"stop": stop, "samples": samples}, "accuracy": {"tolerance": tolerance}}
    problem = read_problem({**statement, **asked})
    motion = solve(problem)
    assert motion.method == "quadrature"
    start, body = placed(statement).start, problem.body
    with ctx.workprec(BITS):
        centre = tuple(ball(x) for x in problem.motion.centre)
        equations = Equations((body.A, body.B, body.C), lambda *_: centre, ORDER)
        state = [ball(x) for x in (*start.omega, *start.gamma)]
        steps = integrate(equations, state, lambda step, _: bool(step.start + step.length > stop))
        exact = [[float(x) for x in state_at(steps, ball(Fraction(t)))] for t in motion.times.tolist()]
    return float(np.abs(motion.samples - np.array(exact)).max()), motion.error


@pytest.mark.parametrize("name", ["hess", *seldom("chaplygin", *OTHERS)])
def test_no_claim_of_a_classical_motion_is_exceeded_and_none_is_far_too_large(name):
    error, claim = error_and_claim(example(name), 1e-12)
    assert error <= claim
    # Roundings of numbers up to 10 with their factors of safety, 4 on what is seen and 2 between.
    assert claim <= 5e-13


# References take up to ten seconds.
@pytest.mark.parametrize("name", one_in(9, LOOPS))
def test_what_high_promises_is_kept_and_true(name):
    error, claim = error_and_claim(example(name), 1e-13, 10, 101)
    assert error <= claim <= 1e-13


@pytest.mark.parametrize("name", one_in(4, LOOPS))
def test_states_of_a_case_are_no_farther_from_its_relations_than_their_roundings(name):
    statement = example(name, time={"stop": 10, "samples": 101})
    case = placed(statement)
    with ctx.workprec(BITS):
        angles = [2 * arb.pi() * k / 101 for k in range(101)]
        states = [case.in_client_axes(case.loop.state(angle)) for angle in angles]
        rounded = np.array([[float(x) for x in state] for state in states])
    # Half a unit of each of six variables, and as much again for the second order and the slopes' roundings.
    assert relations_of(case).distance(rounded) <= np.linalg.norm(np.spacing(np.abs(rounded)), axis=1).max()


@pytest.mark.random_law
def test_no_claim_of_a_motion_of_hess_is_exceeded():
    for statement in random_documents("hess", 5, examples(1, 60)):
        error, claim = error_and_claim(statement, 1e-8)
        assert error <= claim


@pytest.mark.long
def test_hess_keeps_what_high_promises_for_thirty_units_of_time():
    error, claim = error_and_claim(example("hess"), 1e-13, 30, 9)
    # Not met with 4 on the bound of the angle, which has a factor of its own.
    assert error <= claim <= 1e-13


@pytest.mark.long
def test_a_claim_of_hess_knows_how_errors_grow():
    """A start where the angle has come from: it leaves that periodic motion, and takes its errors with it."""
    statement = example("hess")
    back = solve(read_problem({**statement, "time": {"start": -200, "stop": 0, "samples": 2}})).samples[0]
    omega = [repr(float(back[0])), repr(float(back[1])), None]
    gamma = [repr(float(g)) for g in back[3:]]
    leaving = {**statement, "motion": {**statement["motion"], "omega": omega, "gamma": gamma}}
    claims = []
    for stop in (4, 16):
        error, claim = error_and_claim(leaving, 1e-6, stop, 5)
        assert error <= claim
        claims.append(claim)
    # A turn of the loop multiplies an error by 6.9, the square of the multiplier of y; there are some three.
    assert claims[1] > 30 * claims[0]
