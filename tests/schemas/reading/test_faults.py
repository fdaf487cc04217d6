"""Every fault of a document at once, each at its place, each with its word."""

import json
from contextlib import suppress
from copy import deepcopy

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.sandbox import Sandbox
from service.schemas.problem.problem import read_problem, read_question
from service.schemas.reading.documents import MAX_FAULTS, InvalidProblemError, pointer_to
from tests.support.verdicts import read_quietly

PROBLEM = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "expression", "expression": "a*g1 + b/g3^2", "parameters": {"a": -1, "b": "1/20"}},
    "motion": {"type": "planar", "lambda": 1},
    "time": {"stop": 10, "samples": 101},
}
STATE = {"type": "state", "omega": [0, 1, 0], "gamma": ["3/5", 0, "4/5"]}


def faults_of(document: object, *, read=read_problem) -> list[tuple[str, str]]:
    with pytest.raises(InvalidProblemError) as caught:
        read(document)
    faults = caught.value.faults
    assert all(fault.message for fault in faults)
    found = [(fault.pointer, fault.code) for fault in faults]
    assert len(set(found)) == len(found)
    return found


def changed(**sections: object) -> dict:
    return {**deepcopy(PROBLEM), **sections}


BODY = [
    ({"A": 10, "B": 1, "C": 1}, [("/body", "unphysical_inertia")]),
    ({"A": 1, "B": 1, "C": 1}, [("/body", "equal_moments")]),
    ({"A": 0, "C": -1}, [("/body/A", "invalid_inertia"), ("/body/C", "invalid_inertia")]),
    ({"C": 1}, [("/body/A", "missing_field")]),
    ({"A": None, "C": 1}, [("/body/A", "invalid_number")]),
    ({"A": True, "C": [1]}, [("/body/A", "invalid_number"), ("/body/C", "invalid_number")]),
    ({"A": "1/0", "C": "0x10"}, [("/body/A", "invalid_number"), ("/body/C", "invalid_number")]),
    ({"A": "1e301", "C": "1e-301"}, [("/body/A", "invalid_number"), ("/body/C", "invalid_number")]),
    ({"A": float("inf"), "C": float("nan")}, [("/body/A", "invalid_number"), ("/body/C", "invalid_number")]),
    ({"A": 2, "C": 1, "allow_unphysical": 1}, [("/body/allow_unphysical", "invalid_type")]),
    ({"A": 2, "C": 1, "I1": 3}, [("/body/I1", "unknown_field")]),
    ([2, 1], [("/body", "invalid_type")]),
]


@pytest.mark.parametrize(("body", "expected"), BODY)
def test_a_body_that_cannot_be(body, expected):
    assert faults_of(changed(body=body)) == expected


def test_moments_of_no_body_are_accepted_if_one_insists():
    body = {"A": 10, "B": 1, "C": 1, "allow_unphysical": True}
    assert read_problem(changed(body=body)).body.allow_unphysical


def expression(text: object, **parameters: object) -> dict:
    return {"type": "expression", "expression": text, "parameters": parameters}


