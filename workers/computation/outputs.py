"""Computes what a problem asks for beyond the six variables, in units and with errors that keep its accuracy.

What was computed is held against the accuracy that was asked for; where the client's units do not allow it,
it is computed in units of the motion.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import TypeVar

import numpy as np
from flint import arb, ctx

from service.dynamics.accuracy import SMALLEST_TOLERANCE, GroupError, keeps
from service.dynamics.classical.classification import relations_of
from service.dynamics.defect.equations import Equations
from service.dynamics.equations.euler_poisson import areas_integral
from service.dynamics.equations.orientation import (
    PRECESSION,
    QUATERNION,
    has_orientation,
    orientation_columns,
    orientation_errors,
)
from service.dynamics.errors import DynamicsError
from service.dynamics.further_integrals import FurtherIntegral, find_further_integrals
from service.dynamics.motion import Estimate, Motion
from service.dynamics.numerics import NO_CROSS_CHECK, is_within, largest
from service.dynamics.potentials.potential import Notice
from service.dynamics.potentials.recognition import recognise
from service.dynamics.problem import Accuracy, ClassicalMotion, PlanarMotion, Problem, StateMotion
from service.dynamics.solution.dense_output import DenseOutput
from service.storage.codecs.summary import PROVEN_SAMPLES
from workers.solvers.assembly.families import Place
from workers.solvers.certified.certify import Certified
from workers.solvers.choose import QUICK_SPEED, compiled_tier, find_motion, proven_start, with_enough_bits
from workers.solvers.classical.solve import place_motion
from workers.solvers.errors import AccuracyNotMetError, StepCollapseError
from workers.solvers.evidence import Drifts, further_drift, measure_drifts
from workers.solvers.orbits.orbit import make_orbit
from workers.solvers.orientation.solve import Orientation, with_orientation
from workers.solvers.quadrature.squared_speed import time_map_of
from workers.solvers.stability.assessment import Stability, assess_stability
from workers.solvers.stability.monodromy import StabilityUndefinedError, transverse_stability
from workers.solvers.stability.proven import classical_stability, planar_stability
from workers.solvers.units import Units, speed_of, speed_of_state
from workers.solvers.ways import is_plain

LAME_BITS = 128
TIERS_IN_DOUBLES = ("draft", "standard")
"""Compiled tiers whose promise doubles keep for the outputs too."""
ATTITUDE_ERROR_SHARE = 0.5
"""Share of the error that a motion may have for its attitude, which is asked of a second one."""
ZERO_AREAS_SHARE = 1e-12
"""|I3| below this share of the angular momentum counts as zero: that is its rounding."""


@dataclass(frozen=True, slots=True)
class FurtherDrift:
    """A further integral along a motion: its value at the first sample and its largest departure."""

    integral: FurtherIntegral
    value: float
    drift: float


@dataclass(frozen=True, slots=True)
class Outputs:
    """Each is None, or empty, unless it was asked for."""

    drifts: Drifts | None
    further: tuple[FurtherDrift, ...]
    orientation: Orientation | None
    stability: Stability | None
    closed_trace: Estimate | None
    """The trace of the multipliers from Lamé's equation, where that is the one."""
    notices: tuple[Notice, ...]
    relations: Mapping[str, float]
    """Largest departure from each relation of a classical case, by its name."""
    precession: tuple[arb, arb] | None
    """Enclosures of what ψ1 and ψ3 gain in a period, in the tier certified."""


@dataclass(frozen=True, slots=True)
class InUnits:
    """A problem and its motion in the units in which it was solved."""

    units: Units
    problem: Problem
    motion: Motion
    proven: Certified | None
    """The enclosures of the tier certified."""


