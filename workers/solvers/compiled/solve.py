"""Solves a single periodic motion in compiled doubles."""

import math
from dataclasses import replace

import numpy as np

from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.problem import PlanarMotion, StartAtPoint
from service.dynamics.solution.dense_output import EPSILON, Period
from workers.solvers.compiled.batch import Batch, BatchResult, Tier, solve_batch
from workers.solvers.compiled.evaluation.program import Program, make_program
from workers.solvers.compiled.frame import Frame, make_frame
from workers.solvers.compiled.motion import Bounds, SpectralMotion
from workers.solvers.compiled.rational.orbit import rational_orbit
from workers.solvers.compiled.rational.roots import Radicand, rational_radicand
from workers.solvers.compiled.records import Records, copied
from workers.solvers.compiled.time_map.series import time_at

START_ULPS = 8.0
"""Roundings on the way from g1 at the start to the phase there, in 2^-52."""

EMPTY_PROGRAM = Program(np.empty((0, 4), dtype=np.int64), 0)
NO_CONSTANTS = np.empty((1, 0))


def solve_spectral(
    body: RigidBody, potential: Potential, motion: PlanarMotion, *, tier: Tier
) -> SpectralMotion | None:
    """Return the motion, None if it is not decided here that there is one, which, and that it is periodic.

    The way through a pole is solved for an even A/C (or C/A) only; ``high`` is for
    A = 2C (or C = 2A) and rational potentials even in g2. The tiers differ by what
    :meth:`SpectralMotion.error_at` says then.
    """
    frame = make_frame(body, motion)
    if frame is None:
        return None
    try:
        program, constants = make_program(potential.tape)
    except NoClosedFormError:
        return None
    if tier == "high":
        radicand = rational_radicand(body, potential, motion)
        exact = None if radicand is None else solve_rational(radicand, motion, frame)
        return None if exact is None else _motion(potential, *exact)
    run = solve_batch(Batch(program, constants[None, :], frame.shared, tier))
    about = run.found[0]
    if not about["panels"]:
        return None
    found = _motion(potential, Period(float(about["period"]), 0.0, float(about["period_error"])), run)
    return _with_rounded_start(found) if isinstance(motion.start, StartAtPoint) else found


def solve_rational(
    radicand: Radicand, motion: PlanarMotion, frame: Frame
) -> tuple[Period, BatchResult] | None:
    """Return the period to the last digit and the only motion of a batch, without samples; None if undecided.

    The curve is that of the radicand; ``motion`` says where on it the motion is, and where it starts.
    """
    orbit = rational_orbit(radicand, motion, frame)
    if orbit is None:
        return None
    loops, period = orbit
    run = solve_batch(Batch(EMPTY_PROGRAM, NO_CONSTANTS, loops, "high"))
    about, loop = run.found[0], run.loops[0]
    # The balls know the length of the map, hence the sum of its errors; what lies on the way to a
    # place in it is bounded by half of all there can be, and half of what is left over.
    off = abs(about.period - period.hi)
    if not (about.panels and off <= about.period_error + 8.0 * EPSILON * period.hi):
        return None
    about.period_error = 0.5 * (about.period_error + off) + EPSILON * period.hi
    if isinstance(motion.start, StartAtPoint):
        # Slow next to a separatrix, the motion takes long for the rounding of its start.
        about.period_error += _time_of_one_ulp(run.panels, float(loop.start))
    loop.period_hi, loop.period_lo = period.hi, period.lo
    return period, run


def _with_rounded_start(found: SpectralMotion) -> SpectralMotion:
    """Count the rounding of the start as time: long next to the equator, where g1 and g3 hardly change."""
    p, _, r, _, g2, _ = np.abs(found.sample(np.zeros(1))[0]).tolist()
    # g1' = r g2 and g3' = −p g2, q being 0.
    slowest = g2 * min(p, r)
    late = START_ULPS * EPSILON / slowest if slowest > 0.0 else math.inf
    return replace(found, bounds=replace(found.bounds, time=found.bounds.time + late))


def _time_of_one_ulp(panels: Records, u: float) -> float:
    """Return the time in which the phase goes from ``u`` to a neighbouring double, the longer of both."""
    before, at, after = (
        time_at(panels, len(panels), float(phase))[0]
        for phase in (np.nextafter(u, -math.inf), u, np.nextafter(u, math.inf))
    )
    return float(max(at - before, after - at))


def _motion(potential: Potential, period: Period, run: BatchResult) -> SpectralMotion:
    _, _, error, speed, largest, rate = run.found[0].item()
    bounds = Bounds(error, speed, rate, largest)
    return SpectralMotion(period, run.loops, copied(run.panels), bounds, potential)
