"""Target 5: evaluating a stored solution against scipy.special.ellipj at the same samples."""

from fractions import Fraction

import mpmath
import numpy as np
from scipy.special import ellipj, ellipk

from service.dynamics.problem import TimePeriods
from service.dynamics.solution.dense_output import DenseOutput
from tests.benchmarks.measuring import Effort, Result, Row, in_turns
from tests.benchmarks.motions import FloatArray, elliptic
from tests.support.planar import planar
from tests.support.solving import solve_planar

MODULUS = 0.7
"""The parameter m of the elliptic functions."""
PERIODS = 10
STRIDE = 9


def evaluation(effort: Effort) -> list[Row]:
    """Compare six variables from the stored series with SciPy's four functions."""
    motion, dense = elliptic(), stored_solution()
    assert dense.period is not None
    period = dense.period.hi
    rows = []
    for samples in (1000,) if effort.is_quick else (1000, 100_000):
        times = np.linspace(0.0, PERIODS * period, samples)
        # The same shares of the period: 4 K of the elliptic functions, one of the motion.
        arguments = 4.0 * ellipk(MODULUS) * times / period
        stored, rival = in_turns(
            (lambda: dense(times), lambda: ellipj(arguments, MODULUS)),  # noqa: B023
            effort.repeats(201 if samples == 1000 else 11),
        )
        stride = STRIDE * samples // 1000
        theirs = Result("ellipj, 4 functions", rival, _error_of_ellipj(arguments[::stride]))
        ours = Result("stored series, 6 columns", stored, motion.error(times, dense(times), stride))
        share = stored / rival
        what = f"{samples:,} samples of a stored solution"
        rows.append(Row(5, what, "≤ 2×", f"{share:.2f}×", share <= 2.0, ours, theirs))
    return rows


def stored_solution() -> DenseOutput:
    """Return the elliptic motion as a job of tier standard stores it."""
    motion = elliptic()
    problem = planar(motion.body, motion.potential, motion.motion, TimePeriods(Fraction(1), 11))
    return solve_planar(problem).dense


def _error_of_ellipj(arguments: FloatArray) -> float:
    """Return the largest error of sn, cn, dn at the very same doubles."""
    found = np.array(ellipj(arguments, MODULUS)[:3]).T
    with mpmath.workdps(40):
        m = mpmath.mpf(MODULUS)
        return max(
            float(abs(mpmath.ellipfun(name, mpmath.mpf(u), m=m) - mpmath.mpf(value)))
            for u, row in zip(arguments.tolist(), found.tolist(), strict=True)
            for name, value in zip(("sn", "cn", "dn"), row, strict=True)
        )
