"""Computes points of a sweep to the last digit: rational potentials of bodies with A = 2C (or C = 2A).

The roots of each point's radicand are enclosed in balls, as for a single job, and the same compiled code
goes from there. What needs more than numbers, the formula of the potential as a sum of powers, is found once:
the potential is affine in the numbers that vary, and so are its coefficients.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.monomials import as_fraction, weighted_sum
from service.dynamics.potentials.recognition import Laurent
from service.dynamics.problem import PlanarMotion, StartAtPoint, TimePeriods
from service.dynamics.sampling import SampleTimes, sample_times
from service.dynamics.solution.dense_output import Period
from workers.solvers.compiled.frame import Frame, make_frame
from workers.solvers.compiled.rational import Radicand, curve_of, expansion_of, radicand_of
from workers.solvers.compiled.records import copied
from workers.solvers.compiled.solve import NO_TIMES, BatchResult, solve_rational
from workers.sweeping.parameters.family import SweepFamily
from workers.sweeping.planar.doubles import BlockResult, Sampling, logarithms_of, solve_one_by_one

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
        total = weighted_sum([(fmpq(1), self.origin), *zip(parameters, self.slopes, strict=True)])
        return radicand_of(self.body, total, nu)

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
        body, motion, origin, tuple(weighted_sum(((fmpq(1), unit), (fmpq(-1), origin))) for unit in units)
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
    loops, time = frame.loops(logarithms_of(lambdas_squared)), sampling.time
    in_periods = isinstance(time, TimePeriods)
    shared = sample_times(time, None) if sampling.has_times and not in_periods else NO_TIMES

    def solve(n: int) -> BatchResult | None:
        motion = family.at(lambdas_squared[n], None if starts is None else starts[n])
        nu = curve_of(family.body, motion)
        radicand = None if nu is None else family.radicand(rows[n], nu)
        if radicand is None:
            return None
        solved = solve_rational(radicand, motion, Frame(copied(loops[n : n + 1])))
        return None if solved is None else solved[1]

    def asked(_: int, period: Period) -> SampleTimes:
        return sample_times(time, period) if in_periods else shared

    count = time.samples if isinstance(time, TimePeriods) else len(shared.doubles)
    return solve_one_by_one(loops, sampling.columns, solve, asked, count if sampling.has_times else 0)
