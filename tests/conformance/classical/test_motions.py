"""Each case as a motion: worked examples, quadrature against integration, closing, random bodies."""

import json
from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.classical.bodies import CASES
from service.dynamics.classical.classification import relations_of
from service.dynamics.equations.euler_poisson import areas_integral, energy_integral
from service.dynamics.errors import NearSeparatrixError
from service.schemas.problem.problem import read_problem
from tests.conformance.classical.specimens import (
    FREE,
    LOOPS,
    NAMES,
    WORKED,
    Worked,
    example,
    placed,
    random_documents,
)
from tests.support.effort import each_once, one_in
from workers.computation.compute import solve, solve_document
from workers.solvers.integration.solve import integrate_state

worked = pytest.mark.parametrize("case", WORKED, ids=str)
UNSTABLE = {"hess": 8, "steklov": 8, "chaplygin": 20, "konosevich_pozdnyakovich": 12}
"""How long an integration of the example stays on it to 1e-10; of the others it is longer."""


def motion_of(document, **other):
    return solve(read_problem({**document, **other}))


@worked
def test_a_worked_example_lies_on_the_motion_and_has_its_period(case: Worked):
    motion = motion_of(case.document)
    # Both numbers are rounded to doubles; the published ones have 16 digits.
    assert motion.dense.period.hi == pytest.approx(case.period, rel=1e-13)
    assert motion.energy.value == pytest.approx(case.energy, abs=1e-13)
    state = np.array([[*case.omega, *case.gamma]])
    # Rounding of a state of size 5, through relations of slope 10.
    assert relations_of(placed(case.document)).distance(state) < 1e-13
    body = read_problem(case.document).body
    assert areas_integral(body, state[:, :3], state[:, 3:])[0] == pytest.approx(case.areas, abs=1e-13)


@worked
def test_integrated_from_a_worked_state_the_relations_stay_and_the_motion_closes(case: Worked):
    problem = read_problem(case.document)
    times = np.append(np.linspace(0, case.span, 101), case.period)
    found = integrate_state(problem.body, problem.potential, case.omega, case.gamma, times, tolerance=1e-9)
    relations = relations_of(placed(case.document))
    assert max(relations.drifts(found.samples[:-1]).values()) < 1e-10
    # The worked states have 17 digits, which an unstable orbit multiplies in a period.
    assert np.abs(found.samples[-1] - found.samples[0]).max() < 1e-11 * (100 if case.name in UNSTABLE else 1)


@pytest.mark.parametrize("name", NAMES)
def test_integrated_from_the_initial_state_the_relations_stay_below_1e_10(name: str):
    span = UNSTABLE.get(name, 30)
    statement = example(name, time={"stop": span, "samples": 101}, method="integration")
    motion = motion_of(statement, accuracy={"tolerance": 1e-9})
    assert max(relations_of(placed(statement)).drifts(motion.samples).values()) < 1e-10


@pytest.mark.parametrize("name", NAMES)
def test_the_quadrature_is_the_integration(name: str):
    motion = motion_of(example(name, time={"stop": UNSTABLE.get(name, 30), "samples": 101}, method="both"))
    assert motion.method == "quadrature"
    assert motion.cross_check.agrees
    assert motion.cross_check.horizon > 1.0
    assert motion.cross_check.disagreement < 1e-10


@pytest.mark.parametrize("name", LOOPS)
def test_a_periodic_case_closes(name: str):
    motion = motion_of(example(name, time={"periods": 1, "samples": 2}))
    period = motion.dense.period
    ends = motion.dense(np.array([0.0, period.hi]))
    # Two samples of the same function with an error of some 1e-14 each.
    assert np.abs(ends[0] - ends[1]).max() < 1e-12
    assert np.abs(motion.dense(np.array([0.5 * period.hi])) - ends[0]).max() > 1e-3
    statement = example(name, method="integration", time={"times": [0, repr(period.hi)]})
    integrated = motion_of(statement, accuracy={"tolerance": 1e-9})
    # Over one period the unstable ones multiply the rounding by some hundred.
    assert np.abs(integrated.samples[1] - integrated.samples[0]).max() < 1e-11


CHOICES = [
    (name, field) for name in LOOPS for field in ("phase", "direction", "sign") if field in CASES[name].fields
]


