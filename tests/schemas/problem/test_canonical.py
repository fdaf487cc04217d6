"""One problem, one document, one digest."""

import json
from copy import deepcopy
from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.schemas.problem import problem as module
from service.schemas.problem.problem import check_problem, problem_digest, read_problem
from tests.support.canonical import canonical_document
from tests.support.problem_documents import problems

EXAMPLES = Path(__file__).parents[3] / "examples"
PROBLEM = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "expression", "expression": "a*g1 + b/g3^2", "parameters": {"a": -1, "b": "1/20"}},
    "motion": {"type": "planar", "lambda": 1},
    "time": {"stop": 10, "samples": 101},
}

decimals = st.integers(1, 10**6).map(lambda n: Fraction(n, 1000))


@given(problems)
def test_the_canonical_document_is_its_own_and_states_the_same_problem(document):
    canonical = canonical_document(document)
    assert canonical_document(json.loads(json.dumps(canonical))) == canonical
    assert read_problem(canonical) == read_problem(document)


@given(decimals)
def test_a_number_has_one_form_however_it_is_written(number):
    written = [
        float(number),
        str(float(number)),
        str(number),
        f"{number.numerator}/{number.denominator}",
        f" {number} ",
    ]
    digests = set()
    for spelling in written:
        document = deepcopy(PROBLEM)
        document["motion"]["lambda"] = spelling
        digests.add(problem_digest(canonical_document(document)))
    assert len(digests) == 1


def changed(path: str, value: object) -> dict:
    document = deepcopy(PROBLEM)
    *folders, name = path.split("/")
    place = document
    for folder in folders:
        place = place[folder]
    place[name] = value
    return document


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("method", "auto"),
        ("outputs", ["omega", "gamma", "omega"]),
        ("accuracy", {"tier": "standard"}),
        ("time/start", "0.0"),
        ("time/samples", "101"),
        ("time/samples", 1.01e2),
        ("motion/g3_sign", 1),
        ("motion/start", None),
        ("motion/window", None),
        ("body/allow_unphysical", False),
        ("potential/expression", " a * g1+(b / g3 ** 2)"),
        ("potential/parameters", {"b": 0.05, "a": "-1"}),
    ],
)
def test_what_says_the_same_has_the_same_digest(path, value):
    assert problem_digest(canonical_document(changed(path, value))) == problem_digest(
        canonical_document(PROBLEM)
    )


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("body/A", "2.0000000000000001"),
        ("body/B", None),
        ("method", "quadrature"),
        ("outputs", ["gamma"]),
        ("accuracy", {"tolerance": 1e-11}),
        ("time/start", 1),
        ("time/samples", 102),
        ("motion/g1_sign", -1),
        ("motion/window", 0),
        ("motion/start", {"at": "equator"}),
        ("potential/parameters/b", "1/21"),
        ("potential/expression", "a*g1 - b/g3^2"),
    ],
)
def test_what_says_something_else_has_another_digest(path, value):
    assert problem_digest(canonical_document(changed(path, value))) != problem_digest(
        canonical_document(PROBLEM)
    )


def test_other_numerics_have_another_digest(monkeypatch):
    canonical = canonical_document(PROBLEM)
    before = problem_digest(canonical)
    monkeypatch.setattr(module, "NUMERICS", module.NUMERICS + 1)
    assert problem_digest(canonical) != before


def test_zeros_at_the_end_of_a_list_say_nothing():
    long, short = (
        changed("potential", {"type": "rational", "a": [1, 0, 2, *zeros], "b": zeros})
        for zeros in ([0, 0], [])
    )
    assert canonical_document(long) == canonical_document(short)


HOMOGENEOUS = {"type": "homogeneous", "B": [1], "log": [0, "1/2"]}
GENERAL = {"type": "general", "F": "w", "parameters": {"k": 1}}


@pytest.mark.parametrize(
    ("potential", "other"),
    [
        (HOMOGENEOUS, {**HOMOGENEOUS, "A": [], "B": ["1.0", 0, 0], "C": [0], "log": [0, 0.5, 0, 0]}),
        (GENERAL, {**GENERAL, "G": "0", "reference_angle": " pi/4"}),
        (GENERAL, {**GENERAL, "F": None, **{f"F_{q}": "(w)" for q in ("pp", "mp", "pm", "mm")}}),
        (GENERAL, {**GENERAL, **{f"G_{q}": "0" for q in ("pp", "mp", "pm", "mm")}}),
        ({**GENERAL, "reference_angle": 0.5}, {**GENERAL, "reference_angle": "1/2"}),
        ({**GENERAL, "reference_angle": "0.50"}, {**GENERAL, "reference_angle": "1/2"}),
    ],
)
def test_a_family_has_one_form(potential, other):
    one, two = (canonical_document(changed("potential", given)) for given in (potential, other))
    assert one == two
    assert read_problem(one) == read_problem(changed("potential", other))


@pytest.mark.parametrize(
    ("potential", "other"),
    [
        (HOMOGENEOUS, {**HOMOGENEOUS, "B": [0, 1]}),
        (HOMOGENEOUS, {**HOMOGENEOUS, "B": [], "C": [1]}),
        (GENERAL, {**GENERAL, "reference_angle": "pi/3"}),
        (
            GENERAL,
            {"type": "general", "F_pp": "w", "F_mp": "-w", "F_pm": "w", "F_mm": "w", "parameters": {"k": 1}},
        ),
    ],
)
def test_what_differs_in_a_family_has_another_form(potential, other):
    assert canonical_document(changed("potential", potential)) != canonical_document(
        changed("potential", other)
    )


def test_defaults_are_those_of_the_contract():
    checked = check_problem(PROBLEM)
    assert checked.problem.tolerance == 1e-10
    assert checked.problem.outputs == ("gamma", "omega")
    assert checked.problem.method == "auto"
    assert checked.problem.time.start == 0
    assert (checked.problem.motion.g1_sign, checked.problem.motion.g3_sign) == (1, 1)
    assert checked.canonical["accuracy"] == {"tier": "standard"}


def test_the_sign_of_nu_is_that_of_g1():
    problem = read_problem(changed("motion", {"type": "planar", "nu": "-13/10"}))
    assert (problem.motion.nu, problem.motion.g1_sign) == (Fraction(-13, 10), -1)


@pytest.mark.parametrize(
    "path",
    [path for path in sorted(EXAMPLES.glob("*.json")) if "time" in json.loads(path.read_text())],
    ids=lambda p: p.stem,
)
def test_the_examples_are_problems(path):
    canonical = canonical_document(json.loads(path.read_text(encoding="utf-8")))
    assert canonical_document(canonical) == canonical
