"""Solves motions in compiled doubles: many in one call, arrays in and arrays out, or a single one."""

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.tape import Tape
from service.dynamics.formula.tree import VARIABLES
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.problem import PlanarMotion, StartAtPoint
from service.dynamics.sampling import SampleTimes
from service.dynamics.solution.dense_output import EPSILON, Period
from workers.solvers.compiled.evaluation.program import Program, make_program, rests_of
from workers.solvers.compiled.frame import Frame, make_frame, with_rests
from workers.solvers.compiled.motion import Bounds, FloatLike, SpectralMotion
from workers.solvers.compiled.rational import Radicand, rational_orbit, rational_radicand
from workers.solvers.compiled.records import (
    FOUND,
    MAX_PANELS,
    PANEL,
    Instructions,
    Records,
    copied,
    new_records,
)
from workers.solvers.compiled.solve_set import solve_sets
from workers.solvers.compiled.time_map.panels import time_at
from workers.solvers.compiled.workspace import own_workspace

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Tier = Literal["draft", "standard", "high"]
TOLERANCES: dict[Tier, float] = {"draft": 2e-9, "standard": 1e-13, "high": 2e-15}
"""Tail of dt/du on a panel against the whole, below which it is resolved."""
_NO_RESTS = np.empty((0, 0))
NO_TIMES = SampleTimes(np.zeros(0), np.zeros(0))
LASTING_PERIOD_ERROR = 1e-24
"""Relative error of a period that is good for 1e8 periods."""
KEPT_ERROR = 8e-14
"""Error of a variable within a period that leaves room to what comes with time: ``high`` promises 1e-13."""
START_ULPS = 8.0
"""Roundings on the way from g1 at the start to the phase there, in 2^-52."""
_NO_CODE = np.empty((0, 4), dtype=np.int64)
_NO_INSTRUCTIONS = Instructions(_NO_CODE, np.zeros(1, dtype=np.int64))
EMPTY_PROGRAM = Program(_NO_CODE, 0, _NO_INSTRUCTIONS, _NO_INSTRUCTIONS, Tape(VARIABLES, (), 0))
NO_CONSTANTS = np.empty((1, 0))


@dataclass(frozen=True, slots=True)
class Batch:
    """Motions in potentials of one program, which differ in its constants and in λ."""

    program: Program
    constants: FloatArray
    """Shape (sets, constants)."""
    loops: Records
    """Shape (sets,): what :meth:`.frame.Frame.loops` returns, or loops known by their roots."""
    tier: Tier
    times: SampleTimes = NO_TIMES
    """Times at which all of them are sampled."""
    columns: IntArray = field(default_factory=lambda: np.arange(6))
    """Numbers of the variables that are sampled."""
    rests: FloatArray | None = None
    """Low parts of the constants, of the same shape; then the loops have theirs as well, and motions are
    solved with twice the digits where doubles would lose some (:mod:`.doubled`)."""


@dataclass(frozen=True, slots=True)
class BatchResult:
    """The results, in the order of the batch; NaN where a motion was not decided."""

    loops: Records
    """With their orbits."""
    found: Records
    """A :class:`.records.Found` of each."""
    samples: FloatArray
    """Shape (sets, times, columns)."""
    panels: Records
    """The time map of the last motion."""


def solve_batch(batch: Batch) -> BatchResult:
    """Solve every motion of a batch by compiled code: each has the very numbers that it has alone."""
    sets, times = len(batch.loops), batch.times
    loops, panels = copied(batch.loops), new_records(PANEL, MAX_PANELS)
    found = new_records(FOUND, sets)
    samples = np.empty((sets, len(times.doubles), len(batch.columns)))
    solve_sets(
        batch.program.code,
        batch.program.result,
        batch.program.turn,
        batch.constants,
        _NO_RESTS if batch.rests is None else batch.rests,
        TOLERANCES[batch.tier],
        times.doubles,
        times.low_parts,
        batch.columns,
        loops,
        panels,
        found,
        own_workspace(),
        samples,
    )
    return BatchResult(loops, found, samples, panels[: int(found[-1]["panels"])] if sets else panels[:0])


