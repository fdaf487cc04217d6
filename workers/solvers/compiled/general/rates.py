"""The six rates and the three integrals at several states at once, by compiled code.

Every operation is carried out at all states before the next. Each state has the digits it has alone.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.general.series import (
    ADD,
    DIVIDE,
    EXP,
    LOG,
    MULTIPLY,
    NEGATE,
    POWER,
    SCALE,
    SHARE,
    STATE,
    SUBTRACT,
)
from workers.solvers.compiled.kernels import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

WIDTH = 40
"""States that are gone through together."""


@kernel
def new_values(registers: int, constants: FloatArray) -> FloatArray:
    """Return the registers at ``WIDTH`` states, constants filled in."""
    values = np.zeros((registers, WIDTH))
    for n in range(len(constants)):
        values[STATE + n] = constants[n]
    return values


@kernel
def _function(operation: int, u: FloatArray, to: int, i: int, j: int, count: int) -> None:
    for m in range(count):
        x = u[i, m]
        if operation == POWER:
            u[to, m] = math.pow(x, u[j, m])
        elif operation == EXP:
            u[to, m] = math.exp(x)
        elif operation == LOG:
            u[to, m] = math.log(x) if x > 0.0 else math.nan
        else:
            u[to, m], u[j, m] = math.sin(x), math.cos(x)


@kernel
def rates_at(
    code: IntArray, gradient: IntArray, moments: FloatArray, u: FloatArray, rates: FloatArray, count: int
) -> None:
    """Fill in the rates, shape (6, WIDTH), at ``count`` states, which are the first registers."""
    for n in range(code.shape[0]):
        operation, to, i, j = code[n, 0], code[n, 1], code[n, 2], code[n, 3]
        x, y, z = u[i], u[max(j, 0)], u[to]
        if operation in (MULTIPLY, SCALE):
            for m in range(count):
                z[m] = x[m] * y[m]
        elif operation == ADD:
            for m in range(count):
                z[m] = x[m] + y[m]
        elif operation == SUBTRACT:
            for m in range(count):
                z[m] = x[m] - y[m]
        elif operation in (DIVIDE, SHARE):
            for m in range(count):
                z[m] = x[m] / y[m]
        elif operation == NEGATE:
            for m in range(count):
                z[m] = -x[m]
        else:
            _function(operation, u, to, i, j, count)
    A, B, C, along, across, about = moments
    p, q, r, g1, g2, g3 = u[0], u[1], u[2], u[3], u[4], u[5]
    V1, V2, V3 = u[gradient[0]], u[gradient[1]], u[gradient[2]]
    for m in range(count):
        rates[0, m] = (along * (q[m] * r[m]) + (g2[m] * V3[m] - g3[m] * V2[m])) / A
        rates[1, m] = (across * (p[m] * r[m]) + (g3[m] * V1[m] - g1[m] * V3[m])) / B
        rates[2, m] = (about * (p[m] * q[m]) + (g1[m] * V2[m] - g2[m] * V1[m])) / C
    for m in range(count):
        rates[3, m] = r[m] * g2[m] - q[m] * g3[m]
        rates[4, m] = p[m] * g3[m] - r[m] * g1[m]
        rates[5, m] = q[m] * g1[m] - p[m] * g2[m]
