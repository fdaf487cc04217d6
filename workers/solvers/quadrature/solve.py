"""A planar motion from the problem to the motion with its evidence."""

from dataclasses import dataclass

import numpy as np
from flint import ctx
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.dense_output import DenseOutput
from service.dynamics.errors import DynamicsError
from service.dynamics.motion import Estimate, Motion
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion, Problem
from service.dynamics.reduction.start import StartingPoint, starting_point
from service.dynamics.reduction.window import Window
from service.dynamics.reduction.windows import PRECISION, choose_window, find_windows, require_periodic
from service.dynamics.sampling import sample_times
from workers.solvers.errors import AccuracyNotMetError
from workers.solvers.quadrature.dense import resolve_motion
from workers.solvers.quadrature.orbit import make_orbit, starting_state
from workers.solvers.quadrature.time_map import PrecisionLostError, TimeMap, make_time_map

FloatArray = NDArray[np.float64]

FIRST_PASSAGE = "first_pole_passage"
"""In the evidence where that convention was needed: the time until which there was no choice."""
HIGHEST_PRECISION = 16 * PRECISION
SYMMETRIC_POLE_PASSAGE = "symmetric_pole_passage"
"""At a pole where the equations allow several continuations g1 keeps its sign and g3 flips (A > C)."""


@dataclass(frozen=True, slots=True)
class _Solved:
    dense: DenseOutput
    time_map: TimeMap
    evaluations: int
    passages: FloatArray
    energy: Estimate
    window: Window
    start: StartingPoint


def solve_planar(problem: Problem) -> Motion:
    """Solve a planar problem by quadrature.

    The claimed error is twice the largest departure of the dense output from
    the motion, as seen between its nodes, plus what an error of the phase does.

    Raises
    ------
    NoMotionError, SeveralWindowsError, NoSuchWindowError, StartOutsideWindowError
        The motion asked for is not there, or not the only one.
    AperiodicMotionError
        It is there and never closes.
    AccuracyNotMetError
        The error is larger than the tolerance.
    """
    motion = problem.motion
    if not isinstance(motion, PlanarMotion):
        raise DynamicsError("quadrature solves planar motions only", pointer="/motion/type")
    solved = _solve_with_enough_bits(problem, motion)
    period = solved.time_map.period
    times = sample_times(problem.time, period)
    samples = solved.dense(times)
    error = solved.dense.error_at(times)
    if not error <= problem.tolerance:
        raise AccuracyNotMetError(error, problem.tolerance)
    loop = solved.start.arc.loop
    passes_pole = solved.start.arc.is_whole_loop or bool(solved.start.arc.poles)
    conventions = (SYMMETRIC_POLE_PASSAGE,) if passes_pole and not loop.is_smooth_at_poles else ()
    return Motion(
        method="quadrature",
        dense=solved.dense,
        times=times,
        samples=samples,
        error=error,
        energy=solved.energy,
        window=solved.window,
        cross_check=None,
        conventions=conventions,
        evidence={
            "nodes": solved.time_map.nodes,
            "panels": len(solved.time_map.edges) - 1,
            "pieces": len(solved.dense.breaks) - 1,
            "states": solved.evaluations,
            "departure": 0.5 * solved.dense.error,
            **({FIRST_PASSAGE: float(solved.passages[0])} if conventions else {}),
        },
    )


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


def _solve_with_enough_bits(problem: Problem, motion: PlanarMotion) -> _Solved:
    """Double the precision of the balls until the integrand is known to a double's."""
    precision = PRECISION
    while True:
        try:
            with ctx.workprec(precision):
                return _solve(problem, motion, precision)
        except PrecisionLostError:
            if precision >= HIGHEST_PRECISION:
                raise
            precision *= 2


def _solve(problem: Problem, motion: PlanarMotion, precision: int) -> _Solved:
    windows = find_windows(problem.body, problem.potential, motion, precision=precision)
    window = choose_window(windows, motion)
    require_periodic(window)
    start = starting_point(window, motion)
    orbit = make_orbit(start)
    time_map = make_time_map(orbit.rate, orbit.corners, is_even=orbit.is_even)
    resolved = resolve_motion(orbit, time_map, atol=min(1e-14, 1e-3 * problem.tolerance))
    h = start.arc.loop.energy(orbit.somewhere())
    energy = Estimate(float(h.mid()), float(h.rad()) + abs(float(h.mid() - float(h.mid()))))
    return _Solved(resolved.dense, time_map, resolved.evaluations, resolved.passages, energy, window, start)