@np.errstate(over="ignore", invalid="ignore")
def compute_outputs(problem: Problem, motion: Motion, solved: InUnits) -> Outputs:
    """Return what the problem's outputs ask for; raises what the solvers of its parts raise.

    Integrals of numbers that are large enough are beyond doubles, and not told.
    ``solved`` is the same problem and motion in the units of the solver, in which further functions of time
    are computed, too.
    """
    notices = list(problem.potential.notices)
    drifts, further, orientation = None, tuple[FurtherDrift, ...](), None
    stability, closed_trace, relations = None, None, dict[str, float]()
    precession = None
    if motion.enclosed_by is not None:
        between = motion.dense.error_at(motion.times)
        text = f"the samples are rounded from proven enclosures; between them errors are up to {between:.1e}"
        notices.append(Notice(PROVEN_SAMPLES, text, "/accuracy"))
    if motion.cross_check is not None and motion.cross_check.why_none is not None:
        notices.append(Notice(NO_CROSS_CHECK, motion.cross_check.why_none, "/method"))
    if "invariants" in problem.outputs:
        drifts = measure_drifts(problem.body, problem.potential, motion)
        further = _further(problem, motion)
        if isinstance(problem.motion, ClassicalMotion):
            relations = relations_of(place_motion(problem)).drifts(motion.samples)
    if "orientation" in problem.outputs:
        orientation = solved.units.orientation(_orientation(solved.problem, solved.motion))
        notices += [Notice("azimuth_undefined", text, "/outputs") for text in orientation.notices]
        precession = None if solved.proven is None else solved.proven.precession
    if "stability" in problem.outputs:
        try:
            assessed = _stability(solved.problem, solved.motion, solved.proven)
            stability = _finite(solved.units.stability(assessed))
            if isinstance(problem.motion, PlanarMotion):
                closed_trace = _trace_of_lame(problem, problem.motion)
        except StabilityUndefinedError as undefined:
            notices.append(Notice(undefined.code, undefined.message, "/outputs"))
    return Outputs(
        drifts,
        further,
        orientation,
        stability,
        closed_trace,
        tuple(notices),
        relations,
        precession,
    )


def takes_doubles(problem: Problem) -> bool:
    """Tell whether the outputs of a problem are tried in compiled doubles first, as its motion is."""
    return compiled_tier(problem) in TIERS_IN_DOUBLES and not is_plain()


def _orientation(problem: Problem, motion: Motion) -> Orientation:
    """Return the attitude, from a finer motion where that of this one does not keep the tolerance.

    The six variables stay those of ``motion``. Beside enclosures nothing is promised.

    Raises
    ------
    AccuracyNotMetError
        That of a finer motion does not keep it either.
    """
    if has_orientation(motion.dense):
        return _proven_orientation(motion.dense)
    orientation = _attitude(problem, motion)
    missed = _missed(problem, motion, orientation.dense)
    if missed is None:
        return orientation
    # What the attitude makes of the errors of the variables is known by now.
    group = missed[1]
    share = ATTITUDE_ERROR_SHARE * motion.dense.error * problem.tolerance
    finer = share * max(1.0, group.size) / group.absolute
    finer = min(max(finer, float(SMALLEST_TOLERANCE)), problem.tolerance)
    with suppress(DynamicsError):
        other = find_motion(replace(problem, accuracy=replace(problem.accuracy, tolerance=finer)))
        orientation = _attitude(problem, other)
        missed = _missed(problem, motion, orientation.dense)
    if missed is not None:
        raise AccuracyNotMetError(missed[1].absolute, problem.tolerance, group=missed)
    return orientation


def _proven_orientation(dense: DenseOutput) -> Orientation:
    missing = [name for name in PRECESSION if name not in dense.columns]
    notices = tuple(
        f"{name} is left out: the axis {name[-1]} of the body becomes vertical" for name in missing
    )
    return Orientation(dense, None, notices, "theorem")


def _missed(problem: Problem, motion: Motion, attitude: DenseOutput) -> tuple[str, GroupError] | None:
    """Return the group of an attitude that misses the tolerance, which is relative for angles above 1."""
    if problem.accuracy.tier == "certified":
        return None
    above_1 = replace(problem.accuracy, measure="above 1")
    groups = errors_of_attitude(motion, attitude)
    return next(((name, group) for name, group in groups.items() if not keeps(above_1, [group])), None)


def _attitude(problem: Problem, motion: Motion) -> Orientation:
    """Return the attitude, with the precession in compiled doubles where the tier is content with them."""
    if isinstance(problem.motion, PlanarMotion) and takes_doubles(problem):
        # The compiler is loaded only where it is needed.
        from workers.solvers.orientation.by_doubles import advances_on  # noqa: PLC0415

        return with_orientation(motion, advances_on(problem.body, problem.motion))
    is_integrated = motion.function_kind == "difference"
    return with_orientation(
        motion, equations=Equations.of(problem.body, problem.potential) if is_integrated else None
    )