def bounds_of(found: Records) -> Bounds:
    """Return what the errors of samples are made of."""
    return Bounds(found["time_error"], found["speed"], found["rate_error"], found["largest"], found["moved"])


def solve_spectral(
    body: RigidBody, potential: Potential, motion: PlanarMotion, *, tier: Tier
) -> SpectralMotion | None:
    """Return the motion, None if it is not decided here that there is one, which, and that it is periodic.

    The way through a pole is solved for an even A/C (or C/A) only. The tiers differ by what
    :meth:`SpectralMotion.error_at` says then. ``high`` is kept with twice the digits where V is a sum of
    low powers and the motion a libration, else from exact roots where A = 2C (or C = 2A) and V is rational
    and even in g2.
    """
    frame = make_frame(body, motion)
    if frame is None:
        return None
    try:
        program, constants = make_program(potential.tape)
    except NoClosedFormError:
        return None
    if tier == "high":
        found = _solve_doubled(body, potential, motion, frame, program, constants)
        if found is not None and is_kept(found.bounds, found.period.hi, found.period.error):
            return found
        radicand = rational_radicand(body, potential, motion)
        exact = None if radicand is None else solve_rational(radicand, motion, frame)
        return found if exact is None else _motion(potential, *exact)
    found = _only_one(potential, solve_batch(Batch(program, constants[None, :], frame.shared, tier)))
    is_late = found is not None and isinstance(motion.start, StartAtPoint)
    return _later(found) if found is not None and is_late else found


def _solve_doubled(
    body: RigidBody,
    potential: Potential,
    motion: PlanarMotion,
    frame: Frame,
    program: Program,
    constants: FloatArray,
) -> SpectralMotion | None:
    """Return the motion by the kernel that has twice the digits where it needs them, if it is for it."""
    rests = rests_of(potential.tape, constants)
    square = motion.lambda_squared
    loops = with_rests(frame, body, [fmpq(square.numerator, square.denominator)])
    run = solve_batch(Batch(program, constants[None, :], loops, "high", rests=rests[None, :]))
    found = _only_one(potential, run)
    if found is None or not isinstance(motion.start, StartAtPoint):
        return found
    return _later(found)


def is_kept(bounds: Bounds, period: FloatLike, period_error: FloatLike) -> NDArray[np.bool_]:
    """Say whether a motion has the digits of ``high`` within a period; one or many of them.

    One that has not may have them from exact roots.
    """
    is_lasting = np.asarray(period_error) <= LASTING_PERIOD_ERROR * np.asarray(period)
    within = bounds.time * bounds.speed + bounds.moved + bounds.rate * bounds.largest
    return np.asarray(within <= KEPT_ERROR) & is_lasting


def _only_one(potential: Potential, run: BatchResult) -> SpectralMotion | None:
    # All of its numbers at once: numpy takes several times longer for single ones.
    panels, period, period_error, *_ = run.found[0].item()
    if not panels:
        return None
    return _motion(potential, Period(period, float(run.loops[0]["period_lo"]), period_error), run)


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
    if not (about.panels and off <= about.time_error + 8.0 * EPSILON * period.hi):
        return None
    about.time_error = 0.5 * (about.time_error + off) + EPSILON * period.hi
    if isinstance(motion.start, StartAtPoint):
        # Slow next to a separatrix, the motion takes long for the rounding of its start.
        about.time_error += _time_of_one_ulp(run.panels, float(loop.start))
    loop.period_hi, loop.period_lo = period.hi, period.lo
    about.period, about.period_error = period.hi, period.error
    return period, run


def _later(found: SpectralMotion) -> SpectralMotion:
    """Count the rounding of the start as time: next to the equator it is worth a long one."""
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
    _, _, _, error, speed, largest, rate, moved = run.found[0].item()
    bounds = Bounds(error, speed, rate, largest, moved)
    return SpectralMotion(period, run.loops, copied(run.panels), bounds, potential)