POTENTIAL = [
    (expression("g1 +"), [("/potential/expression", "formula")]),
    (expression("q*g1"), [("/potential/expression", "formula")]),
    (expression("g1/(A-2*C)"), [("/potential/expression", "formula")]),
    (expression("g1" * 3000), [("/potential/expression", "formula")]),
    (expression("__import__('os')"), [("/potential/expression", "formula")]),
    (expression(7), [("/potential/expression", "invalid_type")]),
    (expression("g1", g1=1), [("/potential/parameters/g1", "parameter_name")]),
    (expression("g1", **{"a/b~": 1}), [("/potential/parameters/a~1b~0", "parameter_name")]),
    (
        expression("k*g1 +", k="x"),
        [("/potential/parameters/k", "invalid_number"), ("/potential/expression", "formula")],
    ),
    (expression("g1", **{f"k{n}": 1 for n in range(101)}), [("/potential/parameters", "invalid_length")]),
    ({"type": "expression"}, [("/potential/expression", "missing_field")]),
    ({"type": "gravity", "d": 1}, [("/potential/d", "unknown_field")]),
    ({"type": "rational", "a": [0] * 21}, [("/potential/a", "invalid_length")]),
    ({"type": "rational", "a": [1, "x"]}, [("/potential/a/1", "invalid_number")]),
    ({"type": "homogeneous", "A": [1], "D": []}, [("/potential/D", "unknown_field")]),
    ({"type": "homogeneous", "log": [0] * 21}, [("/potential/log", "invalid_length")]),
    ({"type": "homogeneous", "B": [0, 1, 0, 1]}, [("/potential/B/3", "undefined_term")]),
    (
        {"type": "homogeneous", "A": ["x"], "B": [0, 0, 0, 1], "log": [1, 1, "y", 1]},
        [
            ("/potential/A/0", "invalid_number"),
            ("/potential/log/2", "invalid_number"),
            ("/potential/B/3", "undefined_term"),
            ("/potential/log/0", "no_log_term"),
        ],
    ),
    ({"type": "general"}, [("/potential/F", "missing_field")]),
    ({"type": "general", "F": 7}, [("/potential/F", "invalid_type")]),
    ({"type": "general", "F": "w", "H": "w"}, [("/potential/H", "unknown_field")]),
    (
        {"type": "general", "F": "g1", "G": "w +", "parameters": {"w": 1}, "reference_angle": "pi"},
        [
            ("/potential/parameters/w", "parameter_name"),
            ("/potential/F", "formula"),
            ("/potential/G", "formula"),
            ("/potential/reference_angle", "reference_angle"),
        ],
    ),
    ({"type": "general", "F": "w", "reference_angle": "g2"}, [("/potential/reference_angle", "formula")]),
    (
        {"type": "general", "F": "w", "reference_angle": 0},
        [("/potential/reference_angle", "reference_angle")],
    ),
    (
        {"type": "general", "F": "w", "reference_angle": True},
        [("/potential/reference_angle", "invalid_type")],
    ),
    (
        {"type": "general", "F": "w", "F_pp": "w", "G_mm": "g2", "parameters": {"k": "x"}},
        [
            ("/potential/parameters/k", "invalid_number"),
            ("/potential/F_pp", "conflicting_fields"),
            ("/potential/G_pp", "missing_field"),
            ("/potential/G_mp", "missing_field"),
            ("/potential/G_pm", "missing_field"),
        ],
    ),
    (
        {"type": "general", "F_pp": "w", "F_mp": "q", "F_pm": "k/(k-29)", "parameters": {"k": 29, "pi": "y"}},
        [
            ("/potential/parameters/pi", "invalid_number"),
            ("/potential/F_mm", "missing_field"),
            ("/potential/parameters/pi", "parameter_name"),
            ("/potential/F_mp", "formula"),
        ],
    ),
    ({"type": "magic"}, [("/potential/type", "invalid_value")]),
    ({"type": ["gravity"]}, [("/potential/type", "invalid_value")]),
    ({}, [("/potential/type", "missing_field")]),
    ("g1", [("/potential", "invalid_type")]),
]


@pytest.mark.parametrize(("potential", "expected"), POTENTIAL)
def test_a_potential_that_cannot_be(potential, expected):
    assert faults_of(changed(potential=potential)) == expected


def test_the_rational_family_needs_a_double_moment():
    body = {"A": 3, "B": 3, "C": 1}
    found = faults_of(changed(body=body, potential={"type": "rational", "a": [1]}))
    assert [pointer for pointer, _ in found] == ["/body"]


MOTION = [
    ({"type": "planar"}, [("/motion/lambda", "missing_field")]),
    ({"type": "planar", "lambda": 0}, [("/motion/lambda", "out_of_range")]),
    ({"type": "planar", "nu": 0}, [("/motion/nu", "out_of_range")]),
    ({"type": "planar", "lambda": 1, "nu": 1}, [("/motion/nu", "conflicting_fields")]),
    ({"type": "planar", "nu": 1, "g1_sign": 1}, [("/motion/g1_sign", "conflicting_fields")]),
    ({"type": "planar", "lambda": 1, "g3_sign": 0}, [("/motion/g3_sign", "out_of_range")]),
    ({"type": "planar", "lambda": 1, "window": -1}, [("/motion/window", "out_of_range")]),
    ({"type": "planar", "lambda": 1, "window": 0.5}, [("/motion/window", "invalid_number")]),
    ({"type": "planar", "lambda": 1, "start": {}}, [("/motion/start", "missing_field")]),
    ({"type": "planar", "lambda": 1, "start": {"at": "pole"}}, [("/motion/start/at", "invalid_value")]),
    (
        {"type": "planar", "lambda": 1, "start": {"at": "rest", "s_sign": 1}},
        [("/motion/start/s_sign", "unknown_field")],
    ),
    ({"type": "planar", "lambda": 1, "start": {"g1": 0}}, [("/motion/start/g1", "out_of_range")]),
    ({**STATE, "gamma": [0, 0, "1.000000000002"]}, [("/motion/gamma", "not_unit_gamma")]),
    ({**STATE, "gamma": [0, 1]}, [("/motion/gamma", "invalid_length")]),
    ({**STATE, "omega": [0, 1, "x"]}, [("/motion/omega/2", "invalid_number")]),
    ({"type": "free"}, [("/motion/type", "invalid_value")]),
    (None, [("/motion", "invalid_type")]),
]


