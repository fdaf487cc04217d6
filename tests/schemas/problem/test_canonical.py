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

EXAMPLES = Path(__file__).parents[3] / "examples"
PROBLEM = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "expression", "expression": "a*g1 + b/g3^2", "parameters": {"a": -1, "b": "1/20"}},
    "motion": {"type": "planar", "lambda": 1},
    "time": {"stop": 10, "samples": 101},
}

numbers = st.fractions(min_value=Fraction(1, 1000), max_value=1000, max_denominator=1000)
decimals = st.integers(1, 10**6).map(lambda n: Fraction(n, 1000))
signs = st.sampled_from([-1, 1])
potentials = st.one_of(
    st.fixed_dictionaries({"type": st.just("gravity")}, optional={name: numbers.map(str) for name in "abc"}),
    st.fixed_dictionaries(
        {"type": st.just("rational")},
        optional={name: st.lists(numbers.map(str), max_size=4) for name in "abc"},
    ),
    st.fixed_dictionaries(
        {
            "type": st.just("expression"),
            "expression": st.sampled_from(["k*g1", "(k)*(g1)", "g1**2 - k/(g3^2)", "sqrt(A)*sin(g2)+k"]),
            "parameters": st.fixed_dictionaries({"k": numbers.map(str)}),
        }
    ),
)
families = st.one_of(
    potentials,
    st.fixed_dictionaries(
        {"type": st.just("homogeneous")},
        # For A = 2C: B_3 has no value, log_1 and log_3 are there.
        optional={name: st.lists(numbers.map(str), max_size=3) for name in "ABC"}
        | {"log": st.tuples(st.just("0"), numbers.map(str)).map(list)},
    ),
    st.fixed_dictionaries(
        {
            "type": st.just("general"),
            "F": st.sampled_from(["k*w", "(k)*(w)", "exp(-w)", "w**2/A"]),
            "parameters": st.fixed_dictionaries({"k": numbers.map(str)}),
        },
        optional={
            "G": st.sampled_from(["g2^2", "k + g2", "0"]),
            "reference_angle": st.sampled_from(["pi/4", "pi / 3", 0.5, "0.5", "1/2", 1]),
        },
    ),
)
starts = st.one_of(
    st.none(),
    st.fixed_dictionaries({"at": st.just("equator")}, optional={"s_sign": signs}),
    st.fixed_dictionaries({"at": st.just("rest")}, optional={"g2_sign": signs}),
    st.fixed_dictionaries({"g1": numbers.map(str)}, optional={"g2_sign": signs, "s_sign": signs}),
)
motions = st.one_of(
    st.fixed_dictionaries(
        {"type": st.just("planar"), "lambda": numbers.map(str)},
        optional={"g1_sign": signs, "g3_sign": signs, "window": st.integers(0, 5), "start": starts},
    ),
    st.fixed_dictionaries(
        {"type": st.just("planar"), "nu": numbers.map(str)}, optional={"g3_sign": signs, "start": starts}
    ),
    st.fixed_dictionaries(
        {
            "type": st.just("state"),
            "omega": st.lists(numbers.map(str), min_size=3, max_size=3),
            "gamma": st.sampled_from([["3/5", 0, "4/5"], [0, -1, 0], ["2/7", "3/7", "-6/7"]]),
        }
    ),
)
times = st.one_of(
    st.fixed_dictionaries({"stop": numbers.map(str), "samples": st.integers(1, 9)}),
    st.fixed_dictionaries({"times": st.lists(numbers.map(str), min_size=1, max_size=5)}),
)
problems = st.fixed_dictionaries(
    {"body": st.just({"A": 2, "B": 2, "C": 1}), "potential": families, "motion": motions, "time": times},
    optional={
        "accuracy": st.one_of(st.just({"tier": "standard"}), st.just({"tolerance": "1e-9"})),
        "method": st.just("auto"),
        "outputs": st.lists(st.sampled_from(["gamma", "omega", "invariants"]), min_size=1, max_size=5),
    },
)


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
