"""V and its three partial derivatives, by forward differentiation, at several places at once."""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.evaluation.interpreter import call, power
from workers.solvers.compiled.kernels import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

WIDTH = 40
"""Places that are gone through together."""


@kernel
def gradients(code: IntArray, constants: FloatArray, v: FloatArray, count: int) -> None:
    """Fill in the registers: V and its partial derivatives, shape (4, 3 + instructions, WIDTH).

    The values of registers 0, 1, 2 are g1, g2, g3.
    """
    for n in range(3):
        for a in range(1, 4):
            for m in range(count):
                v[a, n, m] = 1.0 if a == n + 1 else 0.0
    for k in range(code.shape[0]):
        operation, i, j, slot, n = code[k, 0], code[k, 1], code[k, 2], code[k, 3], 3 + k
        if operation == 0:
            for m in range(count):
                v[0, n, m], v[1, n, m], v[2, n, m], v[3, n, m] = constants[slot], 0.0, 0.0, 0.0
        elif operation == 5:
            for a in range(4):
                for m in range(count):
                    v[a, n, m] = -v[a, i, m]
        elif operation == 6 or operation >= 8:
            _of_one(operation, constants[slot], v, i, n, count)
        else:
            _of_two(operation, v, i, j, n, count)


@kernel
def _of_one(operation: int, exponent: float, v: FloatArray, i: int, n: int, count: int) -> None:
    for m in range(count):
        x = v[0, i, m]
        if operation == 6:
            value = power(x, exponent)
            rise = exponent * power(x, exponent - 1.0) if exponent != 1.0 else 1.0
        else:
            value, rise = call(operation, x)
        v[0, n, m] = value
        for a in range(1, 4):
            v[a, n, m] = rise * v[a, i, m] if v[a, i, m] != 0.0 else 0.0


@kernel
def _of_two(operation: int, v: FloatArray, i: int, j: int, n: int, count: int) -> None:
    if operation == 1 or operation == 2:
        sign = 1.0 if operation == 1 else -1.0
        for a in range(4):
            for m in range(count):
                v[a, n, m] = v[a, i, m] + sign * v[a, j, m]
    elif operation == 3:
        for a in range(1, 4):
            for m in range(count):
                v[a, n, m] = v[0, i, m] * v[a, j, m] + v[a, i, m] * v[0, j, m]
        for m in range(count):
            v[0, n, m] = v[0, i, m] * v[0, j, m]
    elif operation == 4:
        for m in range(count):
            v[0, n, m] = v[0, i, m] / v[0, j, m]
        for a in range(1, 4):
            for m in range(count):
                v[a, n, m] = (v[a, i, m] - v[0, n, m] * v[a, j, m]) / v[0, j, m]
    else:
        for m in range(count):
            x, y = v[0, i, m], v[0, j, m]
            value = x**y if x > 0.0 else math.nan
            v[0, n, m] = value
            for a in range(1, 4):
                v[a, n, m] = value * (v[a, j, m] * math.log(x) + y * v[a, i, m] / x)