@pytest.mark.parametrize(("motion", "expected"), MOTION)
def test_a_motion_that_cannot_be(motion, expected):
    assert faults_of(changed(motion=motion)) == expected


@pytest.mark.parametrize("length", ["0.9999999999991", "1.0000000000009"])
def test_gamma_may_miss_its_length_by_a_rounding(length):
    assert read_problem(changed(motion={**STATE, "gamma": [0, 0, length]}))


ASKED = [
    ({"time": {}}, [("/time/stop", "missing_field"), ("/time/samples", "missing_field")]),
    ({"time": {"stop": 0, "samples": 1}}, [("/time/stop", "out_of_range")]),
    ({"time": {"stop": 1, "samples": 0}}, [("/time/samples", "out_of_range")]),
    ({"time": {"stop": 1, "samples": 100_001}}, [("/time/samples", "out_of_range")]),
    ({"time": {"stop": 1e16, "samples": 2}}, [("/time/stop", "out_of_range")]),
    ({"time": {"stop": 1, "samples": 2, "step": 1}}, [("/time/step", "unknown_field")]),
    ({"time": {"stop": 1, "periods": 1, "samples": 2}}, [("/time", "conflicting_fields")]),
    ({"time": {"periods": 0, "samples": 2}}, [("/time/periods", "out_of_range")]),
    ({"time": {"times": []}}, [("/time/times", "invalid_length")]),
    ({"time": {"times": [0, "noon"]}}, [("/time/times/1", "invalid_number")]),
    ({"time": 10}, [("/time", "invalid_type")]),
    ({"accuracy": {"tolerance": 1e-16}}, [("/accuracy/tolerance", "out_of_range")]),
    ({"accuracy": {"tolerance": 0.011}}, [("/accuracy/tolerance", "out_of_range")]),
    ({"accuracy": {"tier": "high", "bits": 64}}, [("/accuracy/bits", "conflicting_fields")]),
    ({"accuracy": {"tier": "certified", "bits": 53}}, [("/accuracy/bits", "invalid_value")]),
    ({"accuracy": {"budget_seconds": 0}}, [("/accuracy/budget_seconds", "out_of_range")]),
    ({"accuracy": {"budget_seconds": 3601}}, [("/accuracy/budget_seconds", "out_of_range")]),
    ({"accuracy": {"budget_seconds": 1, "tier": "high"}}, [("/accuracy", "conflicting_fields")]),
    ({"accuracy": {"tier": "best"}}, [("/accuracy/tier", "invalid_value")]),
    ({"accuracy": {"tier": "standard", "tolerance": 1e-9}}, [("/accuracy", "conflicting_fields")]),
    ({"accuracy": 1e-9}, [("/accuracy", "invalid_type")]),
    ({"method": "magic"}, [("/method", "invalid_value")]),
    ({"outputs": []}, [("/outputs", "invalid_length")]),
    ({"outputs": ["gamma", "orientation", "x"]}, [("/outputs/2", "invalid_value")]),
    ({"outputs": "gamma"}, [("/outputs", "invalid_type")]),
    ({"priority": 1}, [("/priority", "unknown_field")]),
]


@pytest.mark.parametrize(("sections", "expected"), ASKED)
def test_what_cannot_be_asked_for(sections, expected):
    assert faults_of(changed(**sections)) == expected


WITHOUT_B = {"A": 2, "C": 1}
COMBINATIONS = [
    ({"body": WITHOUT_B, "method": "integration"}, [("/body/B", "missing_moment")]),
    ({"body": WITHOUT_B, "method": "both"}, [("/body/B", "missing_moment")]),
    ({"body": WITHOUT_B, "outputs": ["stability"]}, [("/body/B", "missing_moment")]),
    ({"body": WITHOUT_B, "method": "both", "outputs": ["stability"]}, [("/body/B", "missing_moment")]),
    ({"body": WITHOUT_B, "motion": STATE}, [("/body/B", "missing_moment")]),
    ({"body": WITHOUT_B, "potential": expression("B*g1")}, [("/body/B", "missing_moment")]),
    ({"motion": STATE, "method": "quadrature"}, [("/method", "method_needs_planar_motion")]),
    ({"motion": STATE, "method": "both"}, [("/method", "method_needs_planar_motion")]),
    ({"motion": STATE, "time": {"periods": 1, "samples": 3}}, [("/time/periods", "period_needed")]),
    ({"method": "integration", "time": {"periods": 1, "samples": 3}}, [("/time/periods", "period_needed")]),
    (
        {"body": {"A": 3, "B": 3, "C": 1}, "motion": {"type": "planar", "nu": 1}},
        [("/motion/nu", "nu_needs_double_moment")],
    ),
]


