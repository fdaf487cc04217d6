"""Target 5: evaluating a stored solution against scipy.special.ellipj at the same samples."""

from fractions import Fraction

import mpmath
import numpy as np
from scipy.special import ellipj, ellipk

from service.dynamics.dense_output import DenseOutput
from service.dynamics.problem import TimePeriods
from tests.benchmarks.measuring import Effort, Result, Row, in_turns
from tests.benchmarks.motions import FloatArray, elliptic
from tests.support.planar import planar
from workers.solvers.quadrature.solve import solve_planar
from workers.solvers.spectral.evaluation import evaluate

MODULUS = 0.7
"""The parameter m of the elliptic functions."""
PERIODS = 10
STRIDE = 9


def evaluation(effort: Effort) -> list[Row]:
    """Compare six variables from the stored series, by numpy and compiled, with SciPy's four functions."""
    motion, dense = elliptic(), stored_solution()
    assert dense.period is not None
    period = dense.period.hi
    rows = []
    for samples in (1000,) if effort.is_quick else (1000, 100_000):
        times = np.linspace(0.0, PERIODS * period, samples)
        # The same shares of the period: 4 K of the elliptic functions, one of the motion.
        arguments = 4.0 * ellipk(MODULUS) * times / period
        stored, rival, compiled = in_turns(
            (lambda: dense(times), lambda: ellipj(arguments, MODULUS), lambda: evaluate(dense, times)),  # noqa: B023
            effort.repeats(201 if samples == 1000 else 11),
        )
        stride = STRIDE * samples // 1000
        theirs = Result("ellipj, 4 functions", rival, _error_of_ellipj(arguments[::stride]))
        error = motion.error(times, dense(times), stride)
        is_same = np.array_equal(evaluate(dense, times), dense(times))
        numpy_alone = Result("stored series, 6 columns", stored, error)
        in_doubles = Result(
            "stored series, 6 columns",
            compiled,
            motion.error(times, evaluate(dense, times), stride),
            "the bits of numpy" if is_same else "not the bits of numpy",
        )
        share, ratio = stored / rival, rival / compiled
        what = f"{samples:,} samples of a stored solution, "
        rows += [
            Row(5, what + "numpy", "≤ 2×", f"{share:.2f}×", share <= 2.0, numpy_alone, theirs),
            Row(
                5,
                what + "compiled",
                "≥ 5× faster",
                f"{ratio:.1f}× faster",
                ratio >= 5.0,
                in_doubles,
                theirs,
            ),
        ]
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
