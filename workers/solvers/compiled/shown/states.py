"""The six rates and the three integrals: at several states at once, and on a disc for each variable."""

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.shown.discs import ARITHMETIC, gradient_on_discs, plus, times
from workers.solvers.compiled.shown.gradients import gradients

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@kernel
def evaluate(
    code: IntArray,
    constants: FloatArray,
    result: int,
    moments: FloatArray,
    registers: FloatArray,
    states: FloatArray,
    rates: FloatArray,
    integrals: FloatArray,
    count: int,
) -> None:
    """Fill in F and the integrals at ``count`` states; rows are the columns of a motion.

    ``moments`` are A, B, C, B − C, C − A, A − B.
    """
    for a in range(3):
        for m in range(count):
            registers[0, a, m] = states[3 + a, m]
    gradients(code, constants, registers, count)
    A, B, C, along, across, about = moments
    for m in range(count):
        p, q, r = states[0, m], states[1, m], states[2, m]
        g1, g2, g3 = states[3, m], states[4, m], states[5, m]
        V1, V2, V3 = registers[1, result, m], registers[2, result, m], registers[3, result, m]
        rates[0, m] = (along * (q * r) + (g2 * V3 - g3 * V2)) / A
        rates[1, m] = (across * (p * r) + (g3 * V1 - g1 * V3)) / B
        rates[2, m] = (about * (p * q) + (g1 * V2 - g2 * V1)) / C
        rates[3, m] = r * g2 - q * g3
        rates[4, m] = p * g3 - r * g1
        rates[5, m] = q * g1 - p * g2
        integrals[0, m] = 0.5 * (A * p * p + B * q * q + C * r * r) + registers[0, result, m]
        integrals[1, m] = A * p * g1 + B * q * g2 + C * r * g3
        integrals[2, m] = g1 * g1 + g2 * g2 + g3 * g3


@kernel
def _cross(c: FloatArray, r: FloatArray, i: int, j: int, V: FloatArray, W: FloatArray) -> tuple[float, float]:
    """Return g_i V_j − g_j V_i on discs; i and j count from 1."""
    first, wide = times(c[2 + i], r[2 + i], V[j], W[j])
    second, broad = times(c[2 + j], r[2 + j], V[i], W[i])
    return plus(first, wide, -second, broad)


@kernel
def largest_rates(
    code: IntArray,
    constants: FloatArray,
    result: int,
    moments: FloatArray,
    c: FloatArray,
    r: FloatArray,
    centres: FloatArray,
    radii: FloatArray,
    bounds: FloatArray,
) -> None:
    """Fill in bounds of the six |F| on the discs with these centres and radii, shape (6,); NaN for none."""
    for a in range(3):
        c[a, 0], r[a, 0] = centres[3 + a], radii[3 + a]
    gradient_on_discs(code, constants, c, r)
    V, W = c[result], r[result]
    for a in range(3):
        i, j = (a + 1) % 3, (a + 2) % 3
        pull, far = _cross(centres, radii, i + 1, j + 1, V, W)
        turn, wide = times(centres[i], radii[i], centres[j], radii[j])
        factor = moments[3 + a]
        turn, wide = times(factor, abs(factor) * ARITHMETIC, turn, wide)
        pull, far = plus(turn, wide, pull, far)
        bounds[a] = (abs(pull) + far) / moments[a] * (1.0 + 8.0 * ARITHMETIC)
        # γ' = γ × ω
        first, near = times(centres[j], radii[j], centres[3 + i], radii[3 + i])
        second, away = times(centres[i], radii[i], centres[3 + j], radii[3 + j])
        first, near = plus(first, near, -second, away)
        bounds[3 + a] = (abs(first) + near) * (1.0 + ARITHMETIC)


@kernel
def integrals_on(
    code: IntArray,
    constants: FloatArray,
    result: int,
    moments: FloatArray,
    c: FloatArray,
    r: FloatArray,
    centres: FloatArray,
    radii: FloatArray,
    found: FloatArray,
) -> None:
    """Fill in centres and radii of the three integrals on discs, shape (2, 3); NaN for what is not known."""
    for a in range(3):
        c[a, 0], r[a, 0] = centres[3 + a], radii[3 + a]
    gradient_on_discs(code, constants, c, r)
    found[0, 0], found[1, 0] = c[result, 0], r[result, 0]
    found[:, 1:] = 0.0
    for a in range(3):
        momentum, wide = times(moments[a], moments[a] * ARITHMETIC, centres[a], radii[a])
        x, far = times(momentum, wide, 0.5 * centres[a], 0.5 * radii[a])
        found[0, 0], found[1, 0] = plus(found[0, 0], found[1, 0], x, far)
        x, far = times(momentum, wide, centres[3 + a], radii[3 + a])
        found[0, 1], found[1, 1] = plus(found[0, 1], found[1, 1], x, far)
        x, far = times(centres[3 + a], radii[3 + a], centres[3 + a], radii[3 + a])
        found[0, 2], found[1, 2] = plus(found[0, 2], found[1, 2], x, far)