@pytest.mark.parametrize(("sections", "expected"), COMBINATIONS)
def test_what_does_not_go_together(sections, expected):
    assert faults_of(changed(**sections)) == expected


def test_what_belongs_to_planar_motions_is_refused_for_a_state():
    asked = {"outputs": ["gamma", "stability"]}
    found = faults_of(changed(body={"A": 2, "B": 2, "C": 1}, motion=STATE, **asked))
    assert ("/outputs/1", "output_needs_planar_motion") in found


@pytest.mark.parametrize("sections", [{"motion": STATE}, {"method": "integration"}])
def test_certified_digits_are_integrated(sections):
    assert read_problem(changed(body={"A": 2, "B": 2, "C": 1}, accuracy={"tier": "certified"}, **sections))


def test_a_symmetric_body_may_move_from_any_state():
    assert read_problem(
        changed(body={"A": 1, "B": 1, "C": 1}, motion=STATE, potential={"type": "gravity", "a": 1})
    )


def test_no_fault_hides_another():
    """One fault of every part, and the rules between parts that could not be read as a whole."""
    document = {
        "body": {"A": 10, "C": 1, "B": 1},
        "potential": expression("q*g1", g2=1),
        "motion": {"type": "planar", "nu": 1, "lambda": 0, "spin": 2},
        "time": {"periods": 1, "samples": 0},
        "accuracy": {"tier": "highest"},
        "method": "integration",
        "outputs": ["stability", "instability"],
        "extra": None,
    }
    assert set(faults_of(document)) == {
        ("/body", "unphysical_inertia"),
        ("/potential/parameters/g2", "parameter_name"),
        ("/potential/expression", "formula"),
        ("/motion/lambda", "out_of_range"),
        ("/motion/spin", "unknown_field"),
        ("/motion/nu", "conflicting_fields"),
        ("/motion/nu", "nu_needs_double_moment"),
        ("/time/samples", "out_of_range"),
        ("/accuracy/tier", "invalid_value"),
        ("/outputs/1", "invalid_value"),
        ("/extra", "unknown_field"),
    }


@pytest.mark.parametrize(
    ("potential", "expected"),
    [
        (expression("zeta*g1"), [("/potential/expression", "formula")]),
        ({"type": "general", "F": "zeta*w"}, [("/potential/F", "formula")]),
        # Which terms there are depends on the body.
        ({"type": "homogeneous", "B": [1, 1, 1, 1], "log": [1]}, []),
        ({"type": "homogeneous", "B": ["z"], "log": [1]}, [("/potential/B/0", "invalid_number")]),
        ({"type": "rational", "a": [1]}, []),
    ],
)
def test_a_formula_is_checked_although_the_body_is_faulty(potential, expected):
    found = faults_of(changed(body={"A": "x", "C": 1}, potential=potential))
    assert found == [("/body/A", "invalid_number"), *expected]


@pytest.mark.parametrize("potential", [{"type": "homogeneous", "B": [1]}, {"type": "general", "F": "w"}])
def test_families_of_unequal_moments_refuse_equal_ones_whatever_the_motion(potential):
    found = faults_of(changed(body={"A": 1, "B": 1, "C": 1}, motion=STATE, potential=potential))
    assert found == [("/body", "equal_moments")]


def test_a_constant_that_depends_on_an_unread_parameter_is_not_judged():
    found = faults_of(changed(potential=expression("g1/(k-29)", k="x")))
    assert found == [("/potential/parameters/k", "invalid_number")]


def test_very_many_faults_are_counted_and_not_all_listed():
    found = faults_of(changed(time={"times": ["x"] * 5000}))
    assert len(found) == MAX_FAULTS + 1
    assert found[-1] == ("", "more_faults")


def test_a_constant_that_depends_on_unread_moments_is_not_judged():
    found = faults_of(changed(body={"A": "x", "C": 1}, potential=expression("g1/(A-17)")))
    assert found == [("/body/A", "invalid_number")]


@pytest.mark.parametrize("document", [None, 1, "problem", [PROBLEM]])
def test_what_is_no_object_is_no_problem(document):
    assert faults_of(document) == [("", "invalid_type")]


def test_an_empty_object_lacks_what_is_required():
    assert faults_of({}) == [
        (f"/{name}", "missing_field") for name in ("body", "potential", "motion", "time")
    ]


