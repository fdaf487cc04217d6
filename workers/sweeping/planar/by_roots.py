"""Computes points of a sweep to the last digit: rational potentials of bodies with A = 2C (or C = 2A).

The roots of each point's radicand are enclosed in balls, as for a single job, and the same compiled code
goes from there. What needs more than numbers, the formula of the potential as a sum of powers, is found once:
the potential is affine in the numbers that vary, and so are its coefficients.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import chain

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.monomials import added_up, as_fraction, scaled_terms, without_zeros
from service.dynamics.potentials.terms.laurent import Laurent
from service.dynamics.problem import PlanarMotion, StartAtPoint, TimePeriods
from service.dynamics.sampling import SampleTimes, sample_times
from service.dynamics.solution.dense_output import Period
from workers.solvers.compiled.batch import NO_TIMES, BatchResult, bounds_of
from workers.solvers.compiled.frame import Frame, make_frame
from workers.solvers.compiled.rational.roots import Radicand, curve_of, expansion_of, radicand_of
from workers.solvers.compiled.records import FOUND, Records, copied, new_records
from workers.solvers.compiled.solve import solve_rational
from workers.solvers.compiled.time_map.sampling import sample_one
from workers.solvers.compiled.workspace import WORKSPACE
from workers.sweeping.parameters.family import SweepFamily
from workers.sweeping.planar.doubles import BlockResult, Sampling, logarithms_of, pass_a_pole

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RationalFamily:
    """V as a sum of powers at each point: ``origin`` + Σ p_k ``slopes``_k."""

    body: RigidBody
    motion: PlanarMotion
    """On the side of all points."""
    origin: Laurent
    slopes: tuple[Laurent, ...]

    def radicand(self, parameters: Sequence[fmpq], nu: Fraction) -> Radicand | None:
        """Return the radicand at a point, the very one of its own job."""
        slopes = (scaled_terms(slope, p) for p, slope in zip(parameters, self.slopes, strict=True))
        total = added_up(chain(self.origin.items(), *slopes))
        return radicand_of(self.body, without_zeros(total), nu)

    def at(self, lambda_squared: fmpq, start: Fraction | None) -> PlanarMotion:
        """Return the motion of a point, from |g1| = ``start`` where there is one."""
        motion, square = self.motion, as_fraction(lambda_squared)
        if start is not None and isinstance(motion.start, StartAtPoint):
            motion = replace(motion, start=replace(motion.start, g1=motion.sign_of_g1 * start))
        if motion.nu is not None:
            return replace(motion, nu=motion.sign_of_g1 * square)
        # The square of a rational number.
        return replace(motion, lambda_=Fraction(math.isqrt(square.numerator), math.isqrt(square.denominator)))


def rational_family(body: RigidBody, family: SweepFamily, motion: PlanarMotion) -> RationalFamily | None:
    """Return the potentials of a sweep as sums of powers; None if one of them is none, or by its body."""
    if curve_of(body, motion) is None or make_frame(body, motion) is None:
        return None
    expanded = [expansion_of(body, member.potential, motion) for member in family.members]
    known = [each for each in expanded if each is not None]
    if len(known) != len(expanded):
        return None
    origin, *units = known
    return RationalFamily(
        body,
        motion,
        origin,
        tuple(without_zeros(added_up(chain(unit.items(), scaled_terms(origin, fmpq(-1))))) for unit in units),
    )


def sweep_by_roots(
    family: RationalFamily,
    rows: Sequence[Sequence[fmpq]],
    lambdas_squared: Sequence[fmpq],
    sampling: Sampling,
    starts: Sequence[Fraction] | None = None,
) -> BlockResult:
    """Solve the potentials of ``rows`` to the last digit, each on the curve of the same row's λ².

    ``starts`` are the |g1| at the starts, where each point has its own. What is not of this kind, or not
    decided, is not solved.
    """
    frame = make_frame(family.body, family.motion)
    assert frame is not None
    loops = frame.loops(logarithms_of(lambdas_squared))
    results = _Found(loops, sampling)
    for n, (row, square) in enumerate(zip(rows, lambdas_squared, strict=True)):
        motion = family.at(square, None if starts is None else starts[n])
        nu = curve_of(family.body, motion)
        radicand = None if nu is None else family.radicand(row, nu)
        if radicand is None:
            continue
        solved = solve_rational(radicand, motion, Frame(copied(loops[n : n + 1])))
        if solved is not None:
            results.add(n, *solved)
    return results.result()


class _Found:
    """The results for the motions, filled in one by one."""

    def __init__(self, loops: Records, sampling: Sampling) -> None:
        sets = len(loops)
        self._loops, self._about, self._workspace = (
            copied(loops),
            new_records(FOUND, sets),
            new_records(WORKSPACE),
        )
        self._about["panels"] = 0
        self._sampling = sampling
        is_shared = sampling.has_times and not isinstance(sampling.time, TimePeriods)
        self._shared = sample_times(sampling.time, None) if is_shared else NO_TIMES
        count = sampling.time.samples if isinstance(sampling.time, TimePeriods) else len(self._shared.doubles)
        self._times = np.full((sets, count), np.nan)
        self._samples = np.full((sets, count if sampling.has_times else 0, len(sampling.columns)), np.nan)
        self._periods, self._lows, self._uncertain, self._latest = np.full((4, sets), np.nan)

    def add(self, n: int, period: Period, run: BatchResult) -> None:
        """Fill in one motion, and sample it."""
        self._loops[n], self._about[n] = run.loops[0], run.found[0]
        self._periods[n], self._lows[n], self._uncertain[n] = period.hi, abs(period.lo), period.error
        if not self._sampling.has_times:
            self._latest[n] = period.hi
            return
        times = self._asked(period)
        self._times[n], self._latest[n] = times.doubles, np.abs(times.doubles).max()
        columns = self._sampling.columns
        if len(columns):
            rows = self._samples[n]
            sample_one(run.loops, run.panels, times.doubles, times.low_parts, columns, self._workspace, rows)

    def result(self) -> BlockResult:
        """Return all of them."""
        bounds = bounds_of(self._about)
        errors = bounds.error_at(self._latest, self._periods, self._uncertain)
        is_solved = (self._about["panels"] > 0) & ~np.isnan(errors)
        return BlockResult(
            self._periods,
            # What the second double of the period says is left out of the first.
            self._lows + self._uncertain,
            np.where(is_solved, errors, np.inf),
            self._times,
            self._samples,
            pass_a_pole(self._loops, self._about),
            is_solved,
            None,
            self._about["largest"],
        )

    def _asked(self, period: Period) -> SampleTimes:
        time = self._sampling.time
        return sample_times(time, period) if isinstance(time, TimePeriods) else self._shared
