"""No tier costs more than the next more accurate one: told by who is asked and who answers, not by time."""

from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise, product

import pytest

from service.dynamics.accuracy import TIER_TOLERANCES, TIERS
from service.dynamics.motion import Motion
from service.dynamics.problem import Accuracy, PlanarMotion, Problem, TimePeriods
from service.schemas.problem.problem import read_problem
from tests.conformance.specimens import CATALOGUE, Specimen
from workers.computation.compute import beside_enclosures
from workers.solvers import choose as table
from workers.solvers.assembly.families import Declined, Family, Place
from workers.solvers.choose import FAMILIES, FamilyName, find_motion, row_for
from workers.solvers.compiled.solve import solve_spectral

ORDER = tuple(FAMILIES)
"""Families from the cheapest to the dearest."""
PERIODS = (1, 10, 1000)
"""Later samples are known less well, so that kernels begin to decline."""
PLANAR = [each for each in CATALOGUE if isinstance(read_problem(each.document).motion, PlanarMotion)]


class QuadratureAskedError(Exception):
    """The last one of every row is asked, which has every motion: what it finds does not matter here."""


@dataclass(frozen=True)
class Noted:
    """A family of which is noted who was asked, and who answered."""

    name: FamilyName
    family: Family
    asked: list[FamilyName]
    answered: list[FamilyName]

    def takes(self, problem: Problem, place: Place) -> bool:
        return self.family.takes(problem, place)

    def promise(self, problem: Problem) -> float:
        return self.family.promise(problem)

    def solve(self, problem: Problem, place: Place) -> Motion | Declined:
        self.asked.append(self.name)
        if self.name == "quadrature":
            self.answered.append(self.name)
            raise QuadratureAskedError
        found = self.family.solve(problem, place)
        if isinstance(found, Motion):
            self.answered.append(self.name)
        return found


@pytest.mark.parametrize(("cheaper", "dearer"), tuple(pairwise(TIERS)))
def test_a_tier_asks_its_own_kernel_and_then_all_that_the_next_one_asks(cheaper, dearer):
    for kind, method in product(("periodic", "not periodic"), ("auto", "both")):
        one, other = (row_for(kind, method, grade).asked for grade in (cheaper, dearer))
        assert one[len(one) - len(other) :] == other
        assert [name for name in ORDER if name in one] == list(one)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("specimen", PLANAR, ids=str)
def test_what_computes_a_motion_is_no_dearer_than_at_the_next_tier(specimen: Specimen, monkeypatch):
    asked: list[FamilyName] = []
    answered: list[FamilyName] = []
    noted = {name: Noted(name, family, asked, answered) for name, family in FAMILIES.items()}
    monkeypatch.setattr(table, "FAMILIES", noted)
    read = read_problem(specimen.document)
    for periods in PERIODS:
        steps: dict[str, tuple[int, set[FamilyName]]] = {}
        for tier in TIERS:
            asked.clear()
            answered.clear()
            accuracy = Accuracy(TIER_TOLERANCES[tier], tier)
            problem = replace(read, time=TimePeriods(Fraction(periods), 2), accuracy=accuracy)
            if tier == "certified":
                # The function of time between the enclosures.
                problem = replace(problem, accuracy=beside_enclosures(problem))
            with suppress(QuadratureAskedError):
                find_motion(problem)
            assert len(answered) == 1
            steps[tier] = ORDER.index(answered[0]), set(asked)
        for cheaper, dearer in pairwise(TIERS):
            assert steps[cheaper][0] <= steps[dearer][0], (periods, steps)
            # What is dear is not tried in vain either.
            in_vain = steps[cheaper][1] - steps[dearer][1]
            assert in_vain <= {"draft doubles", "standard doubles", "high doubles"}, (periods, steps)


def test_what_the_kernel_of_draft_declines_is_left_to_that_of_standard():
    """Over 100 000 periods of this motion the kernel of draft claims more than 1e-6, the other one less."""
    document = {
        "body": {"A": 2, "B": "3/2", "C": 1},
        "potential": {"type": "expression", "expression": "-g1 + 1/(20*g3^2)"},
        "motion": {"type": "planar", "nu": 4},
        "time": {"periods": 100_000, "samples": 11},
        "accuracy": {"tier": "draft"},
    }
    problem = read_problem(document)
    draft = find_motion(problem)
    assert isinstance(problem.motion, PlanarMotion)
    drafted, standard = (
        solve_spectral(problem.body, problem.potential, problem.motion, tier=tier)
        for tier in ("draft", "standard")
    )
    assert drafted is not None
    assert standard is not None
    assert standard.error_at(draft.times) <= problem.tolerance < drafted.error_at(draft.times)
    assert draft.evidence["compiled"] == len(standard.panels)
    assert (draft.samples == standard.sample(draft.times, draft.low_parts)).all()
