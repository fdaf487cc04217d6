"""A reader that trusts a valid document reads what those read who validate it."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.api.routes.jobs import EXAMPLES as JOBS
from service.api.routes.validations import EXAMPLES as VALIDATIONS
from service.catalogue import example_of
from service.dynamics.classical.bodies import CASES
from service.dynamics.potentials.potential import FormulaPotential
from service.schemas.atlas.documents import read_atlas, trusted_atlas
from service.schemas.problem.problem import check_problem, read_question, trusted_question
from service.schemas.problem.trusted import curve_of, potential_of, trusted_problem
from service.schemas.reading.documents import split_annotation
from service.schemas.sweep.reading import read_sweep
from service.schemas.sweep.sweep import trusted_sweep
from tests.conformance.specimens import SPECIMENS
from tests.support.problem_documents import problems, written
from tests.support.sweeps import SWEEP

FILES = {
    path.stem: json.loads(path.read_text())
    for path in (Path(__file__).parents[3] / "examples").glob("*.json")
}
SWEEPS = [SWEEP, *(each for each in FILES.values() if {"base", "axes"} <= each.keys())]
ATLASES = [each for each in FILES.values() if "lambda" in each]
PROBLEMS = {
    **{specimen.name: specimen.document for specimen in SPECIMENS},
    **{name: example_of(case) for name, case in CASES.items()},
    **{name: each for name, each in FILES.items() if "time" in each},
    **{f"job {name}": split_annotation(each["value"])[0] for name, each in JOBS.items()},
}


def assert_equal(trusted, validated):
    """Compare problems, and the trees of their potentials too, which equality leaves out."""
    assert trusted == validated
    one, other = trusted.potential, validated.potential
    assert type(one) is type(other)
    if isinstance(one, FormulaPotential):
        assert one.tree == other.tree
    assert one.notices == other.notices


@pytest.mark.parametrize("name", PROBLEMS)
def test_every_example_and_the_catalogue_are_read_as_they_were_validated(name):
    document = json.loads(json.dumps(PROBLEMS[name]))
    assert_equal(trusted_problem(document), check_problem(document).problem)


@given(problems, st.sampled_from(["proved", "undecided"]))
def test_any_document_is_read_as_it_was_validated(document, accept):
    document = {**document, "accept": accept}
    assert_equal(trusted_problem(document), check_problem(document).problem)


@given(problems, written)
def test_on_another_curve_too(document, number):
    """The second document is read by its number alone, where there is a formula."""
    curve = curve_of(document)
    if curve is None:
        return
    other = {**document, "motion": {**document["motion"], curve.field: number}}
    trusted_problem(document)
    found = trusted_problem(other)
    whole = {**other, "note": "read as a whole"}
    assert_equal(found, trusted_problem(whole))
    assert found.potential == potential_of(other["potential"], found.body)
    assert curve_of(other).rest == curve.rest


def test_what_is_cached_is_for_one_problem():
    """Programs are made after some evaluations: a job's digits do not depend on the jobs before it."""
    document = PROBLEMS["first"]
    one, other = (trusted_problem(document).potential for _ in range(2))
    assert one.tape == other.tape
    assert one.tape.programs is not other.tape.programs


@pytest.mark.parametrize("document", [*PROBLEMS.values(), *(each["value"] for each in VALIDATIONS.values())])
def test_questions_are_read_as_they_were_validated(document):
    assert_same_question(document)


@given(
    problems,
    st.fixed_dictionaries(
        {},
        optional={
            "points": st.fixed_dictionaries(
                {"w": st.lists(written, max_size=2)}, optional={"g2": st.just([0.5])}
            ),
            "nearest": st.sampled_from([{"degree": 3}, {"degree": "4"}, None]),
        },
    ),
    st.sets(st.sampled_from(["motion", "time"])),
)
def test_any_question_is_read_as_it_was_validated(document, further, missing):
    whole = {**document, **further}
    assert_same_question({name: part for name, part in whole.items() if name not in missing})


def assert_same_question(document):
    trusted, validated = trusted_question(document), read_question(document)
    # Numbers in it are written in another way.
    assert replace(trusted, stated={}) == replace(validated, stated={})
    body = validated.body
    assert potential_of(trusted.stated, body) == potential_of(validated.stated, body)


@pytest.mark.parametrize("document", SWEEPS)
def test_sweeps_are_read_as_they_were_validated(document):
    assert trusted_sweep(document) == read_sweep(document)


@pytest.mark.parametrize(
    "axis",
    [
        {"values": [1, "3/2", 0.1]},
        {"linspace": [1, "2", 3]},
        {"logspace": ["1/10", 10.0, "5"]},
        {"uniform": [1, 2, 7], "seed": "3"},
        {"uniform": [1, 2, 7.0]},
    ],
)
@pytest.mark.parametrize(
    "further", [{}, {"series": True, "keep": []}, {"combine": "zip", "keep": ["energy"]}]
)
def test_axes_and_what_is_kept_are_read_as_they_were_validated(axis, further):
    document = {**SWEEP, "axes": [{"pointer": "/motion/lambda", **axis}], **further}
    assert trusted_sweep(document) == read_sweep(document)


@pytest.mark.parametrize("document", ATLASES)
@pytest.mark.parametrize(
    "further",
    [{}, {"outputs": []}, {"samples": "9", "g1_sign": -1, "accept": "undecided"}, {"lambda": ["1e-3", 1.5]}],
)
def test_atlases_are_read_as_they_were_validated(document, further):
    assert trusted_atlas({**document, **further}) == read_atlas({**document, **further})
