"""Solutions are found by their numbers."""

import pytest

from service.schemas.query.reading import read_where
from service.schemas.query.terms import ListQuery, OrderKey
from service.storage.codecs.summary import summary_columns
from service.storage.database.rows import new_id
from service.storage.searching.sources import SOLUTIONS
from tests.storage.searching.rows import subject_of
from tests.support.databases import PROBLEM, SUMMARY
from tests.support.finishing import finish_success

PERIODS = [3.0, 1.0, None, 2.0]


@pytest.fixture
def stored(jobs):
    """Four solutions of growing age, with these periods; the third is of another family and aperiodic."""
    ids = []
    for n, period in enumerate(PERIODS):
        family = "gravity" if period is None else "expression"
        problem = {**PROBLEM, "potential": {"type": family}}
        job = jobs.submit(problem, str(n))
        summary = {**SUMMARY, "period": period and {"value": period, "error": 0}}
        finish_success(jobs, jobs.claim("worker", lease_seconds=60), summary, dense=b"d", samples=b"s")
        ids.append(jobs.get(job.id).solution_id)
    return ids


def asked(*where, sort="created_at", descending=True, **further):
    conditions, faults = read_where(where, SOLUTIONS)
    assert not faults
    return ListQuery(conditions, (OrderKey(subject_of(sort), descending),), **further)


def positions(solutions, stored, *where, **query):
    return [stored.index(s.id) for s in solutions.find(asked(*where, **query)).solutions]


def test_the_newest_come_first(solutions, stored):
    assert positions(solutions, stored) == [3, 2, 1, 0]
    assert positions(solutions, stored, descending=False) == [0, 1, 2, 3]


def test_what_has_no_number_comes_last_in_either_order(solutions, stored):
    assert positions(solutions, stored, sort="period", descending=False) == [1, 3, 0, 2]
    assert positions(solutions, stored, sort="period") == [0, 3, 1, 2]


@pytest.mark.one_in(4)
@pytest.mark.parametrize("sort", ["created_at", "A", "period", "trace", "/motion/lambda"])
@pytest.mark.parametrize("descending", [True, False])
def test_pages_together_are_the_whole(solutions, stored, sort, descending):
    pages = [solutions.find(asked(sort=sort, descending=descending, limit=1, offset=n)) for n in range(5)]
    assert sorted(s.id for page in pages for s in page.solutions) == sorted(stored)
    assert {page.total for page in pages} == {4}


def test_filters_hold_together(solutions, stored):
    assert positions(solutions, stored, "family=gravity") == [2]
    assert positions(solutions, stored, "family=expression,period>=1.5,period<=2") == [3]
    assert positions(solutions, stored, "period<=3.0") == [3, 1, 0]
    assert positions(solutions, stored, "method=integration") == []
    assert positions(solutions, stored, "tier=standard", "A>=2,A<=2") == [3, 2, 1, 0]


def test_a_solution_is_found_by_its_job(solutions, stored):
    job_id = solutions.get(stored[1]).job_id
    assert positions(solutions, stored, f"job={job_id}") == [1]
    assert positions(solutions, stored, f"job={new_id()}") == []


def test_exact_numbers_become_doubles_in_their_columns():
    problem = {"body": {"A": "17/10", "C": 1}, "potential": {"type": "gravity"}, "motion": {"lambda": "1/3"}}
    summary = {
        "method": "quadrature", "period": {"value": "6.25"}, "energy": {"value": "1/0"}, "error": True,
        "invariants": {"energy": {"drift": 1e-9}, "areas": {"drift": 2e-9}}, "cost": {"compute_seconds": 0.5},
    }  # fmt: skip
    assert summary_columns(problem, summary) == {
        "family": "gravity",
        "method": "quadrature",
        "tier": None,
        "A": 1.7,
        "C": 1.0,
        "period": 6.25,
        "energy": None,
        "error": None,
        "B": None,
        "lambda_": 1 / 3,
        "drift": 2e-9,
        "trace": None,
        "seconds": 0.5,
        "stability": None,
        "aperiodic": None,
    }
