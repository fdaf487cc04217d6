"""Computes D = g1 V_3 − g3 V_1 with twice the digits, of a V that is a sum of products of powers.

As :func:`.interpreter.derivative`, which says how. Functions other than the absolute value give NaN.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.doubled.arithmetic import add, divide, multiply, power, subtract
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.records import Formula

FloatArray = NDArray[np.float64]

VALUE, VALUE_LOW, SLOPE, SLOPE_LOW = range(4)
"""Parts of the registers here."""


@kernel
def derivative_doubled(formula: Formula, g: FloatArray, count: int) -> int:
    """Work out D at points with these g1, g2, g3, each a row and one of its rests; return its register."""
    code, constants, lows = formula.code, formula.constants, formula.lows
    v, vl = formula.registers[VALUE], formula.registers[VALUE_LOW]
    d, dl = formula.registers[SLOPE], formula.registers[SLOPE_LOW]
    for m in range(count):
        for k in range(3):
            v[k, m], vl[k, m] = g[2 * k, m], g[2 * k + 1, m]
        d[0, m], dl[0, m] = -v[2, m], -vl[2, m]
        d[1, m], dl[1, m] = 0.0, 0.0
        d[2, m], dl[2, m] = v[0, m], vl[0, m]
    for k in range(code.shape[0]):
        operation, i, j, slot, n = code[k, 0], code[k, 1], code[k, 2], code[k, 3], 3 + k
        if operation == 0:
            for m in range(count):
                v[n, m], vl[n, m], d[n, m], dl[n, m] = constants[slot], lows[slot], 0.0, 0.0
        elif operation == 5 or operation == 13:
            for m in range(count):
                sign = -1.0 if operation == 5 or v[i, m] < 0.0 else 1.0
                v[n, m], vl[n, m] = sign * v[i, m], sign * vl[i, m]
                d[n, m], dl[n, m] = sign * d[i, m], sign * dl[i, m]
        elif operation == 6:
            exponent = (constants[slot], lows[slot])
            for m in range(count):
                x = (v[i, m], vl[i, m])
                value = power(x, exponent)
                v[n, m], vl[n, m] = value
                d[n, m], dl[n, m] = 0.0, 0.0
                if d[i, m] != 0.0:
                    slope = divide(multiply(exponent, value), x)
                    d[n, m], dl[n, m] = multiply(slope, (d[i, m], dl[i, m]))
        else:
            for m in range(count):
                x, y = (v[i, m], vl[i, m]), (v[j, m], vl[j, m])
                dx, dy = (d[i, m], dl[i, m]), (d[j, m], dl[j, m])
                value, slope = (math.nan, 0.0), (math.nan, 0.0)
                if operation == 1:
                    value, slope = add(x, y), add(dx, dy)
                elif operation == 2:
                    value, slope = subtract(x, y), subtract(dx, dy)
                elif operation == 3:
                    value, slope = multiply(x, y), add(multiply(x, dy), multiply(dx, y))
                elif operation == 4:
                    value = divide(x, y)
                    slope = divide(subtract(dx, multiply(dy, value)), y)
                v[n, m], vl[n, m] = value
                d[n, m], dl[n, m] = slope
    return formula.result
