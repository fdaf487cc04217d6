"""Motions over the live service: numbers with their errors, and the function of time with its bits."""

import asyncio
import inspect
import re
from html import unescape

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

import polhode as ph
from polhode import evaluation
from polhode.clients import Operations
from polhode.motions import Motion
from polhode.studies import Judgement, Questions
from polhode.sweeps import Sweep
from polhode.transport.terms import operation
from service.dynamics.equations.orientation import trajectory_columns, trajectory_errors
from service.dynamics.solution.dense_output import Advance, DenseOutput, Period
from service.schemas.reading.numbers import LATEST

PERIODIC = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {
        "type": "expression",
        "expression": "a*g1 + b/g3^2",
        "parameters": {"a": -1, "b": "1/20"},
    },
    "motion": {"type": "planar", "lambda": 1},
    "time": {"stop": 10, "samples": 11},
    "outputs": ["gamma", "omega", "orientation"],
}
INTEGRATED = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "gravity", "a": 1, "c": "-1/2"},
    "motion": {"type": "state", "omega": ["2/5", "1/10", "9/10"], "gamma": ["3/5", 0, "4/5"]},
    "time": {"stop": 5, "samples": 6},
}


def served(service, motion, start, stop, samples):
    """Return what the service evaluates at times that are doubles."""
    query = f"start={start}&stop={stop}&samples={samples}"
    return service.call("GET", f"/v1/solutions/{motion.id}/trajectory?{query}").document


@pytest.mark.parametrize(
    ("problem", "spans"),
    [
        (PERIODIC, [(0, 8, 65), (-1024, 1024, 129), (2**30, 2**30 + 16, 33), (1e15 - 8, 1e15, 65)]),
        (INTEGRATED, [(0, 5, 41)]),
    ],
    ids=["with orientation, over a period", "without a period"],
)
def test_the_function_has_the_bits_and_the_errors_of_the_service(connected, service, problem, spans):
    motion = connected.solve(problem)
    for start, stop, samples in spans:
        told = served(service, motion, start, stop, samples)
        here = motion.at(np.linspace(start, stop, samples))
        assert list(here.columns) == list(told["columns"])
        for name, values in told["columns"].items():
            assert here[name].tobytes() == np.array(values).tobytes(), name
        # The service tells the largest of the bounds, by the same operations.
        assert here.error == told["error"]


def test_times_that_were_not_computed_are_refused(connected, service):
    motion = connected.solve(INTEGRATED)
    assert motion.period is None
    path = f"/v1/solutions/{motion.id}/trajectory?start=5.5&stop=6&samples=2"
    told = service.call("GET", path).document["detail"]
    with pytest.raises(ph.WrongArgumentError, match="not known to be periodic") as refused:
        motion.at(5.5)
    assert str(refused.value) in told


def test_what_is_evaluated_twice_has_the_same_limits_and_words(connected, base):
    motion = connected.solve(base)
    assert evaluation.LATEST == LATEST
    for far in (2e15, -1e40):
        with pytest.raises(ph.RefusedError) as told:
            connected.solve(base, times=[far])
        (fault,) = told.value.faults
        with pytest.raises(ph.WrongArgumentError) as refused:
            motion.at([0.0, far])
        assert str(refused.value) == f"t = {far:.17g} is {fault.message}"
    for nothing in (
        float("nan"),
        float("inf"),
        None,
        [0.0, None],
        "1/2",
        1j,
        [[0, 1], [2]],
        np.datetime64("now"),
    ):
        with pytest.raises(ph.WrongArgumentError, match="accepted"):
            motion.at(nothing)


def test_times_have_any_shape_and_any_type_of_numbers(connected, base):
    motion = connected.solve(base)
    grid = np.arange(6).reshape(2, 3)
    samples = motion.at(grid)
    assert (samples.t.shape, samples["g1"].shape, samples.omega.shape) == ((2, 3), (2, 3), (2, 3, 3))
    assert len(samples) == len(samples.frame()) == 6
    expected = motion.at([0.0, 1, 2, 3, 4, 5])
    for each in (grid, grid.astype(np.longdouble), pd.Series(range(6), index=list("abcdef")), range(6)):
        assert motion.at(each).gamma.reshape(6, 3).tolist() == expected.gamma.tolist()
    assert motion.at(3).gamma.tolist() == expected.gamma[3:4].tolist()
    assert motion.at([]).gamma.shape == (0, 3)