def _stability(problem: Problem, motion: Motion, proven: Certified | None) -> Stability:
    """Return the stability: proven of classical motions and in the tier certified, else estimated."""
    if isinstance(problem.motion, ClassicalMotion):
        return classical_stability(problem, proven_start(problem))
    found = _planar_stability(problem, problem.motion_as(PlanarMotion), motion)
    return found if proven is None else planar_stability(problem, proven_start(problem), proven, found)


def _planar_stability(problem: Problem, planar: PlanarMotion, motion: Motion) -> Stability:
    """Return the stability in compiled doubles, in balls where those do not decide it."""
    is_usual = motion.dense.period is not None and not motion.conventions
    if takes_doubles(problem) and is_usual and motion.window is not None:
        # The compiler is loaded only where it is needed.
        from workers.solvers.stability.by_doubles import stability_by_doubles  # noqa: PLC0415

        stability = stability_by_doubles(
            problem.body, problem.potential, planar, motion.window, problem.tolerance
        )
        if stability is not None:
            return stability
    return with_enough_bits(problem, _assess)


def _finite(stability: Stability) -> Stability:
    """Return the stability if doubles have it; raises StabilityUndefinedError."""
    numbers = (
        stability.trace,
        stability.error,
        stability.multipliers_error,
        stability.exponent,
        stability.exponent_error,
    )
    if not all(map(isfinite, numbers)):
        raise StabilityUndefinedError(
            "the multipliers, or their errors, are beyond all doubles", pointer="/outputs"
        )
    return stability


def _assess(problem: Problem, placed: Place) -> Stability:
    if placed.window.kind != "periodic":
        raise StabilityUndefinedError(
            f"multipliers belong to periodic motions, and this one is not periodic ({placed.window.kind})",
            pointer="/outputs",
        )
    orbit = make_orbit(placed.start)
    period = time_map_of(orbit).period
    return assess_stability(problem.body, problem.potential, placed.start, period, problem.tolerance)


def _trace_of_lame(problem: Problem, motion: PlanarMotion) -> Estimate | None:
    """Return μ + 1/μ in theta functions, if V = a g1 + constant and A = 2C."""
    body = problem.body
    terms = recognise(body, problem.potential, motion.sign_of_g1) if body.A == 2 * body.C else None
    if terms is None or terms.b1 or terms.c1 or body.B is None:
        return None
    with ctx.workprec(LAME_BITS):
        trace = transverse_stability(motion.lambda_squared, body.B / body.C).trace
        found = Estimate.of(trace)
        return found if isfinite(found.error) else None


def _further(problem: Problem, motion: Motion) -> tuple[FurtherDrift, ...]:
    planar = isinstance(problem.motion, PlanarMotion)
    sign = problem.motion.sign_of_g1 if isinstance(problem.motion, PlanarMotion) else None
    integrals = find_further_integrals(problem.body, problem.potential, g1_sign=sign)
    kept = (k for k in integrals if k.kind == "general" or planar or _has_zero_areas(problem, motion))
    return tuple(FurtherDrift(k, *further_drift(k, motion.samples)) for k in kept)


def _has_zero_areas(problem: Problem, motion: Motion) -> bool:
    omega, gamma = motion.samples[:1, :3], motion.samples[:1, 3:]
    moments = [float(moment) for moment in (problem.body.A, problem.body.B or 0, problem.body.C)]
    momentum = float(np.linalg.norm(np.array(moments) * omega))
    return abs(float(areas_integral(problem.body, omega, gamma)[0])) <= ZERO_AREAS_SHARE * momentum


T = TypeVar("T")


