"""The six rates and the three integrals at several states at once, by compiled code.

Every operation is carried out at all states before the next. Each state has the digits it has alone.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.general.lanes import LANES, place_of, put, spread, take
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
ROWS = WIDTH // LANES
"""Number of rows of a register."""


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
    code: IntArray, gradient: IntArray, moments: FloatArray, values: FloatArray, rates: FloatArray, count: int
) -> None:
    """Fill in the rates, shape (6, WIDTH), at ``count`` states, which are the first registers.

    What is found at the states after these, up to a multiple of ``LANES``, is nothing.
    """
    u, blocks = place_of(values), (count + LANES - 1) // LANES
    for n in range(code.shape[0]):
        operation, to, i, j = code[n, 0], code[n, 1], code[n, 2], code[n, 3]
        x, y, z = i * ROWS, j * ROWS, to * ROWS
        if operation in (MULTIPLY, SCALE):
            for m in range(blocks):
                put(u, z + m, take(u, x + m) * take(u, y + m))
        elif operation == ADD:
            for m in range(blocks):
                put(u, z + m, take(u, x + m) + take(u, y + m))
        elif operation == SUBTRACT:
            for m in range(blocks):
                put(u, z + m, take(u, x + m) - take(u, y + m))
        elif operation in (DIVIDE, SHARE):
            for m in range(blocks):
                put(u, z + m, take(u, x + m) / take(u, y + m))
        elif operation == NEGATE:
            for m in range(blocks):
                put(u, z + m, spread(0.0) - take(u, x + m))
        else:
            _function(operation, values, to, i, j, count)
    A, B, C, along, across, about = moments
    V, found = gradient[0] * ROWS, place_of(rates)
    W, X = gradient[1] * ROWS, gradient[2] * ROWS
    for m in range(blocks):
        p, q, r = take(u, m), take(u, ROWS + m), take(u, 2 * ROWS + m)
        g1, g2, g3 = take(u, 3 * ROWS + m), take(u, 4 * ROWS + m), take(u, 5 * ROWS + m)
        V1, V2, V3 = take(u, V + m), take(u, W + m), take(u, X + m)
        put(found, m, (spread(along) * (q * r) + (g2 * V3 - g3 * V2)) / spread(A))
        put(found, ROWS + m, (spread(across) * (p * r) + (g3 * V1 - g1 * V3)) / spread(B))
        put(found, 2 * ROWS + m, (spread(about) * (p * q) + (g1 * V2 - g2 * V1)) / spread(C))
        put(found, 3 * ROWS + m, r * g2 - q * g3)
        put(found, 4 * ROWS + m, p * g3 - r * g1)
        put(found, 5 * ROWS + m, q * g1 - p * g2)