PAIRS = st.tuples(st.floats(1e-3, 1e3), st.floats(-0.5, 0.5), st.sampled_from([0.0, 1e-30, 1e-16, 1e-9]))


@given(PAIRS, PAIRS, st.lists(st.floats(-1e15, 1e15), min_size=1, max_size=4), st.integers(0, 2**32))
def test_the_client_evaluates_and_claims_as_the_service_at_all_times(period, gained, times, seed):
    names = ("p", "g1", *evaluation.LOCAL, "psi1")
    hi, part, error = period
    breaks = np.array([0.0, 0.3, 1.0]) * hi
    coefficients = np.random.default_rng(seed).normal(size=(2, 7, 7)) / np.arange(1, 8)[:, None] ** 3
    advance = gained[0], gained[1] * float(np.spacing(gained[0])), gained[2]
    length = hi, part * float(np.spacing(hi)), error * hi
    errors = {"psi1": 1e-12}
    here = evaluation.FunctionOfTime(
        names,
        breaks,
        coefficients,
        evaluation.PairOfDoubles(*length),
        1e-14,
        errors,
        {"psi1": evaluation.PairOfDoubles(*advance)},
    )
    there = DenseOutput(
        names, breaks, coefficients, Period(*length), 1e-14, errors, {"psi1": Advance(*advance)}
    )
    asked = np.array(times)
    told = trajectory_columns(there, asked, np.zeros(len(times)))
    found = evaluation.columns_at(here, asked)
    assert {name: each.tolist() for name, each in found.items()} == {
        name: told[name].tolist() for name in found
    }
    assert evaluation.errors_at(here, asked) == trajectory_errors(there, asked)


def test_numbers_carry_their_errors(connected, base, service):
    motion = connected.solve(base)
    told = service.call("GET", f"/v1/solutions/{motion.id}").document
    assert (float(motion.period), motion.period.error) == tuple(told["period"].values())
    assert (float(motion.energy), motion.energy.error) == tuple(told["energy"].values())
    assert motion.error == told["error"] <= 1e-9
    # The path closes after a period: within the error of the period times the speed, and that of both values.
    start, end = motion.at([0.0, float(motion.period)]).gamma
    speed = np.abs(motion.at(0.0).omega).sum()
    assert np.abs(end - start).max() <= motion.period.error * speed + 2 * motion.at(motion.period).error


def test_a_motion_is_audited(connected, base):
    motion = connected.solve(base)
    same, higher = motion.audit(), motion.audit(tier="high", seconds=60)
    assert [same.agrees, higher.agrees] == [True, True]
    assert same.document["comparison"]["identical"]
    assert higher.document["comparison"]["found"]["tier"] == "high"
    with pytest.raises(ph.WrongArgumentError, match="accuracy"):
        motion.audit(tier="high", tolerance=1e-9)
    with pytest.raises(ph.RefusedError, match="/accuracy/tier"):
        motion.audit(tier="best")


def test_proven_digits_are_kept_and_their_rounding_counts(connected, base):
    motion = connected.solve(base | {"accuracy": {"tier": "certified", "bits": 128}})
    period = motion.period
    assert len(period.digits) > 30
    assert float(period.radius) < 1e-30 < period.error < 1e-15  # the float has a rounding of half an ulp
    assert motion.enclosures()["columns"]["g1"][0].keys() == {"value", "radius"}


def test_samples_are_those_of_the_problem(connected, base):
    motion = connected.solve(base)
    frame = motion.frame()
    assert frame.t.tolist() == list(range(11))
    assert frame.attrs["error"] == motion.error
    # Stored samples are those of the solver, the others of its function: both within their errors.
    again = motion.frame(times=frame.t)
    assert np.abs(again - frame).to_numpy().max() <= again.attrs["error"] + frame.attrs["error"]


