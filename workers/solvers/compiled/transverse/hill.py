r"""The coefficient of Hill's equation at places of an orbit, with a bound of its rounding.

The equation is that of :mod:`workers.solvers.stability.assessment`, B q̇ = −M, Ṁ = c q with

.. math::
    c = (A-C)\Bigl[\frac{(B-C) r^2}{A} + \frac{(A-B) p^2}{C}\Bigr]
        - \frac{(A-C) B g_2}{Q} Y[V]
        + \Bigl(1 + \frac{B g_2^2}{Q}\Bigr) \frac{\partial^2 V}{\partial\varphi^2},

Q = A g1² + C g3² and Y = (−g1 g2/C, g1²/C − g3²/A, g2 g3/A). It depends on the place alone: on the way back
a libration finds the same c.
"""

import math

import numpy as np
from numpy.typing import NDArray

from service.dynamics.solution.dense_output import UNIT_ROUNDOFF
from workers.solvers.compiled.evaluation.curve import loop_points
from workers.solvers.compiled.evaluation.interpreter import run_bounded
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.records import Formula, Loop
from workers.solvers.compiled.workspace import Places

FloatArray = NDArray[np.float64]

WIDTH = 16
"""Places that are gone through together."""
PLACE_ULPS = 8.0
"""Roundings of g1, g2 and g3 where the curve's own numbers are exact."""


@kernel
def coefficients(
    formula: Formula, loop: Loop, moments: FloatArray, places: Places, c: FloatArray, errors: FloatArray
) -> float:
    """Fill in c and the bound of its rounding at WIDTH places whose sines and cosines are known.

    ``formula`` has the instructions of :func:`service.dynamics.formula.derived.across`; ``moments`` are
    A, B, C, B − C, A − C, A − B. Returns the largest p² + r².
    """
    loop_points(loop, places, WIDTH)
    A, B, C, B_C, A_C, A_B = moments
    first, third = (places.g3, places.g1) if loop.mirrored else (places.g1, places.g3)
    registers, results = formula.registers, formula.turn.results
    for m in range(WIDTH):
        # λ is known by its rounded logarithm, and |g1| as a power of sin v by that of the sine.
        ulps = PLACE_ULPS + 2.0 * loop.alpha * (abs(loop.log_lambda) + abs(math.log(abs(places.sine[m]))))
        registers[0, 0, m], registers[0, 1, m], registers[0, 2, m] = first[m], places.g2[m], third[m]
        for k in range(3):
            registers[1, k, m] = ulps * abs(registers[0, k, m])
    run_bounded(formula.turn.code, formula.constants, formula.lows, registers, WIDTH)
    D, bend, by_first, by_third = results[0], results[1], results[2], results[3]
    largest = 0.0
    factor = -loop.factor if loop.mirrored else loop.factor
    for m in range(WIDTH):
        g1, g2, g3 = first[m], places.g2[m], third[m]
        ulps = registers[1, 0, m] / abs(g1) + 4.0
        share = factor * places.g3[m] / places.g1[m]
        P = share * registers[0, D, m]
        P_error = abs(share) * registers[1, D, m] + (2.0 * ulps + 4.0) * abs(P)
        ratio = loop.alpha * places.g1[m] / places.g3[m]
        other, other_error = ratio * ratio * P, ratio * ratio * (P_error + (4.0 * ulps + 4.0) * abs(P))
        p, p_error, r, r_error = P, P_error, other, other_error
        if loop.mirrored:
            p, p_error, r, r_error = other, other_error, P, P_error
        Q = A * g1 * g1 + C * g3 * g3
        spin, spin_error = B_C * r / A, abs(B_C) / A * r_error
        turn, turn_error = A_B * p / C, abs(A_B) / C * p_error
        gyration = A_C * (spin + turn)
        pull = A_C * B * g2 / Q
        along = (registers[0, by_first, m] / C, registers[0, by_third, m] / A)
        along_error = registers[1, by_first, m] / C + registers[1, by_third, m] / A
        along_error += 2.0 * (abs(along[0]) + abs(along[1]))
        swell = 1.0 + B * g2 * g2 / Q
        torque, swing = pull * (along[0] + along[1]), swell * registers[0, bend, m]
        c[m] = gyration - torque + swing
        error = abs(A_C) * (spin_error + turn_error + 5.0 * (abs(spin) + abs(turn)))
        error += abs(pull) * along_error + (3.0 * ulps + 8.0) * abs(torque)
        error += swell * registers[1, bend, m] + (4.0 * ulps + 8.0) * abs(swing)
        errors[m] = UNIT_ROUNDOFF * (error + 2.0 * abs(c[m]))
        largest = max(largest, p + r)
    return largest
