"""The solver takes the windows that the examination found, and its digits are the same."""

import json
from fractions import Fraction

import pytest
from sqlalchemy import update

from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction import windows as found_windows
from service.dynamics.verdict.simple_form import SIMPLER_POTENTIAL
from service.jobs.records import Solved
from service.schemas.problem.problem import check_problem
from service.storage.examinations import keys_of
from service.storage.tables.operations import ExaminationRow
from service.verdicts.examination import examine_problems
from tests.support.api import PLANAR
from tests.support.examinations import examination_of
from workers.computation import compute
from workers.computation.compute import solve_document
from workers.process.tasks import solve_problem

BASE = {"time": {"times": [0, "1/3", 7]}, "outputs": ["gamma", "omega", "period"]}
Q = "(A*g1^2+C*g3^2)"
PROBLEMS = {
    "rotation": PLANAR | BASE,
    "libration": PLANAR | BASE | {"potential": {"type": "expression", "expression": "-g1+1/(20*g3^2)"}},
    "general alpha": BASE
    | {
        "body": {"A": "17/10", "B": "13/10", "C": 1},
        "potential": {"type": "expression", "expression": f"{Q}*(g2^2-1/2)"},
        "motion": {"type": "planar", "lambda": "6/5"},
    },
    "separatrix": PLANAR
    | BASE
    | {
        "potential": {"type": "expression", "expression": "-g1+(1+sqrt(5))/4*(g1^2-g2^2)"},
        "motion": {"type": "planar", "lambda": 1, "start": {"g1": "1/2"}},
    },
    "written with cancellation": PLANAR
    | BASE
    | {"potential": {"type": "expression", "expression": "1e6*(g1^2+g2^2+g3^2-1)-g1+1/20/g3^2"}},
    "a square under a root": PLANAR
    | BASE
    | {"potential": {"type": "expression", "expression": f"{Q}*sqrt(g2^2-g2/5+1/100)-g1"}},
    "by an integral": BASE
    | {
        "body": {"A": 3, "C": 5},
        "potential": {"type": "general", "F": "exp(-w)", "G": "3*sin(g2) - C", "reference_angle": "1/2"},
        "motion": {"type": "planar", "lambda": "9/10"},
    },
}
TIERS = ("draft", "standard", "high")
CASES = [
    *((name, tier) for name in ("rotation", "libration") for tier in (*TIERS, "certified")),
    *((name, tier) for name in ("general alpha", "separatrix") for tier in TIERS),
    *((name, "standard") for name in ("written with cancellation", "a square under a root")),
    ("by an integral", "draft"),
]


@pytest.fixture
def forgetful(monkeypatch):
    """Windows that were found in this process are forgotten."""
    monkeypatch.setattr(found_windows, "_KNOWN", {})
    return monkeypatch


def windows_of(document):
    """Return the kept windows of a problem, as its examination finds them."""
    reply = json.loads(examine_problems(json.dumps(examination_of([document]))))
    assert "error" not in reply["answers"][0], reply
    return reply["found"][keys_of(check_problem(document).canonical).windows]


def assert_same(one, other):
    assert isinstance(one, Solved), one
    assert isinstance(other, Solved), other
    assert {**one.summary, "cost": None} == {**other.summary, "cost": None}
    assert (one.dense, one.samples) == (other.dense, other.samples)


@pytest.mark.one_in(4)
@pytest.mark.parametrize(("name", "tier"), CASES)
def test_windows_that_are_handed_on_change_no_bit(forgetful, name, tier):
    document = PROBLEMS[name] | {"accuracy": {"tier": tier}}
    alone = solve_document(json.dumps(document))
    windows = windows_of(document)
    forgetful.setattr(found_windows, "_KNOWN", {})
    assert_same(solve_document(json.dumps(document), windows), alone)


def test_a_simpler_formula_is_handed_on_with_the_windows(forgetful):
    """It is not looked for again, and the answer says what was used beside what was typed."""
    document = PROBLEMS["written with cancellation"]
    windows = windows_of(document)
    forgetful.setattr(compute, "simplified", None)
    outcome = solve_document(json.dumps(document), windows)
    assert isinstance(outcome, Solved)
    assert outcome.summary["problem"] == document
    assert [warning["code"] for warning in outcome.summary["warnings"]] == [SIMPLER_POTENTIAL]
    assert outcome.summary["evidence"][SIMPLER_POTENTIAL] == "-g1 + 1/20*g3^-2"


