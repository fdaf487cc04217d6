r"""The precession per period of motions round the whole loop, by compiled doubles.

The integral is that of :mod:`workers.solvers.orientation.advance`, of one function of v, λ and α,

.. math:: \frac{d\psi_1}{dv} = α Z \frac{|g_1|}{c\,(g_2^2 + g_3^2)} ,

four times from the pole to the equator. Panels are halved until 16 nodes of Gauss on each half give what they
give on the whole; what both differ by, and the rounding of the integrand, are the error.
"""

import math

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from service.dynamics.solution.dense_output import UNIT_ROUNDOFF
from workers.solvers.compiled.evaluation.curve import size_and_c
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.records import Loop, Records
from workers.solvers.compiled.solve_set import equator_of

FloatArray = NDArray[np.float64]

NODES, WEIGHTS = legendre.leggauss(16)
RESOLVED_CHANGE = 2.0**-56
"""Change of a panel by halving that is small enough, relative to the whole."""
MAX_WAITING = 60
"""Panels that wait: one for each time that one is halved."""
NARROWEST_PANEL = 1e-15
INTEGRAND_ULPS = 8.0
"""Rounding error of the integrand, in 2^-53 of it, where λ and the power of the sine are exact."""


@kernel
def _on_panel(loop: Loop, left: float, right: float) -> tuple[float, float]:
    """Return the integral over a panel, and the bound of its rounding."""
    alpha, z, size = loop.alpha, loop.z, loop.g
    middle, half = 0.5 * (left + right), 0.5 * (right - left)
    total, error = 0.0, 0.0
    of_lambda = 4.0 * (1.0 + alpha) * abs(loop.log_lambda)
    for k in range(len(NODES)):
        v = middle + half * NODES[k]
        sine, cosine = math.sin(v), math.cos(v)
        g1, c = size_and_c(alpha, z, size, sine, cosine)
        g2, g3 = c * cosine, z * sine
        value = WEIGHTS[k] * half * (alpha * z * g1 / (c * (g2 * g2 + g3 * g3)))
        total += value
        error += value * (INTEGRAND_ULPS + of_lambda + 2.0 * alpha * abs(math.log(sine)))
    return total, UNIT_ROUNDOFF * error


@kernel
def advance_of(loops: Records) -> tuple[float, float]:
    """Return the integral over the whole loop of the primed axes, and the bound of its error; NaN for none.

    Of the loop only α and log λ count.
    """
    loop = loops[0]
    loop.z, loop.g = equator_of(loop.alpha, loop.log_lambda)
    lefts, rights, values = np.empty(MAX_WAITING), np.empty(MAX_WAITING), np.empty(MAX_WAITING)
    lefts[0], rights[0] = 0.0, 0.5 * math.pi
    values[0], _ = _on_panel(loop, lefts[0], rights[0])
    pending, total, error = 1, 0.0, 0.0
    whole = values[0]
    while pending:
        pending -= 1
        left, right = lefts[pending], rights[pending]
        middle = 0.5 * (left + right)
        one, first = _on_panel(loop, left, middle)
        two, second = _on_panel(loop, middle, right)
        change = abs(one + two - values[pending])
        if not change < math.inf:
            return math.nan, math.nan
        if change <= max(RESOLVED_CHANGE * whole, first + second) or right - left < NARROWEST_PANEL:
            total += one + two
            error += change + first + second
            continue
        if pending + 2 > MAX_WAITING:
            return math.nan, math.nan
        lefts[pending], rights[pending], values[pending] = middle, right, two
        lefts[pending + 1], rights[pending + 1], values[pending + 1] = left, middle, one
        pending += 2
    return 4.0 * total, 4.0 * error
