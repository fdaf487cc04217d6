"""Units of time in which the angular velocity of a motion is about 1.

Solvers count errors of ω and of γ as one number, which says little where ω is 1e15 or 1e-10. With the moments
multiplied by 4^k and the same V, the motion is the same but for its time, which is multiplied by 2^k, and ω,
which is divided by it: V, λ, the energy and the attitude stay what they are. Powers of two round nothing.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.classical.placement import Start
from service.dynamics.motion import COLUMNS, Asymptote, Estimate, Motion
from service.dynamics.numerics import largest
from service.dynamics.problem import (
    ClassicalMotion,
    Partial,
    PlanarMotion,
    Problem,
    StateMotion,
    TimeList,
    TimePeriods,
    Times,
)
from service.dynamics.solution.dense_output import DenseOutput, Period
from workers.solvers.assembly.families import Place
from workers.solvers.certified.certify import HIGHEST_PRECISION, Certified
from workers.solvers.choose import speed_in_doubles, with_enough_bits
from workers.solvers.classical.solve import place_motion
from workers.solvers.orbits.orbit import six_variables
from workers.solvers.orientation.solve import Orientation
from workers.solvers.stability.assessment import Stability

FloatArray = NDArray[np.float64]

OMEGA = COLUMNS[:3]
MAX_UNIT_EXPONENT = 900
"""Largest |k|: beyond it not every number of a motion is a normal double in both units."""
MAX_MOMENT = Fraction(10) ** 304
"""Moments lie between its inverse and it."""
TOLERANCE_SHARE = 0.5
"""Share of a relative tolerance that is asked of a motion in these units: there the largest of ω is 1 to 2,
and of γ, whose square is 1, at least 0.577."""
SPEED_POINTS = 8
"""On an arc, where the speed is looked at."""


@dataclass(frozen=True, slots=True)
class Units:
    """The unit of time is 2^-k of the client's."""

    k: int = 0

    @classmethod
    def of(cls, speed: float, body: RigidBody) -> "Units":
        """Return those in which ``speed`` becomes 1 to 2; the client's own if it is 0 or not known.

        And where numbers of the motion, or moments of its ``body``, would be no normal doubles.
        """
        if not (math.isfinite(speed) and speed > 0.0):
            return cls()
        k = math.frexp(speed)[1] - 1
        moments = [moment * Fraction(4) ** k for moment in (body.A, body.C)]
        return (
            cls(k)
            if abs(k) <= MAX_UNIT_EXPONENT and all(1 / MAX_MOMENT <= m <= MAX_MOMENT for m in moments)
            else cls()
        )

    @property
    def quick(self) -> float:
        """The unit of ω."""
        return math.ldexp(1.0, self.k)

    @property
    def slow(self) -> float:
        """The unit of time."""
        return math.ldexp(1.0, -self.k)

    def pose(self, problem: Problem) -> Problem:
        """Return the problem in these units, with an absolute tolerance that keeps what is asked."""
        accuracy = problem.accuracy
        share = {"absolute": 1.0 / max(1.0, self.quick), "above 1": 1.0, "relative": TOLERANCE_SHARE}[
            accuracy.measure
        ]
        asked = replace(accuracy, tolerance=share * accuracy.tolerance, measure="absolute")
        if not self.k:
            return replace(problem, accuracy=asked)
        motion, unit = problem.motion, Fraction(2) ** -self.k
        if isinstance(motion, StateMotion):
            p, q, r = motion.omega
            motion = replace(motion, omega=(p * unit, q * unit, r * unit))
        elif isinstance(motion, ClassicalMotion):
            motion = replace(
                motion,
                p=_scaled(motion.p, unit),
                spin=_scaled(motion.spin, unit),
                omega=None if motion.omega is None else _scaled_vector(motion.omega, unit),
            )
        time = self.times(problem.time)
        return replace(problem, body=self.body(problem.body), motion=motion, time=time, accuracy=asked)

    def body(self, body: RigidBody) -> RigidBody:
        """Return the body in these units."""
        factor = Fraction(4) ** self.k
        B = None if body.B is None else body.B * factor
        return replace(body, A=body.A * factor, B=B, C=body.C * factor) if self.k else body

    def times(self, times: Times) -> Times:
        """Return the times in these units; numbers of periods stay."""
        factor = Fraction(2) ** self.k
        if isinstance(times, TimePeriods) or not self.k:
            return times
        if isinstance(times, TimeList):
            return TimeList(tuple(t * factor for t in times.times))
        return replace(times, start=times.start * factor, stop=times.stop * factor)

    def motion(self, motion: Motion) -> Motion:
        """Return a motion that was solved in these units in the client's."""
        if not self.k:
            return motion
        slow, quick = self.slow, self.quick
        check, first, place = motion.cross_check, motion.first_passage, motion.place_error
        if check is not None:
            difference = check.disagreement * max(1.0, quick)
            check = replace(check, disagreement=difference, horizon=check.horizon * slow)
        return replace(
            motion,
            dense=self.dense(motion.dense),
            times=motion.times * slow,
            low_parts=None if motion.low_parts is None else motion.low_parts * slow,
            samples=motion.samples * self.of_columns(COLUMNS),
            error=motion.error * max(1.0, quick),
            unit=quick,
            past=self._limit(motion.past),
            future=self._limit(motion.future),
            cross_check=check,
            first_passage=None if first is None else first * slow,
            place_error=None if place is None else replace(place, late=place.late * slow),
            evidence={**motion.evidence, "unit_of_time": slow},
        )

    def dense(self, dense: DenseOutput) -> DenseOutput:
        """Return a function of time in the client's units."""
        if not self.k:
            return dense
        errors = {name: dense.errors.get(name, dense.error) * self.quick for name in OMEGA}
        period = dense.period
        return replace(
            dense,
            breaks=dense.breaks * self.slow,
            coefficients=dense.coefficients * self.of_columns(dense.columns),
            period=None
            if period is None
            else Period(period.hi * self.slow, period.lo * self.slow, period.error * self.slow, period.kind),
            errors={**dense.errors, **{name: errors[name] for name in OMEGA if name in dense.columns}},
        )

    def orientation(self, found: Orientation) -> Orientation:
        """Return an attitude in the client's units."""
        return replace(found, dense=self.dense(found.dense))

    def stability(self, found: Stability) -> Stability:
        """Return what is told of the stability in the client's units."""
        quick, time = self.quick, found.trusted_time
        return replace(
            found,
            exponent=found.exponent * quick,
            exponent_error=found.exponent_error * quick,
            trusted_time=None if time is None else time * self.slow,
        )

    def certified(self, found: Certified) -> Certified:
        """Return enclosures in the client's units."""
        with ctx.workprec(2 * HIGHEST_PRECISION):
            quick = arb(2) ** self.k
            states = tuple((p * quick, q * quick, r * quick, *gamma) for p, q, r, *gamma in found.states)
            times = tuple(time / quick for time in found.times)
            period = None if found.period is None else found.period / quick
            return replace(found, period=period, states=states, times=times, areas=found.areas / quick)

    def enclosures(self, columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return the columns that hold enclosures in the client's units."""
        units = {**dict.fromkeys(OMEGA, self.quick), "t": self.slow}
        return {name: rows * units.get(name.partition(".")[0], 1.0) for name, rows in columns.items()}

    def of_columns(self, names: tuple[str, ...]) -> FloatArray:
        """Return the unit of each of these columns."""
        return np.array([self.quick if name in OMEGA else 1.0 for name in names])

    def _limit(self, limit: Asymptote | None) -> Asymptote | None:
        if limit is None:
            return None
        time, rate = limit.time, limit.rate
        return replace(
            limit,
            time=None if time is None else _times(time, self.slow),
            rate=None if rate is None else _times(rate, self.quick),
        )


def speed_of(problem: Problem) -> float:
    """Return about the largest |ω| of the motion, from which the units follow; no claim rests on it.

    Raises what those raise who find the window of a planar motion, and place a classical one.
    """
    motion = problem.motion
    if isinstance(motion, PlanarMotion):
        found = speed_in_doubles(problem)
        return with_enough_bits(problem, _on_arc) if found is None else found
    if isinstance(motion, StateMotion):
        return max(speed_of_state(motion), _speed_by_field(problem, motion.gamma))
    start = place_motion(problem).start
    return max(speed_of_state(start), _speed_by_field(problem, start.gamma))


def speed_of_state(state: StateMotion | Start) -> float:
    """Return the largest |p|, |q| or |r| at the start."""
    return max(abs(float(each)) for each in state.omega)


def _on_arc(_: Problem, place: Place) -> float:
    arc = place.start.arc
    speeds = [0.0]
    for n in range(SPEED_POINTS):
        at = arc.loop.point(arc.lower + (arc.upper - arc.lower) * arb(2 * n + 1) / (2 * SPEED_POINTS))
        p, _q, r, *_rest = six_variables(arc.loop, at, abs(at.P).sqrt())
        speeds += [float(abs(each).mid()) for each in (p, r) if each.is_finite()]
    return max(speeds)


def _speed_by_field(problem: Problem, gamma: tuple[Fraction, Fraction, Fraction]) -> float:
    """Return what the field may give to a body at rest; 0 if it has no value there."""
    body = problem.body
    least = float(min(moment for moment in (body.A, body.B, body.C) if moment is not None))
    slope = largest(map(abs, problem.potential.gradient(np.array([float(g) for g in gamma])).tolist()))
    found = math.sqrt(slope) / math.sqrt(least)
    return found if math.isfinite(found) else 0.0


def _times(number: Estimate, unit: float) -> Estimate:
    return replace(number, value=number.value * unit, error=number.error * unit)


def _scaled(number: Fraction | None, unit: Fraction) -> Fraction | None:
    return None if number is None else number * unit


def _scaled_vector(vector: Partial, unit: Fraction) -> Partial:
    p, q, r = vector
    return _scaled(p, unit), _scaled(q, unit), _scaled(r, unit)
