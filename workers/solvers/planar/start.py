"""Finds the window and the start of a planar motion, in balls of sufficient precision."""

from collections.abc import Callable
from typing import TypeVar

from flint import ctx

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion, Problem
from service.dynamics.reduction.start import starting_point
from service.dynamics.reduction.windows import PRECISION, choose_window, find_windows
from workers.solvers.assembly.place import Place
from workers.solvers.errors import PrecisionLostError
from workers.solvers.orbits.orbit import starting_state

T = TypeVar("T")

HIGHEST_PRECISION = 16 * PRECISION


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


def with_enough_bits(problem: Problem, solve: Callable[[Problem, Place], T]) -> T:
    """Return ``solve`` of the problem's place, in balls of enough bits: doubled until its integrand is known.

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
                return solve(problem, Place(window, starting_point(window, motion)))
        except PrecisionLostError:
            if precision >= HIGHEST_PRECISION:
                raise
            precision *= 2
