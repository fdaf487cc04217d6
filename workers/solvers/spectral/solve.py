"""Periodic planar motions in compiled doubles, one or many."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.dense_output import EPSILON, Period
from service.dynamics.motion import COLUMNS
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.problem import PlanarMotion
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
    return _motion(potential, period, loops[0], panels, about) if about[0] else None


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
            given[:, 0] = [primed_logarithm(value, frame.loop) for value in np.log(lambdas)]
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
    # The balls know the length of the map: its error is seen, not only bounded.
    off = abs(about[1] - period.hi)
    if not (about[0] and off <= about[2] + 8.0 * EPSILON * period.hi):
        return None
    about[2] = min(about[2], 2.0 * off + EPSILON * period.hi)
    loops[0, curve.PERIOD_HI], loops[0, curve.PERIOD_LO] = period.hi, period.lo
    return _motion(potential, period, loops[0], panels, about)


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
        columns,
        panels,
        out,
        about,
    )
