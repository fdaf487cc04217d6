"""Periodic planar motions in compiled doubles, one or many."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.dense_output import EPSILON, Period
from service.dynamics.motion import COLUMNS
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.problem import PlanarMotion, StartAtPoint
from workers.solvers.spectral import curve, time_map
from workers.solvers.spectral.frame import Frame, make_frame, primed_logarithm
from workers.solvers.spectral.motion import Bounds, SpectralMotion
from workers.solvers.spectral.program import Program, make_program
from workers.solvers.spectral.rational import rational_orbit
from workers.solvers.spectral.scan import scan_places
from workers.solvers.spectral.solve_set import solve_sets

FloatArray = NDArray[np.float64]
Tier = Literal["draft", "standard", "high"]

TOLERANCES: dict[Tier, float] = {"draft": 1e-8, "standard": 1e-12, "high": 2e-15}
"""Tail of dt/du on a panel against the whole, below which it is resolved."""

START_ULPS = 8.0
"""Roundings on the way from g1 at the start to the phase there, in 2^-52."""

EMPTY_PROGRAM = Program(np.empty((0, 4), dtype=np.int64), 0)
PLACES, MATRIX, POINTS = scan_places(), time_map.cosines(), time_map.nodes()


@dataclass(frozen=True, slots=True)
class Sweep:
    """Many motions of one structure at the same times; NaN where a set was not decided."""

    samples: FloatArray
    """Shape (sets, times, columns)."""
    periods: FloatArray
    """Shape (sets,)."""
    errors: FloatArray
    """Bound of the absolute error of each set's samples, shape (sets,); inf where not decided."""


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
        return _to_the_last_digit(body, potential, motion, frame)
    given = np.array([[frame.log_lambda, 0.0]])
    loops, panels, about = _run(program, constants[None, :], frame, frame.loop[None, :], given, tier)
    period = Period(float(about[1]), 0.0, float(about[2]))
    if not about[0]:
        return None
    found = _motion(potential, period, loops[0], panels, about)
    return _with_rounded_start(found) if isinstance(motion.start, StartAtPoint) else found


def solve_many(
    body: RigidBody,
    program: Program,
    constants: FloatArray,
    motion: PlanarMotion,
    times: FloatArray,
    *,
    lambdas: FloatArray | None = None,
    tier: Literal["draft", "standard"] = "standard",
    columns: Sequence[str] = COLUMNS,
) -> Sweep:
    """Solve ``constants`` (sets, k), rows as :func:`make_program` returns them, at the same ``times``.

    ``lambdas`` (sets,), positive, replaces the λ of ``motion``. Each set goes the way of
    :func:`solve_spectral` and has the same numbers.

    Raises
    ------
    EqualMomentsError
        A = C.
    """
    body.require_planar()
    frame = make_frame(body, motion)
    chosen = np.array([COLUMNS.index(name) for name in columns], dtype=np.int64)
    times = np.ascontiguousarray(times, dtype=np.float64)
    sets = len(constants)
    out, about = np.empty((sets, len(times), len(chosen))), np.full((sets, 6), np.nan)
    if frame is None:
        out[:] = np.nan
    else:
        given = np.zeros((sets, 2))
        given[:, 0] = frame.log_lambda
        if lambdas is not None:
            # λ² as a single problem has it, so that the logarithm is the same to the last bit.
            logarithms = [0.5 * math.log(value * value) for value in lambdas.tolist()]
            given[:, 0] = [primed_logarithm(value, frame.loop) for value in logarithms]
        loops = np.repeat(frame.loop[None, :], sets, axis=0)
        panels = np.empty((time_map.MAX_PANELS, time_map.COLUMNS))
        _solve(program, constants, frame, loops, given, tier, times, chosen, panels, out, about)
    bounds = Bounds(about[:, 2], about[:, 3], about[:, 5], about[:, 4])
    errors = bounds.error_at(float(np.abs(times).max(initial=0.0)), about[:, 1], about[:, 2])
    return Sweep(out, about[:, 1], np.where(np.isnan(errors), np.inf, errors))