def in_units(problem: Problem, solve: Callable[[Units], T]) -> T:
    """Return ``solve`` of the units in which the motion keeps what is asked, which may be the client's own.

    Raises
    ------
    AccuracyNotMetError
        It is not kept in either.
    """
    accuracy = problem.accuracy
    if accuracy.measure == "relative" or _is_quick(problem):
        return _in_own(problem, speed_of(problem), solve)
    try:
        return solve(Units())
    except (AccuracyNotMetError, StepCollapseError) as missed:
        # Errors of classes of their own tell times, in the units they were met in.
        if type(missed) not in (AccuracyNotMetError, StepCollapseError):
            raise
        speed = speed_of(problem)
        reached = missed.reached if isinstance(missed, AccuracyNotMetError) else inf
        # Less of the error than this may be that of γ, but then more of it is that of ω.
        may_do = (
            is_within(reached, 2.0 * speed * accuracy.tolerance) if reached < inf else speed >= QUICK_SPEED
        )
        is_relative = accuracy.measure == "above 1" or isinstance(missed, StepCollapseError)
        if is_relative and speed >= 2.0 and may_do:
            return _in_own(problem, speed, solve)
        is_plain = isinstance(missed, AccuracyNotMetError) and missed.group is None
        if is_plain and 1.0 < speed < inf:
            raise _of_both(reached, accuracy.tolerance, speed) from None
        raise


def _is_quick(problem: Problem) -> bool:
    """Tell whether a motion is so quick that it is solved in its own units from the beginning.

    Of planar motions in doubles, and of classical ones, this is seen when they miss what is asked.
    """
    if isinstance(problem.motion, StateMotion):
        return speed_of_state(problem.motion) >= QUICK_SPEED
    is_proven = problem.accuracy.tier == "certified" and isinstance(problem.motion, PlanarMotion)
    return is_proven and speed_of(problem) >= QUICK_SPEED


def _in_own(problem: Problem, speed: float, solve: Callable[[Units], T]) -> T:
    units, accuracy = Units.of(speed, problem.body), problem.accuracy
    try:
        return solve(units)
    except DynamicsError as fault:
        if isinstance(fault, AccuracyNotMetError) and fault.group is not None:
            raise
        if type(fault) is AccuracyNotMetError and speed > 0.0:
            reached = fault.reached * max(1.0, units.quick)
            is_relative = accuracy.measure != "absolute"
            raise _of_both(reached, accuracy.tolerance, speed, is_relative=is_relative) from None
        if not units.k:
            raise
    # What is told of times, and how the motion ends, is told in the client's units.
    return solve(Units())


def _of_both(
    reached: float, tolerance: float, speed: float, *, is_relative: bool = False
) -> AccuracyNotMetError:
    """Return the error that tells an absolute error and one relative to the speed."""
    group = ("omega", GroupError(reached, speed))
    return AccuracyNotMetError(reached, tolerance, group=group, is_relative=is_relative)


def errors_of(motion: Motion, attitude: DenseOutput | None) -> dict[str, GroupError]:
    """Return the errors by groups over the asked times, beside their sizes; none without samples."""
    if not len(motion.times):
        return {}
    return {**motion.group_errors, **({} if attitude is None else errors_of_attitude(motion, attitude))}


def errors_of_attitude(motion: Motion, attitude: DenseOutput) -> dict[str, GroupError]:
    """Return the errors of the quaternion and of each angle over the asked times, beside their sizes."""
    columns = orientation_columns(attitude, motion.times, motion.low_parts)
    errors = orientation_errors(attitude, motion.times)
    groups = {"quaternion": QUATERNION, **{name: (name,) for name in PRECESSION if name in columns}}
    return {
        group: GroupError(
            largest(errors[name] for name in names),
            largest(float(np.abs(columns[name]).max(initial=0.0)) for name in names),
        )
        for group, names in groups.items()
    }


def require_promise(accuracy: Accuracy, groups: Mapping[str, GroupError]) -> None:
    """Refuse errors that are more than was asked for.

    Tiers and absolute tolerances of the attitude are kept where it is computed; and the tier ``certified``
    promises its proven radii, not what doubles make of them.

    Raises
    ------
    AccuracyNotMetError
        They are.
    """
    is_relative = accuracy.measure == "relative"
    for name, group in groups.items():
        is_asked = is_relative or (name in ("omega", "gamma") and accuracy.tier != "certified")
        if is_asked and not keeps(accuracy, [group]):
            raise AccuracyNotMetError(
                group.absolute, accuracy.tolerance, group=(name, group), is_relative=is_relative
            )