def test_equal_problems_have_one_solution(connected, base):
    assert connected.solve(base).id == connected.solve(base, lam="1").id
    job = connected.submit(base)
    assert job.wait().id == connected.solve(base).id
    assert job.state == "succeeded"


def test_lists_come_back_in_their_order(connected, base):
    lambdas = ["3/2", "5/4", "3/2", 1]
    motions = connected.solve_all([ph.problem(base, lam=each) for each in lambdas])
    assert [motion.problem["motion"]["lambda"] for motion in motions] == ["3/2", "5/4", "3/2", 1]
    with pytest.raises(ph.SomeFailedError) as some:
        connected.solve_all([base, base | {"body": {"A": -1, "C": 1}}])
    assert some.value.motions[0].id == motions[3].id
    assert some.value.errors[1].pointer == "/body/A"
    with pytest.raises(ph.SomeFailedError):
        connected.solve_all([base | {"body": {"A": -1, "C": 1}}])


def test_refusals_tell_all_faults_with_their_places(connected, base):
    with pytest.raises(ph.RefusedError) as refused:
        connected.solve(base, body=(-2, 1), potential="a*g4", a=1)
    assert {fault.pointer for fault in refused.value.faults} == {"/body/A", "/potential/expression"}
    assert "is > 0" in str(refused.value)
    with pytest.raises(ph.RefusedError) as refused:
        connected.solve(base, potential="g1 + g2/10")
    assert refused.value.code == "inadmissible_potential"
    assert refused.value.document["counterexample"]["g"]
    with pytest.raises(ph.FailedError) as failed:
        connected.solve(INTEGRATED, tolerance="1e-15")
    assert failed.value.code == "accuracy_not_met"
    with pytest.raises(ph.MissingError):
        connected.solution("01a2093c-94c9-70fd-9ade-9dd8a9a0e28b")


def test_a_verdict_is_the_same_document(connected, service):
    verdict = connected.judge("g1 + g2/10", body=(2, 1))
    assert (verdict.verdict, verdict.is_admissible) == ("inadmissible", False)
    asked = {"body": {"A": 2, "C": 1}, "potential": {"type": "expression", "expression": "g1 + g2/10"}}
    assert verdict.document == service.call("POST", "/v1/validations", asked).document
    assert connected.judge("a*g1", body=(2, 1), a="-1/2").is_admissible


def test_a_verdict_is_typeset_and_tells_windows_and_cases(connected):
    verdict = connected.judge("a*g1 + b/g3^2", body=(2, 1), lam=1, a=-1, b="1/20")
    assert [window["kind"] for window in verdict.motions] == ["periodic"]
    equations = verdict.latex()
    for name in ("V", "h", "F", "G"):
        assert equations[name][0].startswith(name)
        assert equations[name][0].replace(" = ", " &= ", 1) in verdict._repr_latex_()
    assert r"h \left(" in verdict._repr_html_()
    assert verdict._repr_latex_().startswith(r"$\begin{aligned} V")
    state = {"type": "state", "omega": [0, 0, 1], "gamma": [0, 0, 1]}
    heavy = connected.judge({"type": "gravity", "c": 1}, body=(2, 2, 1), motion=state)
    assert heavy.classical is not None
    with pytest.raises(ph.WrongArgumentError, match="both set motion"):
        connected.judge("g1", body=(2, 1), motion=state, lam=1)


def test_a_parameter_without_a_value_is_told_as_one(connected):
    with pytest.raises(ph.RefusedError, match=r"is b a parameter[?] b=1 would be its value"):
        connected.judge("a*g1 + b/g3^2", body=(2, 1), a=-1)


