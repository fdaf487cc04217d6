"""Periodic planar motions, by the way that suits the tier.

``draft`` and ``high``, and tolerances looser than what ``standard`` promises, are
solved in compiled doubles where those have the motion; next, and for
``standard``, come closed forms, and last the quadrature of the orbit in balls,
which has them all.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from service.dynamics.accuracy import TIER_TOLERANCES
from service.dynamics.bounds import is_within
from service.dynamics.dense_output import DenseOutput, Period
from service.dynamics.motion import COLUMNS, Motion
from service.dynamics.problem import Accuracy, PlanarMotion, Problem
from service.dynamics.reduction.start import StartingPoint
from service.dynamics.reduction.window import Window
from service.dynamics.sampling import SampleTimes, sample_times
from workers.solvers.closed_form.solve import solve_closed_form
from workers.solvers.quadrature.dense import Sampler, nothing_resolved, phase_sampler, resolve_motion
from workers.solvers.quadrature.description import FIRST_PASSAGE, conventions_of, energy_of, evidence_of
from workers.solvers.quadrature.orbit import Orbit, make_orbit
from workers.solvers.quadrature.time_map import make_time_map

if TYPE_CHECKING:
    from workers.solvers.spectral.motion import SpectralMotion

FloatArray = NDArray[np.float64]

WELL_CONDITIONED = 1e-12
"""Largest error of a closed form in doubles that is preferred to the quadrature in balls."""


SAME = 1e-6
"""Departure of g1 at its ends within which two solvers speak of one window."""


@dataclass(frozen=True, slots=True)
class _Sampled:
    """A motion that can be sampled over one period."""

    sample: Sampler
    period: Period
    passages: FloatArray
    """Times in [0, period) at which a pole is passed, growing."""
    error: float
    """Of a sample within one period, beside the departure of the dense output from it."""
    evidence: Mapping[str, float | int | str]
    late: "SpectralMotion | None" = None
    """Samples itself at any time, with less error than by way of the dense output."""


def solve_periodic(problem: Problem, window: Window, start: StartingPoint) -> Motion:
    """Return the motion from ``start`` in a periodic window; ``quadrature`` leaves closed forms aside."""
    orbit = make_orbit(start)
    conventions = conventions_of(start)
    motion = None
    if problem.method != "quadrature":
        # Times at which poles are passed, needed where that is not smooth, the compiled solver does not tell.
        motion = None if conventions else _in_doubles(problem, window)
        motion = motion or _in_closed_form(problem, window, start)
    motion = motion or _by_quadrature(orbit)
    period = motion.period
    nothing = SampleTimes(np.zeros(0), np.zeros(0))
    asked = sample_times(problem.time, period) if problem.wants_series else nothing
    times, rests = asked.doubles, asked.rests
    # Finer than the samples themselves are known, pieces would follow their errors.
    atol = max(min(1e-14, 1e-3 * problem.tolerance), 0.25 * motion.error)
    resolved = (
        resolve_motion(motion.sample, (0.0, period.hi), motion.passages, scale=period.hi, atol=atol)
        if problem.wants_series
        else nothing_resolved(period.hi)
    )
    columns = COLUMNS[: resolved.coefficients.shape[2]]
    error = resolved.error + motion.error
    dense = DenseOutput(columns, resolved.breaks, resolved.coefficients, period, error)
    samples, reached = np.zeros((0, len(COLUMNS))), 0.0
    if len(times):
        late = motion.late
        samples = dense(times, rests) if late is None else late.sample(times, rests)
        reached = dense.error_at(times) if late is None else late.error_at(times)
    conventions = conventions_of(start)
    return Motion(
        method="quadrature",
        dense=dense,
        times=times,
        samples=samples,
        error=reached,
        energy=energy_of(start.arc.loop, orbit.somewhere()),
        window=window,
        aperiodic=None,
        past=None,
        future=None,
        cross_check=None,
        conventions=conventions,
        evidence={
            **motion.evidence,
            **evidence_of(resolved),
            **({FIRST_PASSAGE: float(motion.passages[0])} if conventions else {}),
        },
        rests=rests,
    )


def compiled_grade(accuracy: Accuracy) -> Literal["draft", "standard", "high"] | None:
    """Return how finely the compiled solver resolves a motion of this accuracy, None if it is not for it.

    Whoever states a tolerance looser than the promise of ``standard`` gets the cheapest that keeps it.
    """
    if accuracy.tier == "standard":
        return "standard" if accuracy.tolerance > TIER_TOLERANCES["standard"] else None
    return None if accuracy.tier == "certified" else accuracy.tier


def _in_doubles(problem: Problem, window: Window) -> _Sampled | None:
    """Return the motion of the compiled solver, if it is for such and this is the one in the window."""
    grade = compiled_grade(problem.accuracy)
    if grade is None or not isinstance(problem.motion, PlanarMotion):
        return None
    # The compiler is loaded, and the first time run, only by those who need it.
    from workers.solvers.spectral.solve import solve_spectral  # noqa: PLC0415

    found = solve_spectral(problem.body, problem.potential, problem.motion, tier=grade)
    if found is None or found.ends != window.ends or not np.allclose(found.g1, window.g1, rtol=0, atol=SAME):
        return None
    period = found.period
    error = found.error_at(np.array([period.hi]))
    times = sample_times(problem.time, period).doubles if problem.wants_series else np.array([period.hi])
    if not is_within(found.error_at(times), problem.tolerance):
        return None
    evidence: dict[str, float | int | str] = {"compiled": len(found.panels), "rounding": error}
    return _Sampled(found.sample, period, np.zeros(0), error, evidence, found)


def _in_closed_form(problem: Problem, window: Window, start: StartingPoint) -> _Sampled | None:
    closed = solve_closed_form(problem.body, problem.potential, start, window)
    if closed is None or not is_within(closed.error(), WELL_CONDITIONED):
        return None
    error = closed.error()
    evidence: dict[str, float | int | str] = {"closed_form": "elliptic functions", "rounding": error}
    return _Sampled(closed.sample, closed.period, closed.passages, error, evidence)


def _by_quadrature(orbit: Orbit) -> _Sampled:
    time_map = make_time_map(orbit.rate, orbit.corners, is_even=orbit.is_even)
    period = time_map.period
    origin = float(time_map.time_at(np.array([orbit.start]))[0])
    on_map = phase_sampler(orbit, time_map)

    def sample(times: FloatArray) -> FloatArray:
        local = times + origin
        local = np.where(local > period.hi, local - period.hi, local)
        return on_map(np.clip(local, 0.0, period.hi))

    passages = np.sort((time_map.time_at(np.array(orbit.corners)) - origin) % period.hi)
    return _Sampled(sample, period, passages, 0.0, time_map.evidence())