@pytest.mark.parametrize(("name", "field"), one_in(2, CHOICES))
def test_phase_direction_and_sign_give_other_motions_of_the_case(name: str, field: str):
    statement = example(name)
    moved = {**statement, "motion": {**statement["motion"], "phase": "1/5"}}
    changed = {**moved, "motion": {**moved["motion"], field: "3/10" if field == "phase" else -1}}
    first, second = (
        motion_of(each, time={"stop": 4, "samples": 9}, method="both") for each in (moved, changed)
    )
    assert second.cross_check.agrees
    assert np.abs(first.samples - second.samples).max() > 1e-3


def test_backwards_in_time_is_the_motion_reversed():
    statement = example("kowalewski", time={"times": [0, "1/2", 1]})
    there = motion_of({**statement, "motion": {**statement["motion"], "direction": -1}})
    here = motion_of({**statement, "time": {"times": [0, "-1/2", -1]}})
    # Two evaluations of one function.
    np.testing.assert_allclose(there.samples * ([-1] * 3 + [1] * 3), here.samples, atol=1e-13)


@each_once(
    name=[name for name in LOOPS if name != "bobylev_steklov"],
    axes=[(0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2)],
)
def test_any_order_and_sign_of_the_axes_is_accepted(name: str, axes: tuple[int, int, int]):
    statement = example(name)
    problem = read_problem(statement)
    moments = (problem.body.A, problem.body.B, problem.body.C)
    body = {letter: str(moments[axis]) for letter, axis in zip("ABC", axes, strict=True)}
    potential = {letter: str(-problem.motion.centre[axis]) for letter, axis in zip("abc", axes, strict=True)}
    turned = {**statement, "body": body, "potential": {"type": "gravity", **potential}, "method": "both"}
    motion = motion_of(turned, time={"stop": 3, "samples": 5})
    assert motion.cross_check.agrees
    assert motion.cross_check.disagreement < 1e-11
    period = motion_of(statement, outputs=["period"]).dense.period.hi
    # The same sum, but for moments rounded to other rationals.
    assert motion.dense.period.hi == pytest.approx(period, rel=1e-15)


def verify(document):
    motion = motion_of(document, time={"stop": 1, "samples": 2}, outputs=["gamma", "omega"])
    period = motion.dense.period
    stop = 6.0 if period is None else period.hi
    checked = motion_of(document, time={"stop": repr(stop), "samples": 31}, method="both")
    assert checked.cross_check.agrees
    assert checked.cross_check.horizon > 0.0
    assert checked.cross_check.disagreement < 1e-10
    state = checked.dense(np.zeros(1))
    h = energy_integral(
        read_problem(document).body, read_problem(document).potential, state[:, :3], state[:, 3:]
    )
    assert h[0] == pytest.approx(checked.energy.value, abs=1e-12)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", FREE)
def test_random_bodies_of_the_real_range(name: str):
    for document in random_documents(name, 1, 3):
        verify(document)


@pytest.mark.long
@pytest.mark.parametrize("name", FREE)
def test_many_random_bodies_of_the_real_range(name: str):
    for document in random_documents(name, 2, 200):
        verify(document)


@pytest.mark.parametrize("name", NAMES)
def test_a_solution_tells_the_drift_of_each_relation(name: str):
    outcome = solve_document(json.dumps(example(name, outputs=["gamma", "omega", "invariants"])))
    drifts = {key: each for key, each in outcome.summary["invariants"].items() if key.startswith("relation")}
    assert drifts
    # Samples to 1e-13 at worst, through relations of slope up to some 50.
    assert all(each["drift"] < 1e-11 for each in drifts.values())
    assert outcome.summary["error"] >= outcome.summary["evidence"]["distance_from_relations"]


@pytest.mark.parametrize(("h", "areas"), [("53/200", 0.084), ("4/25", 0.0)])
def test_bobylev_and_steklov_have_any_areas_integral(h: str, areas: float):
    statement = example("bobylev_steklov")
    statement["motion"] = {**statement["motion"], "energy": h}
    motion = motion_of(statement)
    body = read_problem(statement).body
    found = areas_integral(body, motion.samples[:, :3], motion.samples[:, 3:])
    # 2 C p (h - C p^2)/a, along the motion.
    np.testing.assert_allclose(found, areas, atol=1e-13)
    assert Fraction(h) == read_problem(statement).motion.energy


def test_next_to_a_separatrix_the_quadrature_is_refused_and_the_integration_is_not():
    statement = example("bobylev_steklov")
    energy = str(Fraction(4, 25) + 1 - Fraction(1, 10**12))
    statement["motion"] = {**statement["motion"], "energy": energy}
    with pytest.raises(NearSeparatrixError):
        motion_of(statement)
    assert motion_of(statement, method="integration").error <= 1e-10
