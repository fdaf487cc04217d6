r"""The time of a turn by the trapezoidal rule, with its proven error.

dt/dθ has the period 2π. Where it is holomorphic and bounded by M for |Im θ| < a,
n equidistant values leave (L. N. Trefethen and J. A. C. Weideman, SIAM Review
56 (2014), theorem 3.2)

.. math:: |T_n - T| \le \frac{4\pi M}{e^{an} - 1} .
"""

from math import ceil, log, pi

from flint import acb, arb, ctx

from workers.solvers.certified.cover import Box, bound
from workers.solvers.certified.phase import Phase

COLUMNS = (5, 8, 13, 21, 34, 55)
"""Boxes side by side over half a turn, tried in turn: the strip is as high as they are wide."""


def time_of_turn(phase: Phase) -> arb | None:
    """Return the period at the current precision; None if singularities are too near the real axis."""
    for columns in COLUMNS:
        side = pi / columns
        count = columns if phase.is_even else 2 * columns
        # A double below π: the last box reaches over it all the same.
        boxes = [Box((j + 0.5) * side, 0.5 * side, 0.5 * side) for j in range(count)]
        largest = bound(phase, boxes, smallest=0.2 * side, most=4 * count)
        if largest is not None:
            return _sum(phase, largest, side)
    return None


def _sum(phase: Phase, largest: arb, height: float) -> arb:
    scale = float((largest / abs(phase.rate(acb(arb(1)), analytic=False))).log())
    # Even; the bound is then a few ulp of the period.
    count = 2 * ceil((ctx.prec * log(2.0) + max(0.0, scale)) / height / 2.0)
    last = count // 2 if phase.is_even else count - 1
    total = arb(0)
    for j in range(last + 1):
        weight = 2 if phase.is_even and 0 < j < last else 1
        total += weight * phase.rate(acb(2 * arb.pi() * j / count), analytic=False).real
    error = 4 * arb.pi() * largest / ((arb(height) * count).exp() - 1)
    return 2 * arb.pi() * total / count + arb(0, error.abs_upper())
