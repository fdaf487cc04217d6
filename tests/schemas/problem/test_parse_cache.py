"""What was read before is read no other way: the same problem, the same document, the same faults."""

import copy
import itertools

import pytest

from service.dynamics.exact import NumberBeyondDoubles
from service.dynamics.potentials.potential import FormulaPotential
from service.schemas.problem.documents import JobIn
from service.schemas.problem.problem import check_problem
from service.schemas.problem.trusted import curve_of
from service.schemas.reading.documents import InvalidProblemError

DOCUMENT = {
    "body": {"A": 2, "C": 1},
    "potential": {"type": "expression", "expression": "a*g1", "parameters": {"a": "-1/3"}},
    "motion": {"type": "planar", "lambda": "6/5"},
    "time": {"periods": 1, "samples": 101},
    "accuracy": {"tier": "draft"},
}


NOTES = map(str, itertools.count())


def read_as_a_whole(document):
    """Read a document that equals none before: it has a note of its own."""
    return check_problem({**document, "note": next(NOTES)}, JobIn)


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"motion": {"type": "planar", "nu": 1}},
        {"motion": {"type": "planar", "lambda": 0.1, "start": {"g1": "1/2"}}},
        {"body": {"A": "17/10", "B": "13/10", "C": 1}, "outputs": ["gamma", "stability"]},
        {"potential": {"type": "gravity", "a": -1}, "method": "quadrature"},
        {"potential": {"type": "homogeneous", "A": ["-1/2", "0.1"]}},
        {"time": {"times": [0, "1/3"]}, "accuracy": {"tolerance": 1e-9}, "accept": "undecided"},
    ],
)
def test_a_known_document_states_the_same_problem(changed):
    document = {**DOCUMENT, **changed}
    whole = read_as_a_whole(document)
    assert curve_of(document) is not None
    for _ in range(2):
        known = check_problem(copy.deepcopy(document))
        assert known.problem == whole.problem
        assert known.canonical == whole.canonical


@pytest.mark.parametrize(
    "changed",
    [
        {"body": {"A": 1, "C": 1}},
        {"body": {"A": 3, "C": 1}, "motion": {"type": "planar", "nu": 1}},
        {"motion": {"type": "planar"}},
        {"motion": {"type": "planar", "lambda": -1}},
        {"time": None},
        {"outputs": ["stability"]},
        {"potential": {"type": "expression", "expression": "x"}},
        {"unknown": 1},
    ],
)
def test_faults_are_those_of_the_whole_document(changed):
    check_problem(DOCUMENT)
    found = []
    for read in (check_problem, read_as_a_whole):
        with pytest.raises(InvalidProblemError) as refused:
            read({**DOCUMENT, **changed})
        found.append([(fault.pointer, fault.code) for fault in refused.value.faults])
    assert found[0] == found[1]


def test_what_is_kept_beside_a_formula_is_for_one_problem():
    """Programs are made after some evaluations: a job's digits do not depend on the jobs before it."""
    one, other = (check_problem(DOCUMENT).problem.potential for _ in range(2))
    assert isinstance(one, FormulaPotential)
    assert isinstance(other, FormulaPotential)
    assert one.tape == other.tape
    assert one.tape.programs is not other.tape.programs


def test_numbers_that_are_written_otherwise_are_not_mistaken():
    """0.1 is 1/10 however it is written, and a double next to it is another number."""
    as_number, as_text = (
        check_problem({**DOCUMENT, "potential": {"type": "gravity", "a": a}}).problem for a in (0.1, "1/10")
    )
    assert as_number.potential == as_text.potential
    double = check_problem({**DOCUMENT, "potential": {"type": "gravity", "a": 0.1 + 2.0**-55}}).problem
    assert double.potential != as_number.potential


@pytest.mark.parametrize("field", ["lambda", "nu"])
def test_documents_that_differ_in_their_curve_alone_have_each_its_own(field):
    numbers = ["6/5", 0.3, 2] if field == "lambda" else ["6/5", -0.3, -2]
    for number in numbers:
        document = {**DOCUMENT, "motion": {"type": "planar", field: number, "g3_sign": -1}}
        whole = read_as_a_whole(document)
        known = check_problem(document)
        assert known.problem == whole.problem
        assert known.canonical == whole.canonical


@pytest.mark.parametrize(
    "changed",
    [
        {"motion": {"type": "planar", "lambda": NumberBeyondDoubles("1e-400")}},
        {"potential": {"type": "gravity", "a": NumberBeyondDoubles("1e-400")}},
        {"potential": {"type": "gravity", "a": NumberBeyondDoubles("1e400")}},
    ],
)
def test_numbers_beside_which_no_double_is_are_mistaken_for_none(changed):
    check_problem({**DOCUMENT, "potential": {"type": "gravity", "a": 0.0, "c": -1}})
    check_problem({**DOCUMENT, "potential": {"type": "gravity", "a": 0.0}})
    assert curve_of({**DOCUMENT, **changed}) is None
    with pytest.raises(InvalidProblemError):
        check_problem({**DOCUMENT, **changed})


@pytest.mark.parametrize("number", ["-1", 0, True, None, "x", "*", 1e301])
def test_a_faulty_number_of_a_known_document_is_refused(number):
    check_problem(DOCUMENT)
    with pytest.raises(InvalidProblemError) as refused:
        check_problem({**DOCUMENT, "motion": {"type": "planar", "lambda": number}})
    assert {fault.pointer for fault in refused.value.faults} == {"/motion/lambda"}
