"""The family of solvers by elliptic functions in doubles, for potentials of three terms."""

from service.dynamics.bounds import is_within
from service.dynamics.motion import Motion
from service.dynamics.problem import Problem
from workers.solvers.assembly.families import NOT_MINE, Declined, PeriodicPlace, Place
from workers.solvers.assembly.periodic import Sampled, make_periodic
from workers.solvers.closed_form.solve import solve_closed_form

WELL_CONDITIONED = 1e-12
"""Largest error of a closed form in doubles that is preferred to the quadrature in balls."""


class ClosedFormFamily:
    """See :class:`workers.solvers.assembly.families.Family`."""

    def takes(self, problem: Problem, place: Place) -> bool:
        """Take periodic motions; whether V has three terms is seen when it is solved."""
        return isinstance(place, PeriodicPlace)

    def promise(self, problem: Problem) -> float:
        """Promise a few roundings more than a double has."""
        return WELL_CONDITIONED

    def solve(self, problem: Problem, place: Place) -> Motion | Declined:
        """Return the motion; declined without the three terms, or where roundings exceed the promise."""
        if not isinstance(place, PeriodicPlace):
            return NOT_MINE
        closed = solve_closed_form(problem.body, problem.potential, place.start, place.window)
        if closed is None:
            return NOT_MINE
        error = closed.error()
        if not is_within(error, self.promise(problem)):
            return Declined(error)
        evidence: dict[str, float | int | str] = {"closed_form": "elliptic functions", "rounding": error}
        found = Sampled(closed.sample, closed.period, closed.passages, error, evidence)
        return make_periodic(problem, place, found)
