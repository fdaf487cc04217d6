"""The protocol of solver families: input, duties, answers, and how one of them tells a periodic motion.

A family computes a planar motion as a function of time. To add one, write ``family.py`` in its folder, name
it in :mod:`workers.solvers.choose`, and fulfil these duties:

1. ``takes`` says whether the family may have a motion, at the cost of a glance: no compiler is loaded,
   nothing is solved. A family that takes a motion may still decline it.
2. ``promise`` says how large the error of a sample may be that the family hands over. What it finds worse, it
   declines. A family that promises nothing (inf) is the last of its row, or knows that no other does better.
3. ``solve`` returns the very motion that is asked for: the one in this window, from this start. Where the
   family finds another window, or cannot tell, it declines. It never guesses.
4. What it claims, it knows: the error of the motion bounds that of all six variables at the asked times, and
   the error of its dense output bounds them at all times. What the motion itself shows (its energy, its
   equations) is compared with the claim by :func:`workers.solvers.assembly.families.make_periodic`, which
   declines what cannot be believed.
5. It works at the precision of balls at which it is called, and leaves it as it was. Where that is too low,
   it raises :class:`~workers.solvers.errors.PrecisionLostError`, and is called again with twice the bits.
6. A motion that no family can compute is refused by an error that says why. That the *next* family may have
   it is said by :class:`Declined`.
7. It is a leaf: it imports no other family, reads no clock, file or setting, and its numbers depend on
   nothing but what it is given.
8. Digits that change raise ``NUMERICS``.

A family that samples one period of a motion has it assembled here, with claims that the motion bears out.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf, nextafter
from typing import Protocol

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.accuracy import LARGEST_TOLERANCE
from service.dynamics.motion import COLUMNS, Estimate, Motion, PlaceError
from service.dynamics.numerics import ErrorKind, is_within, largest
from service.dynamics.problem import Problem
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.window import StartingPoint, Window
from service.dynamics.sampling import SampleTimes, sample_times
from service.dynamics.solution.dense_output import EPSILON, DenseOutput, Period
from workers.solvers.assembly.dense import (
    FIRST_PIECES,
    MAX_RELATIVE_FINENESS,
    Features,
    ResolvedMotion,
    Sampler,
    nothing_resolved,
    resolve_motion,
)
from workers.solvers.evidence import evidence_items, residual_evidence, with_error_raised, with_samples_raised
from workers.solvers.orbits.near_rest import SlowOrbit, is_slow, slow_orbit
from workers.solvers.orbits.orbit import RATE_NUDGE, Libration, Orbit, Rotation, make_orbit, somewhere_on

FloatArray = NDArray[np.float64]
PeriodicOrbit = Libration | Rotation | SlowOrbit
MAX_FINENESS_AT_JUMPS = 1e5
"""Pieces to the period where p jumps for doubles."""
DRAFT_DEPARTURE_SHARE = 0.01
"""Share of a draft's tolerance that its function of time may depart between the samples."""
TRUNCATION_TAILS = 4.0
"""Tails to which what the series of a draft leave out may add up: twice the sum of all coefficients
that follow, which fall by a third or more. Departures are seen at few places, and a draft can afford it."""
DRAFT_DEFECT_FACTOR = 2.0
"""Times its integrated defect the function of time of a draft claims at least: an error is that with its
growth, and what is narrow for long pieces and too faint for their tails is seen by nothing else."""
TAIL_COEFFICIENTS = 4
"""Last coefficients of a series, the largest of which is its tail: two may be small by chance."""
THEOREM_TIME_SHARE = 1.0 - 1e-9
"""Share of the time for which the bound of the defect is a theorem where it is one for all that counts."""
DRAFT_FIRST_PIECES = 4
"""Number of pieces with which the function of time of a draft begins."""
SYMMETRIC_POLE_PASSAGE = "symmetric_pole_passage"
"""At a pole where the equations allow several continuations g1 keeps its sign and g3 flips (A > C)."""
REST_PHASE_DISTANCE = arb(2) ** -56
"""Distance in phase from a rest point at which p and r are looked at."""


@dataclass(frozen=True, slots=True)
class Place:
    """The window of a planar motion and where in it the motion starts, in balls of the current precision."""

    window: Window
    start: StartingPoint


@dataclass(frozen=True, slots=True)
class PeriodicPlace(Place):
    """A place in a periodic window."""

    _orbits: list[PeriodicOrbit] = field(default_factory=list, init=False, compare=False, repr=False)

    @property
    def orbit(self) -> PeriodicOrbit:
        """Return the motion as a function of its phase, which keeps its digits next to a rest.

        It is made where it is asked for: compiled solvers do without.

        Raises
        ------
        PrecisionLostError
            More bits are needed.
        """
        if not self._orbits:
            self._orbits.append(slow_orbit(self.start) or make_orbit(self.start))
        return self._orbits[0]

    def somewhere(self) -> arb:
        """Return a v of the orbit at which nothing special happens; raises as :attr:`orbit`."""
        arc = self.start.arc
        return self.orbit.somewhere() if is_slow(arc) else somewhere_on(arc)