def _to_the_last_digit(
    body: RigidBody, potential: Potential, motion: PlanarMotion, frame: Frame
) -> SpectralMotion | None:
    orbit = rational_orbit(body, potential, motion, frame.loop, frame.half, frame.wishes)
    if orbit is None:
        return None
    loop, start, sense, period = orbit
    given = np.array([[start, sense]])
    loops, panels, about = _run(EMPTY_PROGRAM, np.empty((1, 0)), frame, loop[None, :], given, "high")
    # The balls know the length of the map, hence the sum of its errors; what lies on the way to a
    # place in it is bounded by half of all there can be, and half of what is left over.
    off = abs(about[1] - period.hi)
    if not (about[0] and off <= about[2] + 8.0 * EPSILON * period.hi):
        return None
    about[2] = 0.5 * (about[2] + off) + EPSILON * period.hi
    if isinstance(motion.start, StartAtPoint):
        # Slow next to a separatrix, the motion takes long for the rounding of its start.
        about[2] += _time_of_one_ulp(panels, start)
    loops[0, curve.PERIOD_HI], loops[0, curve.PERIOD_LO] = period.hi, period.lo
    return _motion(potential, period, loops[0], panels, about)


def _with_rounded_start(found: SpectralMotion) -> SpectralMotion:
    """Count the rounding of the start as time: long next to the equator, where g1 and g3 hardly change."""
    p, _, r, _, g2, _ = np.abs(found.sample(np.zeros(1))[0]).tolist()
    # g1' = r g2 and g3' = −p g2, q being 0.
    slowest = g2 * min(p, r)
    late = START_ULPS * EPSILON / slowest if slowest > 0.0 else math.inf
    return replace(found, bounds=replace(found.bounds, time=found.bounds.time + late))


def _time_of_one_ulp(panels: FloatArray, u: float) -> float:
    """Return the time in which the phase goes from ``u`` to a neighbouring double, the longer of both."""
    before, at, after = (
        time_map.time_at(panels, len(panels), float(phase))[0]
        for phase in (np.nextafter(u, -math.inf), u, np.nextafter(u, math.inf))
    )
    return float(max(at - before, after - at))


def _motion(
    potential: Potential, period: Period, loop: FloatArray, panels: FloatArray, about: FloatArray
) -> SpectralMotion:
    bounds = Bounds(float(about[2]), float(about[3]), float(about[5]), float(about[4]))
    return SpectralMotion(period, loop, panels, bounds, potential)


def _run(
    program: Program, constants: FloatArray, frame: Frame, loops: FloatArray, given: FloatArray, tier: Tier
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Solve one set without sampling it; return its loop (in a row), its panels and what is said of it."""
    loops, about = loops.copy(), np.empty((1, 6))
    panels = np.empty((time_map.MAX_PANELS, time_map.COLUMNS))
    nothing = np.empty((1, 0, 6))
    _solve(program, constants, frame, loops, given, tier, np.empty(0), np.arange(6), panels, nothing, about)
    return loops, panels[: int(about[0, 0])].copy(), about[0]


def _solve(
    program: Program,
    constants: FloatArray,
    frame: Frame,
    loops: FloatArray,
    given: FloatArray,
    tier: Tier,
    times: FloatArray,
    columns: NDArray[np.int64],
    panels: FloatArray,
    out: FloatArray,
    about: FloatArray,
) -> None:
    solve_sets(
        program.code,
        program.result,
        constants,
        loops,
        given,
        frame.half,
        frame.window,
        frame.wishes,
        TOLERANCES[tier],
        PLACES,
        MATRIX,
        POINTS,
        times,
        np.zeros(len(times)),
        columns,
        panels,
        out,
        about,
    )