@pytest.mark.parametrize(
    ("typed", "simple"),
    [
        ("1e4*g1*(1+g3^2)-1e4*g1*g3^2-(1e4+1)*g1", "-g1"),
        ("-g1*sqrt(1-g2^2)/sqrt(g1^2+g3^2)", "-g1"),
        ("-g1+sqrt(1-g1^2-g3^2)*g3-abs(g2)*g3", "-g1"),
        ("1e6*(g1^2+g2^2+g3^2-1)-g1+1/20/g3^2", "-g1+1/20*g3^-2"),
        (f"{Q}*sqrt(g2^2-g2/5+1/100)", f"{Q}*abs(g2-1/10)"),
    ],
)
def test_the_motion_is_that_of_the_simpler_formula(typed, simple):
    """To the last bit: the same is computed."""
    found, known = (
        solve_document(json.dumps(PLANAR | BASE | {"potential": {"type": "expression", "expression": text}}))
        for text in (typed, simple)
    )
    assert isinstance(found, Solved)
    assert isinstance(known, Solved)
    assert (found.dense, found.samples) == (known.dense, known.samples)
    assert found.summary["problem"] != known.summary["problem"]


def test_windows_that_are_handed_on_are_not_found_again(forgetful):
    document = PROBLEMS["libration"] | {"accuracy": {"tier": "high"}}
    windows = windows_of(document)
    forgetful.setattr(found_windows, "_KNOWN", {})
    forgetful.setattr(found_windows, "_all_windows", None)
    assert isinstance(solve_document(json.dumps(document), windows), Solved)
    forgetful.setattr(found_windows, "_KNOWN", {})
    with pytest.raises(TypeError):
        solve_document(json.dumps(document))


@pytest.fixture
def submitted(client):
    """A job that was submitted by HTTP, examined by a child."""
    response = client.post("/v1/jobs", json=PROBLEMS["libration"])
    assert response.status_code == 202, response.text
    return response.json()["id"]


def test_a_worker_gets_the_windows_with_the_job(submitted, jobs):
    claim = jobs.claim("a worker", lease_seconds=60.0)
    assert claim.job_id == submitted
    assert claim.windows == windows_of(PROBLEMS["libration"])
    assert_same(
        solve_problem(json.dumps(claim.payload), claim.windows), solve_problem(json.dumps(claim.payload))
    )


@pytest.mark.parametrize("change", [{"content": b"{}"}, {"version": "another one"}])
def test_what_is_damaged_or_from_another_version_is_found_again(submitted, jobs, database, change):
    with database.write() as session:
        session.execute(update(ExaminationRow).values(**change))
    claim = jobs.claim("a worker", lease_seconds=60.0)
    assert (claim.job_id, claim.windows) == (submitted, "")


def test_a_list_is_handed_on_too(client, jobs):
    documents = [PROBLEMS["libration"] | {"motion": {"type": "planar", "lambda": n}} for n in (1, 2, 3)]
    assert client.post("/v1/jobs", json=documents).status_code == 202
    claims = [jobs.claim("a worker", lease_seconds=60.0) for _ in documents]
    assert len({claim.windows for claim in claims}) == 3
    assert "" not in {claim.windows for claim in claims}


def test_windows_are_handed_on_for_the_very_objects_alone(forgetful):
    """Whoever asks for an equal problem finds its windows itself."""
    problem, equal = (check_problem(PROBLEMS["libration"]).problem for _ in range(2))
    assert isinstance(problem.motion, PlanarMotion)
    assert isinstance(equal.motion, PlanarMotion)
    windows = found_windows.find_windows(problem.body, problem.potential, problem.motion)
    forgetful.setattr(found_windows, "_KNOWN", {})
    forgetful.setattr(found_windows, "_all_windows", None)
    found_windows.hand_on_windows(problem.body, problem.potential, problem.motion, windows)
    assert found_windows.find_windows(problem.body, problem.potential, problem.motion) is windows
    with pytest.raises(TypeError):
        found_windows.find_windows(equal.body, equal.potential, equal.motion)
    for number in range(found_windows.ANSWERS_CACHED):
        other = PlanarMotion(Fraction(number + 1))
        found_windows.hand_on_windows(problem.body, problem.potential, other, windows)
    assert len(found_windows._HANDED) == found_windows.ANSWERS_CACHED
    with pytest.raises(TypeError):  # it would have to be found
        found_windows.find_windows(problem.body, problem.potential, problem.motion)