@dataclass(frozen=True, slots=True)
class Declined:
    """A family's answer that it leaves the motion to the next one."""

    reached: float
    """Largest error that it showed; inf if it did not come so far."""
    found: Motion | None = None
    """A motion that is worse than was claimed and asked for, with the error that it showed."""


NOT_MINE = Declined(float("inf"))


class Family(Protocol):
    """A family of solvers for planar motions; the duties are those of this module."""

    def takes(self, problem: Problem, place: Place) -> bool:
        """Say at a glance whether the motion may be one for this family."""
        ...

    def promise(self, problem: Problem) -> float:
        """Return the largest error of a sample that is handed over, absolute; inf if nothing is promised."""
        ...

    def solve(self, problem: Problem, place: Place) -> Motion | Declined:
        """Return the motion from the start of ``place``, or leave it to the next family."""
        ...


def conventions_of(start: StartingPoint) -> tuple[str, ...]:
    """Return the conventions that motions on the arc of ``start`` need."""
    arc = start.arc
    if arc.loop.is_smooth_at_poles():
        return ()
    return (SYMMETRIC_POLE_PASSAGE,) if arc.is_whole_loop or arc.poles else ()


def energy_of(loop: Loop, v: arb) -> Estimate:
    """Return the energy of the motions on the loop, from the place ``v`` on it."""
    h = loop.energy(v)
    if not h.is_finite():
        h = loop.energy(v + RATE_NUDGE)
    # What is 0 is not told as the rest of a cancellation.
    value = 0.0 if h.contains(0) else float(h.mid())
    # Balls of a potential given by an integral hold what its series is seen to leave out.
    kind: ErrorKind = "theorem" if loop.potential.has_formula else "estimate"
    return Estimate(value, nextafter(float(abs(h - value).abs_upper()), inf), kind)


def evidence_of(resolved: ResolvedMotion) -> dict[str, float | int | str]:
    """Return what the dense output took."""
    return {
        "pieces": len(resolved.breaks) - 1,
        "states": resolved.evaluations,
        "departure": resolved.departure,
    }


class SamplesItself(Protocol):
    """A motion that can be sampled at any time with less error than by way of the dense output."""

    def resolved(self, pieces: int, atol: float) -> ResolvedMotion | None:
        """Return one period in pieces, from so many on; None if :func:`.resolve_motion` has to do it."""
        ...

    def sample(self, times: FloatArray, low_parts: FloatArray | None = None) -> FloatArray:
        """Return p, q, r, g1, g2, g3, shape (n, 6), at ``times`` + ``low_parts``, both of shape (n,)."""
        ...

    def error_at(self, times: FloatArray) -> float:
        """Return the bound of the absolute error of any variable at any of ``times``."""
        ...