def test_signatures_are_those_that_a_person_calls(connected):
    shown = {
        name: str(inspect.signature(getattr(connected, name)))
        for name in ("solve", "solve_all", "find", "job")
    }
    assert shown["job"] == "(job_id: str) -> Job"
    assert shown["find"].endswith("-> Union[Job, Motion, Sweep]")
    assert shown["solve_all"].endswith("-> list[Motion]")
    assert shown["solve"].startswith(
        "(base: Mapping[str, object] | str | PathLike[str] | None = None, *, body: "
    )
    assert shown["solve"].endswith("-> Motion")
    every = [
        *vars(Operations).values(),
        *vars(Questions).values(),
        *vars(Motion).values(),
        *vars(Sweep).values(),
        *vars(Judgement).values(),
    ]
    operations = [each for each in every if isinstance(each, operation)]
    assert len(operations) > 30
    for each in operations:
        assert not re.search("Generator|Step|CarrierT", str(inspect.signature(each.call))), each


def test_an_event_loop_gets_the_same(connected, base, service):
    async def solve():
        async with ph.connect_async(service.address) as client:
            motion = await client.solve(base)
            later = await motion.at([0.0, 1e6])
            ids = [each.id async for each in client.solutions("period<7")]
            sweep = await client.sweep(base, lam=[1, "3/2"])
            return motion.id, later.gamma.tolist(), ids, (await sweep.frame()).period.tolist()

    motion = connected.solve(base)
    sweep = connected.sweep(base, lam=[1, "3/2"])
    ids = [each.id for each in connected.solutions("period<7")]
    here = motion.id, motion.at([0.0, 1e6]).gamma.tolist(), ids, sweep.frame().period.tolist()
    assert asyncio.run(solve()) == here


def test_notebooks_show_facts_and_a_picture(connected, base):
    html = connected.solve(base)._repr_html_()
    assert "±" in html
    assert "A = 2, C = 1; a*g1 + b/g3^2, a = -1, b = 1/20; planar, lambda = 1" in html
    assert html.count("<polyline") >= 1
    refuted = connected.judge("g1 + g2/10", body=(2, 1))._repr_html_()
    for fact in ("inadmissible", "γ = (2/7, 6/7, 3/7)", "nearest admissible"):
        assert fact in refuted
    proved = connected.judge("a*g1", body=(2, 1), a=-1, motion={"type": "planar", "nu": 1})._repr_html_()
    assert "h(nu) = -1/2*a*nu" in proved
    assert "motion 0" in proved
    # Zero by an identity that the algebra does not know.
    w = "(2 + g1*g3)"
    open_question = f"g1 + (1 + 3*{w} + (3 + {w})*sqrt({w}))^(1/3) - 1 - sqrt({w})"
    undecided = connected.judge(open_question, body=(2, 1))
    assert undecided.verdict == "undecided"
    assert undecided.document["evidence"]["doubt"][:100] in unescape(undecided._repr_html_())


def test_a_motion_is_found_by_its_labels_and_cited(connected, base):
    motion = connected.solve(base, lam="6/5", labels={"project": "thesis", "figure": "3"}, note="to be drawn")
    assert (motion.labels, motion.document["note"]) == ({"project": "thesis", "figure": "3"}, "to be drawn")
    tagged = connected.tag(motion.id, {"project": "paper", "figure": None})
    assert tagged.labels == connected.solution(motion.id).labels == {"project": "paper"}
    listing = connected.solutions("label.project=paper")
    assert listing.rows(["id", "label.project", "labels"]) == [
        {"id": motion.id, "label.project": "paper", "labels": {"project": "paper"}}
    ]
    assert motion.citation().startswith("@")
    assert motion.id in motion.citation()
    assert motion.citation("cff").startswith("cff-version: ")
    with pytest.raises(ph.WrongArgumentError, match="did you mean 'labels'"):
        connected.solve(base, label={"project": "thesis"})


def test_what_never_changes_is_asked_for_once(connected, base, service):
    motion = connected.solve(base)
    first = motion.frame()
    motion.at(0.0)
    asked = []
    with ph.connect() as other:
        other.carrier.connections.of().http.event_hooks = {
            "request": [lambda request: asked.append(request.url.path)]
        }
        again = other.solution(motion.id)
        assert again.frame().equals(first)
        assert again.at(3.5).gamma.tolist() == motion.at(3.5).gamma.tolist()
    assert asked == [f"/v1/solutions/{motion.id}"]
