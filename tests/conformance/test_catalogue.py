"""What the catalogue owes: documents that are accepted, with one canonical form each."""

import json
from typing import get_args

import pytest

from service.catalogue import cases, families
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.potentials.potential import NoClosedFormError
from service.schemas.problem.potentials import MODELS
from service.schemas.problem.problem import check_problem, problem_digest, read_problem
from service.schemas.query.terms import FamilyName
from tests.conformance.specimens import SPECIMENS, Specimen
from tests.support.canonical import canonical_document

every = pytest.mark.parametrize("specimen", SPECIMENS, ids=str)


def test_every_type_of_the_wire_is_a_family_of_the_catalogue_and_back():
    assert [family.type for family in families()] == list(MODELS) == list(get_args(FamilyName))
    for family in families():
        assert family.example["potential"]["type"] == family.type
        assert set(family.parameters) <= set(MODELS[family.type].model_fields)
        assert family.source
        assert family.conditions


def test_every_case_belongs_to_a_family_and_has_a_name_of_its_own():
    names = [case.name for case in cases()]
    assert len(set(names)) == len(names)
    assert {"bobylev-steklov", "elliptic", "goriachev", "chaplygin", "kovalevskaya"} <= set(names)
    for case in cases():
        assert case.example["potential"]["type"] == case.family
        assert case.special
        assert case.source


@pytest.mark.parametrize("name", ["goriachev", "chaplygin", "kovalevskaya"])
def test_the_integrable_cases_have_the_moments_of_kovalevskaya(name: str):
    (case,) = [case for case in cases() if case.name == name]
    body = read_problem(case.example).body
    assert body.A == body.B == 2 * body.C


@every
def test_the_canonical_document_is_its_own_and_states_the_same(specimen: Specimen):
    checked = check_problem(specimen.document)
    again = check_problem(json.loads(json.dumps(checked.canonical)))
    assert again.canonical == checked.canonical
    assert again.problem == checked.problem
    assert problem_digest(again.canonical) == problem_digest(checked.canonical)


@every
def test_what_is_left_out_is_the_default(specimen: Specimen):
    canonical = canonical_document(specimen.document)
    defaults = {"method": "auto", "accuracy": {"tier": "standard"}}
    assert canonical_document({**specimen.document, **defaults}) == canonical


@every
def test_the_formula_is_the_potential(specimen: Specimen):
    potential = read_problem(specimen.document).potential
    try:
        tape = potential.tape
    except NoClosedFormError:
        assert specimen.document["potential"]["type"] == "general"
        return
    assert compile_tape(parse(potential.formula())) == tape
