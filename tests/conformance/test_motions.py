"""The examples of the catalogue are solved, integration agrees, and the named cases are what they are."""

import json
from fractions import Fraction

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from service.catalogue import cases
from service.dynamics.equations.euler_poisson import euler_poisson_rhs
from service.jobs.records import Solved
from service.schemas.problem.problem import read_problem
from tests.conformance.specimens import CATALOGUE, Specimen
from tests.conformance.transforms import scaled
from workers.computation.compute import solve, solve_checked, solve_document

every_example = pytest.mark.parametrize("specimen", CATALOGUE, ids=str)


def solved(document: dict, *, checked: bool = False) -> dict:
    outcome = (solve_checked if checked else solve_document)(json.dumps(document))
    assert isinstance(outcome, Solved), outcome
    return outcome.summary


@pytest.mark.one_in(3)
@every_example
def test_the_example_is_solved_as_it_stands(specimen: Specimen):
    summary = solved(specimen.document, checked=True)
    assert summary["method"] == "quadrature"
    assert summary["period"]["value"] > 0
    # The tolerance of the tier "standard".
    assert summary["error"] <= 1e-10
    assert all(invariant["drift"] <= 1e-10 for invariant in summary["invariants"].values())


@pytest.mark.one_in(3)
@every_example
def test_integration_of_the_six_equations_agrees(specimen: Specimen):
    problem = read_problem({**specimen.document, "time": {"stop": 1, "samples": 5}})
    motion = solve(problem)

    def rates(_: float, state: np.ndarray) -> np.ndarray:
        found = euler_poisson_rhs(problem.body, problem.potential, state[:3], state[3:])
        return np.concatenate([found.omega, found.gamma])

    witness = solve_ivp(rates, (0.0, 1.0), motion.samples[0], "DOP853", motion.times, rtol=1e-12, atol=1e-13)
    # Over one unit of time no example is so unstable that the integrator's 1e-12 would grow tenthousandfold.
    assert np.max(np.abs(witness.y.T - motion.samples)) < 1e-8


@pytest.mark.one_in(3)
@every_example
def test_four_times_the_potential_is_twice_as_fast(specimen: Specimen):
    document = {**specimen.document, "time": {"stop": 1, "samples": 2}}
    once, fourfold = solved(document), solved(scaled(document, Fraction(4)))
    # V -> k V: t -> t/√k and h -> k h, exactly. Each period is known to some 1e-15.
    assert fourfold["period"]["value"] == pytest.approx(once["period"]["value"] / 2, rel=1e-13)
    assert fourfold["energy"]["value"] == pytest.approx(4 * once["energy"]["value"], rel=1e-13, abs=1e-15)


@pytest.mark.parametrize("name", ["bobylev-steklov", "generalised-bobylev-steklov", "kovalevskaya"])
def test_p_is_constant_where_the_catalogue_says_so(name: str):
    (case,) = [case for case in cases() if case.name == name]
    problem = read_problem(case.example)
    # a = -1, C = 1 and λ = 1 in each: p = -(λ/A) sqrt(-2 a C).
    expected = -(2**0.5) / float(problem.body.A)
    motion = solve(problem)
    assert motion.samples[:, 0] == pytest.approx(expected, abs=motion.error)


def test_the_generalised_case_has_the_golden_period():
    (case,) = [case for case in cases() if case.name == "generalised-bobylev-steklov"]
    period = solved(case.example)["period"]
    assert abs(period["value"] - 9.853280909959509831372235188172033) <= period["error"]


@pytest.mark.parametrize("name", ["goriachev", "chaplygin", "kovalevskaya"])
def test_the_further_integral_has_its_printed_value(name: str):
    (case,) = [case for case in cases() if case.name == name]
    problem = read_problem(case.example)
    potential = case.example["potential"]
    if case.family == "gravity":
        a1, b1, c1 = float(potential["a"]), 0.0, 0.0
    else:
        a1, b1, c1 = (float(Fraction(potential.get(terms, [0])[0])) for terms in "abc")
    p, q, _, g1, g2, g3 = solve(problem).samples.T
    # |z² - a1 ζ/C + c1 g3²/C - b1 ζ²/(C g3²)|², z = p + iq, ζ = g1 + i g2, C = 1; on the curve nu = 1
    # it is (nu²+4) (a1 nu + 2 b1)²/(4 C² nu²).
    zeta = g1 + 1j * g2
    quotient = 0.0 if b1 == 0 else b1 * zeta**2 / g3**2
    further = np.abs((p + 1j * q) ** 2 - a1 * zeta + c1 * g3**2 - quotient) ** 2
    # The samples are known to some 1e-14; 1/g3² multiplies their errors by at most some hundred.
    assert further == pytest.approx(5 * (a1 + 2 * b1) ** 2 / 4, rel=1e-11)