@dataclass(frozen=True, slots=True)
class Sampled:
    """A motion that can be sampled over one period."""

    sample: Sampler
    period: Period
    passages: FloatArray
    """Times in [0, period) at which a pole is passed, growing."""
    error: float
    """Error of a sample within one period, beside the departure of the dense output from it."""
    evidence: Mapping[str, float | int | str]
    late: SamplesItself | None = None
    time_error: float = 0.0
    """Error of the time of a sample within one period."""
    features: Features | None = None
    """Where it may vary quickly."""
    kinks: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Times in [0, period) at which a kink of V is passed, growing."""
    place_error: PlaceError | None = None
    """Errors of the place of a sample within one period, where they are known apart."""
    asked: SampleTimes | None = None
    """The times at which samples are asked for, if they were computed before."""


def asked_times(problem: Problem, period: Period | None) -> SampleTimes:
    """Return the times at which samples are asked for; none if no function of time is."""
    if not problem.wants_series:
        return SampleTimes(np.zeros(0), np.zeros(0))
    return sample_times(problem.time, period)


def make_periodic(problem: Problem, place: PeriodicPlace, found: Sampled) -> Motion | Declined:
    """Return the motion in pieces, with its samples and with a claim that is not below what it shows.

    One that shows a larger error than it claimed, and than the tolerance, cannot be believed: it is declined.
    """
    is_draft = _is_draft(problem, found)
    motion, claimed = _with_claim(problem, place, found, is_draft=is_draft)
    if is_draft and not is_within(motion.dense.error, problem.tolerance):
        # Between the samples finer pieces keep what the tier promises.
        motion, claimed = _with_claim(problem, place, found, is_draft=False)
    if found.late is not None and len(motion.times):
        motion = with_samples_raised(problem.body, problem.potential, motion)
    if is_within(motion.error, claimed) or is_within(motion.error, problem.tolerance):
        return motion
    return Declined(motion.error, motion)


def _with_claim(
    problem: Problem, place: PeriodicPlace, found: Sampled, *, is_draft: bool
) -> tuple[Motion, float]:
    """Return the motion with claims that are not below what its function of time shows.

    And the error of its samples that was claimed before.
    """
    period, start = found.period, place.start
    asked = asked_times(problem, period) if found.asked is None else found.asked
    times, low_parts = asked.doubles, asked.low_parts
    resolved = nothing_resolved(period.hi)
    if problem.wants_series:
        resolved = _resolved(problem, place, found, is_draft=is_draft)
    columns = COLUMNS[: resolved.coefficients.shape[2]]
    error, left_out = resolved.error + found.error + resolved.moved(found.time_error), 0.0
    if is_draft and problem.wants_series:
        left_out = TRUNCATION_TAILS * DRAFT_DEPARTURE_SHARE * problem.tolerance
    dense = DenseOutput(columns, resolved.breaks, resolved.coefficients, period, error + left_out)
    samples, reached = np.zeros((0, len(COLUMNS))), 0.0
    if len(times):
        late = found.late
        samples = dense(times, low_parts) if late is None else late.sample(times, low_parts)
        reached = dense.error_at(times) if late is None else late.error_at(times)
    energy = energy_of(start.arc.loop, place.somewhere())
    evidence, claimed = {**found.evidence, **evidence_of(resolved)}, reached
    residual = residual_evidence(problem.body, problem.potential, dense, energy, is_planar=True)
    if residual is not None:
        evidence |= evidence_items(residual)
        keeps_claim = residual.error == dense.error and residual.settled >= THEOREM_TIME_SHARE
        dense, reached = with_error_raised(dense, reached, residual)
        if left_out and keeps_claim:
            # The tails that are there are less than those that are allowed.
            dense = replace(dense, error=min(dense.error, error + TRUNCATION_TAILS * _tail(resolved)))
        if left_out:
            dense = replace(dense, error=largest((dense.error, DRAFT_DEFECT_FACTOR * residual.defect)))
    conventions, off = conventions_of(start), resolved.error + left_out
    # A claim that had to be raised leaves no other.
    apart = found.place_error if dense.error == error + left_out else None
    motion = Motion(
        method="quadrature",
        dense=dense,
        times=times,
        samples=samples,
        error=reached,
        samples_kind="estimate",
        function_kind="estimate",
        energy=energy,
        window=place.window,
        aperiodic=None,
        past=None,
        future=None,
        cross_check=None,
        conventions=conventions,
        evidence=evidence,
        low_parts=low_parts,
        first_passage=float(found.passages[0]) if conventions else None,
        place_error=None if apart is None else replace(apart, off=apart.off + off),
    )
    return motion, claimed


def _tail(resolved: ResolvedMotion) -> float:
    return float(np.abs(resolved.coefficients[:, -TAIL_COEFFICIENTS:]).max(initial=0.0))


def _is_draft(problem: Problem, found: Sampled) -> bool:
    """Say whether no more than a draft is asked of the function of time: samples do not come from it.

    The attitude does.
    """
    is_drawn = "orientation" not in problem.outputs
    return is_drawn and problem.accuracy.tier == "draft" and found.late is not None


def _resolved(problem: Problem, place: PeriodicPlace, found: Sampled, *, is_draft: bool) -> ResolvedMotion:
    """Return the function of time over one period, as fine as the problem can tell."""
    tolerance = problem.tolerance
    # Finer than the samples themselves are known, pieces would follow their errors. A draft is not told to
    # more digits than it promises two of.
    least = DRAFT_DEPARTURE_SHARE * tolerance if is_draft else min(1e-14, 1e-3 * tolerance)
    atol = max(least, 0.25 * found.error)
    if found.late is not None:
        compiled = found.late.resolved(DRAFT_FIRST_PIECES if is_draft else FIRST_PIECES, atol)
        if compiled is not None:
            return compiled
    hi = found.period.hi
    return resolve_motion(
        found.sample,
        (0.0, hi),
        np.sort(np.concatenate([found.passages, found.kinks])),
        scale=hi,
        atol=atol,
        features=found.features,
        finest=MAX_RELATIVE_FINENESS if found.features is None else _finest_pieces(place.orbit, found.period),
    )


def _finest_pieces(orbit: Orbit, period: Period) -> float:
    """Return how many pieces to the period there may be where they are shortest.

    Next to a rest point p and r grow like the time from it; by the rounding of times, a few ulp of
    the period, they are as uncertain as they grow in so long. Where that is more than any tolerance
    allows they jump as far as doubles tell, and short pieces do not make it less.
    """
    if not orbit.is_even:
        return MAX_RELATIVE_FINENESS
    with ctx.workprec(2 * ctx.prec):
        for end in (arb(0), arb.pi()):
            theta = end + REST_PHASE_DISTANCE
            p, _, r, *_ = orbit.state(theta)
            since = orbit.rate(theta) * REST_PHASE_DISTANCE
            change = float(abs(p).max(abs(r)) / since) * 4.0 * EPSILON * period.hi
            if not is_within(change, float(LARGEST_TOLERANCE)):
                return MAX_FINENESS_AT_JUMPS
    return MAX_RELATIVE_FINENESS