def test_a_message_says_what_is_accepted():
    with pytest.raises(InvalidProblemError) as caught:
        read_problem(changed(body={"A": 2, "C": 1, "D": 1}, method="x"))
    messages = [fault.message for fault in caught.value.faults]
    assert "A, B, C, allow_unphysical" in messages[0]
    assert "'auto', 'quadrature', 'integration' or 'both'" in messages[1]


def test_a_question_needs_no_motion():
    question = {name: PROBLEM[name] for name in ("body", "potential")}
    assert read_question(question).motion is None
    assert read_question({**question, "motion": PROBLEM["motion"]}).motion is not None
    assert faults_of({**question, "times": {}}, read=read_question) == [("/times", "unknown_field")]


def test_what_a_question_has_of_a_problem_is_judged_as_there():
    document = {
        **changed(),
        "time": {"stop": 0},
        "method": "guess",
        "outputs": [],
        "accuracy": {"tier": "best"},
    }
    found = faults_of(document)
    assert {pointer for pointer, _ in found} >= {"/time/samples", "/method", "/outputs", "/accuracy/tier"}
    assert faults_of(document, read=read_question) == found
    del document["motion"]
    assert faults_of(document, read=read_question) == found


def test_moments_may_be_equal_if_no_planar_motion_is_asked():
    question = {"body": {"A": 1, "C": 1}, "potential": {"type": "gravity", "a": 1}}
    assert read_question(question).motion is None


documents = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=5)
    | st.sampled_from(["planar", "state"]),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["type", "A", "lambda", "stop", "times", "at", "start", "tier"]),
            inner,
            max_size=4,
        )
    ),
    max_leaves=8,
)


@given(st.sampled_from(["body", "potential", "motion", "time", "accuracy", "method", "outputs"]), documents)
def test_nothing_but_faults_comes_of_nonsense(section, nonsense):
    with suppress(InvalidProblemError):
        read_problem(changed(**{section: nonsense}))


@pytest.fixture(scope="module")
def sandbox():
    sandbox = Sandbox(1, preload=["service.schemas.problem.problem"])
    yield sandbox
    sandbox.close()


@pytest.mark.parametrize(
    "sections",
    [
        {"time": {"times": [f"{n}.5" for n in range(100_000)]}},
        {"time": {"times": ["x"] * 100_000}},
        {"potential": expression("(" * 60 + "g1" + "+g2)^9" * 60)},
        {
            "potential": expression(
                "+".join(f"k{n}*g1" for n in range(100)), **{f"k{n}": "9" * 400 for n in range(100)}
            )
        },
        {"potential": expression("2^(1000)^(1000)*g1")},
        {"potential": expression("g1^1000*" * 400 + "g2")},
        {
            "body": {"A": f"1.{'7' * 250}3", "C": f"0.9{'1' * 250}7"},
            "potential": {"type": "homogeneous"} | dict.fromkeys("ABC", [f"1{'3' * 250}/{'7' * 251}"] * 20),
        },
        {
            "body": {"A": 20, "C": 19},
            "potential": {"type": "homogeneous", "C": [1] * 20, "log": [0] * 19 + [1]},
        },
    ],
)
def test_reading_ends(sections, sandbox):
    # Measured: at most 2 s on a busy machine; two minutes are a hang, and then the child is killed.
    sandbox.run(read_quietly, json.dumps(changed(**sections)), seconds=120.0)


def test_a_pointer_escapes_its_marks():
    assert pointer_to(["a/b", "~", 0]) == "/a~1b/~0/0"


@pytest.mark.parametrize("number", ["1e-400", "1e400", "1/1" + "0" * 500])
@pytest.mark.parametrize(
    ("section", "field", "accepted"),
    [
        ("accuracy", "tolerance", "1e-15 to 1e-2"),
        ("accuracy", "budget_seconds", "3600"),
        ("motion", "window", "0 to 999"),
        ("motion", "lambda", "accepted are 1e-300 to 1e300"),
        ("motion", "g3_sign", "1 and -1"),
        ("time", "samples", "1 to 100000"),
        ("time", "stop", "to 1e+15"),
        ("body", "A", "1e-300 to 1e300"),
    ],
)
def test_a_number_out_of_range_is_told_the_range_of_its_field(section, field, accepted, number):
    document = changed(accuracy={}) if section == "accuracy" else changed()
    document[section][field] = number
    with pytest.raises(InvalidProblemError) as caught:
        read_problem(document)
    (message,) = [fault.message for fault in caught.value.faults if fault.pointer == f"/{section}/{field}"]
    assert accepted in message
    assert section == "body" or "are 0 and 1e-300 to 1e300" not in message
