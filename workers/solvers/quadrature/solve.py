"""A planar motion from the problem to the motion with its evidence."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from flint import ctx

from service.dynamics.body import RigidBody
from service.dynamics.bounds import is_within
from service.dynamics.errors import DynamicsError
from service.dynamics.motion import Motion
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion, Problem
from service.dynamics.reduction.ends import require_known_ends
from service.dynamics.reduction.start import StartingPoint, starting_point
from service.dynamics.reduction.window import Window
from service.dynamics.reduction.windows import PRECISION, choose_window, find_windows
from workers.solvers.errors import AccuracyNotMetError
from workers.solvers.quadrature.aperiodic import solve_aperiodic
from workers.solvers.quadrature.orbit import starting_state
from workers.solvers.quadrature.periodic import solve_periodic
from workers.solvers.quadrature.time_map import PrecisionLostError

T = TypeVar("T")

HIGHEST_PRECISION = 16 * PRECISION


@dataclass(frozen=True, slots=True)
class PlanarStart:
    """The window of a planar motion and where in it the motion starts."""

    window: Window
    start: StartingPoint


def solve_planar(problem: Problem) -> Motion:
    """Solve a planar problem: the one integral, in closed form where it has one.

    The claimed error is twice the largest departure of the dense output from
    the motion, as seen between its nodes, plus what an error of the time does.
    A motion that ends in finite time is sampled at the asked times before it ends.

    Raises
    ------
    NoMotionError, SeveralWindowsError, NoSuchWindowError, StartOutsideWindowError
        The motion asked for is not there, or not the only one.
    LeavesDomainError
        The potential is not defined all the way.
    PeriodNeededError
        Times are asked in periods, and the motion has none.
    MotionEndedError
        It has ended before all of the asked times.
    AccuracyNotMetError
        The error is larger than the tolerance.
    """
    solved = attempt_planar(problem)
    if not is_within(solved.error, problem.tolerance):
        raise AccuracyNotMetError(solved.error, problem.tolerance)
    return solved


def attempt_planar(problem: Problem) -> Motion:
    """Return what :func:`solve_planar` does, however large its error is; raises the rest of its errors."""
    return with_enough_bits(problem, _solve)


def planar_start(body: RigidBody, potential: Potential, motion: PlanarMotion) -> tuple[float, ...]:
    """Return the initial state (p, q, r, g1, g2, g3) of a planar motion of any kind, periodic or not.

    Raises
    ------
    NoMotionError, SeveralWindowsError, NoSuchWindowError, StartOutsideWindowError
        The motion asked for is not there, or not the only one.
    """
    with ctx.workprec(PRECISION):
        window = choose_window(find_windows(body, potential, motion), motion)
        return tuple(float(value) for value in starting_state(starting_point(window, motion)))


def with_enough_bits(problem: Problem, solve: Callable[[Problem, PlanarStart], T]) -> T:
    """Return ``solve`` of the problem's start, in balls of enough bits: doubled until its integrand is known.

    Raises
    ------
    NoMotionError, SeveralWindowsError, NoSuchWindowError, StartOutsideWindowError
        The motion asked for is not there, or not the only one.
    PrecisionLostError
        The highest precision is not enough.
    """
    motion = problem.motion
    if not isinstance(motion, PlanarMotion):
        raise DynamicsError("quadrature solves planar motions only", pointer="/motion/type")
    precision = PRECISION
    while True:
        try:
            with ctx.workprec(precision):
                windows = find_windows(problem.body, problem.potential, motion, precision=precision)
                window = choose_window(windows, motion)
                return solve(problem, PlanarStart(window, starting_point(window, motion)))
        except PrecisionLostError:
            if precision >= HIGHEST_PRECISION:
                raise
            precision *= 2


def _solve(problem: Problem, found: PlanarStart) -> Motion:
    window, start = found.window, found.start
    require_known_ends(window)
    if window.kind != "periodic" and window.kind != "edge":
        return solve_aperiodic(problem, window, window.kind, start)
    return solve_periodic(problem, window, start)
