"""A planar motion from the chooser, as a job has it."""

from service.dynamics.motion import Motion
from service.dynamics.problem import Problem
from workers.solvers.choose import find_motion
from workers.solvers.errors import require_error_within


def solve_planar(problem: Problem) -> Motion:
    """Return what :func:`find_motion` does, if its error is within the tolerance, as the job requires too."""
    found = find_motion(problem)
    require_error_within(found.error, problem.tolerance)
    return found
