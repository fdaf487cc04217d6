"""Which solver is asked for what: whole tables, their order kept, families that keep their duties."""

from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product
from math import inf
from typing import get_args

import pytest

from service.dynamics.motion import Motion
from service.dynamics.numerics import is_within
from service.dynamics.problem import Accuracy, Method, PlanarMotion, Problem, StateMotion, Tier
from tests.support.planar import body, planar
from workers.solvers import choose as table
from workers.solvers.assembly.families import NOT_MINE, Declined, PeriodicPlace, Place
from workers.solvers.choose import (
    COMPILED,
    ENCLOSURES,
    FAMILIES,
    FUNCTIONS_OF_TIME,
    Grade,
    Kind,
    choose_enclosures,
    compiled_tier,
    enclosure_row_for,
    find_motion,
    grade_of,
    row_for,
    with_enough_bits,
)
from workers.solvers.errors import AccuracyNotMetError

BODY = body(2, 1, "3/2")
# Three terms: every family has this motion.
PROBLEM = planar(BODY, "-g1 + 1/(20*g3^2)", PlanarMotion(None, nu=Fraction(1)), (0, 1, 7))
ACCURACIES = {
    "draft": Accuracy(1e-6, "draft"),
    "loose": Accuracy(1e-8, "standard"),
    "standard": Accuracy(1e-10, "standard"),
    "high": Accuracy(1e-13, "high"),
}


def problem_of(grade: str, method: Method = "auto") -> Problem:
    return replace(PROBLEM, accuracy=ACCURACIES[grade], method=method)


def test_every_motion_has_a_row_and_every_row_a_motion():
    rows = [row_for(*asked) for asked in product(get_args(Kind), get_args(Method), get_args(Grade))]
    assert {id(row) for row in rows} == {id(row) for row in FUNCTIONS_OF_TIME}
    enclosing = [enclosure_row_for(*asked) for asked in product(get_args(Method), get_args(Grade))]
    assert {id(row) for row in enclosing} == {id(row) for row in ENCLOSURES}


def test_every_row_of_planar_motions_ends_with_one_that_has_them_all():
    for row in FUNCTIONS_OF_TIME:
        assert row.asked[-1] in ("quadrature", "integration")
        assert len(set(row.asked)) == len(row.asked)
        for family in row.families[:-1]:
            assert family.promise(PROBLEM) < inf or family is FAMILIES["way"]


def test_grades_are_the_tiers_and_what_is_looser_than_standard():
    for grade, accuracy in ACCURACIES.items():
        assert grade_of(accuracy) == grade
    assert set(get_args(Grade)) == {*get_args(Tier), "loose"}


@pytest.mark.parametrize(
    ("grade", "method", "evidence"),
    [
        ("draft", "auto", "compiled"),
        ("loose", "auto", "compiled"),
        ("high", "auto", "compiled"),
        ("standard", "auto", "compiled"),
        ("draft", "quadrature", "nodes"),
        ("standard", "quadrature", "nodes"),
    ],
)
def test_the_first_of_the_row_that_has_the_motion_computes_it(grade, method, evidence):
    found = find_motion(problem_of(grade, method))
    assert evidence in found.evidence
    assert len({"compiled", "closed_form", "nodes"} & set(found.evidence)) == 1


# Ways through poles have a test of their own.
@pytest.mark.one_in(4)
@pytest.mark.parametrize("name", [name for name in get_args(table.FamilyName) if name != "way"])
@pytest.mark.parametrize("grade", ["draft", "loose", "standard", "high"])
def test_families_keep_what_they_promise_and_agree(name, grade):
    """Where two families have one motion, their claims explain how far they are apart."""
    problem, family = problem_of(grade), FAMILIES[name]

    def solve(problem: Problem, found: Place) -> Motion | Declined:
        place = PeriodicPlace(found.window, found.start)
        assert family.takes(problem, place)
        return family.solve(problem, place)

    found = with_enough_bits(problem, solve)
    if isinstance(found, Declined):
        # Its claim is too wide for the tolerance: this is said, and nothing else is handed over.
        assert name in COMPILED
        assert problem.tolerance < found.reached <= ACCURACIES[COMPILED[name]].tolerance
        return
    assert isinstance(found, Motion)
    assert is_within(found.error, family.promise(problem))
    reference = find_motion(problem_of("standard", "quadrature"))
    assert abs(found.samples - reference.samples).max() <= found.error + reference.error


@dataclass(frozen=True)
class Silent:
    """Notes that it was asked, and has nothing."""

    name: str
    notes: list[str]
    takes_it: bool = True
    answer: Declined = NOT_MINE

    def takes(self, problem: Problem, place: Place) -> bool:
        return self.takes_it

    def promise(self, problem: Problem) -> float:
        return inf

    def solve(self, problem: Problem, place: Place) -> Motion | Declined:
        self.notes.append(self.name)
        return self.answer


def test_families_are_asked_in_the_order_of_the_row_until_one_has_it(monkeypatch):
    notes: list[str] = []
    families = {name: Silent(name, notes) for name in FAMILIES}
    monkeypatch.setattr(table, "FAMILIES", {**families, "quadrature": FAMILIES["quadrature"]})
    assert "nodes" in find_motion(problem_of("draft")).evidence
    assert notes == ["draft doubles", "standard doubles", "high doubles", "closed form", "way"]


def test_who_does_not_take_it_is_not_asked(monkeypatch):
    notes: list[str] = []
    families = {name: Silent(name, notes, takes_it=name != "standard doubles") for name in FAMILIES}
    monkeypatch.setattr(table, "FAMILIES", {**families, "quadrature": FAMILIES["quadrature"]})
    find_motion(problem_of("draft"))
    assert notes == ["draft doubles", "high doubles", "closed form", "way"]


def test_what_everybody_declines_is_refused_with_what_the_last_one_reached(monkeypatch):
    families = {name: Silent(name, [], answer=Declined(0.25)) for name in FAMILIES}
    monkeypatch.setattr(table, "FAMILIES", families)
    with pytest.raises(AccuracyNotMetError) as refused:
        find_motion(problem_of("draft"))
    assert refused.value.reached == 0.25


def test_those_who_solve_many_at_once_are_told_by_the_same_table():
    assert {grade: compiled_tier(problem_of(grade)) for grade in ACCURACIES} == {
        "draft": "draft",
        "loose": "standard",
        "standard": "standard",
        "high": "high",
    }
    assert compiled_tier(problem_of("draft", "quadrature")) is None


@pytest.mark.parametrize("kind", ["state", "planar"])
def test_integration_is_asked_where_the_table_names_it(kind):
    problem = problem_of("draft", "integration")
    if kind == "state":
        start = find_motion(problem_of("high")).samples[0].tolist()
        omega, gamma = (tuple(map(Fraction, part)) for part in (start[:3], start[3:]))
        problem = replace(problem_of("draft"), motion=StateMotion(omega, gamma))
    found = find_motion(problem)
    assert found.method == "integration"
    reference = find_motion(problem_of("high"))
    # The state was rounded to doubles, which matters less than the tolerance of the tier draft.
    assert abs(found.samples - reference.samples).max() <= 1e-6


def test_enclosures_come_on_top_where_the_table_says_so():
    assert choose_enclosures(problem_of("standard")).when == "where needed"
    assert choose_enclosures(problem_of("standard", "quadrature")).when == "never"
    certified = replace(PROBLEM, accuracy=Accuracy(1e-15, "certified"))
    assert choose_enclosures(certified).when == "always"
    assert choose_enclosures(certified).asked == ("elliptic", "integral")
