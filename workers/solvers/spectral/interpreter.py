"""V's derivative D = g1 V_3 − g3 V_1 of a program at one point, with a running bound of its rounding."""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.spectral.compiled import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@kernel
def power(base: float, exponent: float) -> float:
    """Return base^exponent by multiplications for a small integer; NaN where undefined."""
    size = abs(exponent)
    if exponent == 0.5:
        return math.sqrt(base) if base >= 0.0 else math.nan
    if size <= 64.0 and size == math.floor(size):
        result, factor, left = 1.0, base, int(size)
        while left:
            if left & 1:
                result *= factor
            factor *= factor
            left >>= 1
        if exponent < 0.0:
            return 1.0 / result if result != 0.0 else math.nan
        return result
    return base**exponent if base > 0.0 else (0.0 if base == 0.0 and exponent > 0.0 else math.nan)


@kernel
def call(operation: int, x: float) -> tuple[float, float]:
    """Return a function (numbered as in :mod:`.program`) and its derivative."""
    if operation == 8:
        value = math.exp(x)
        return value, value
    if operation == 9:
        return (math.log(x), 1.0 / x) if x > 0.0 else (math.nan, math.nan)
    if operation == 10:
        return math.sin(x), math.cos(x)
    if operation == 11:
        return math.cos(x), -math.sin(x)
    if operation == 12:
        value = math.tan(x)
        return value, 1.0 + value * value
    if operation == 13:
        return abs(x), (1.0 if x > 0.0 else -1.0 if x < 0.0 else 0.0)
    return (1.0 if x > 0.0 else -1.0 if x < 0.0 else 0.0), 0.0


@kernel
def derivative(
    code: IntArray, result: int, constants: FloatArray, g1: float, g2: float, g3: float, work: FloatArray
) -> float:
    """Return D at a point; ``work`` has shape (4, registers)."""
    v, d = work[0], work[1]
    v[0], v[1], v[2] = g1, g2, g3
    d[0], d[1], d[2] = -g3, 0.0, g1
    for k in range(code.shape[0]):
        operation, i, j = code[k, 0], code[k, 1], code[k, 2]
        n = 3 + k
        if operation == 3:
            v[n] = v[i] * v[j]
            d[n] = v[i] * d[j] + d[i] * v[j]
        elif operation == 0:
            v[n], d[n] = constants[code[k, 3]], 0.0
        elif operation == 1:
            v[n], d[n] = v[i] + v[j], d[i] + d[j]
        elif operation == 2:
            v[n], d[n] = v[i] - v[j], d[i] - d[j]
        elif operation == 4:
            v[n] = v[i] / v[j]
            d[n] = (d[i] - d[j] * v[n]) / v[j]
        elif operation == 5:
            v[n], d[n] = -v[i], -d[i]
        elif operation == 6:
            exponent = constants[code[k, 3]]
            v[n] = power(v[i], exponent)
            d[n] = 0.0 if d[i] == 0.0 else exponent * v[n] / v[i] * d[i]
        elif operation == 7:
            v[n] = v[i] ** v[j] if v[i] > 0.0 else math.nan
            d[n] = v[n] * (d[j] * math.log(v[i]) + v[j] * d[i] / v[i])
        else:
            value, slope = call(operation, v[i])
            v[n], d[n] = value, slope * d[i]
    return float(d[result])


@kernel
def derivative_with_bound(
    code: IntArray, result: int, constants: FloatArray, g1: float, g2: float, g3: float, work: FloatArray
) -> tuple[float, float]:
    """Return D and the bound of its rounding in units of 2^-53 (first order), inputs being a few ulp off."""
    D = derivative(code, result, constants, g1, g2, g3, work)
    v, d, ev, ed = work[0], work[1], work[2], work[3]
    ev[0], ev[1], ev[2] = 2.0 * abs(g1), 2.0 * abs(g2), 2.0 * abs(g3)
    ed[0], ed[1], ed[2] = 2.0 * abs(g3), 0.0, 2.0 * abs(g1)
    for k in range(code.shape[0]):
        operation, i, j = code[k, 0], code[k, 1], code[k, 2]
        n = 3 + k
        if operation == 3:
            ev[n] = abs(v[i]) * ev[j] + ev[i] * abs(v[j]) + abs(v[n])
            ed[n] = (
                abs(v[i]) * (ed[j] + abs(d[j]))
                + ev[i] * abs(d[j])
                + (ed[i] + abs(d[i])) * abs(v[j])
                + abs(d[i]) * ev[j]
                + abs(d[n])
            )
        elif operation == 0:
            ev[n], ed[n] = abs(v[n]), 0.0
        elif operation == 1 or operation == 2:
            ev[n], ed[n] = ev[i] + ev[j] + abs(v[n]), ed[i] + ed[j] + abs(d[n])
        elif operation == 4:
            size = abs(v[j])
            ev[n] = (ev[i] + abs(v[n]) * ev[j]) / size + abs(v[n])
            ed[n] = (
                ed[i] + (ed[j] + 2.0 * abs(d[j])) * abs(v[n]) + abs(d[j]) * ev[n] + abs(d[n]) * ev[j]
            ) / size + 2.0 * abs(d[n])
        elif operation == 5:
            ev[n], ed[n] = ev[i], ed[i]
        elif operation == 6 or operation == 7:
            exponent = constants[code[k, 3]] if operation == 6 else v[j]
            relative = ev[i] / abs(v[i]) if v[i] != 0.0 else 0.0
            size = abs(exponent)
            own = (
                size * relative
                + min(size, 8.0)
                + 2.0
                + (size * abs(math.log(abs(v[i]))) if v[i] != 0.0 else 0.0)
            )
            ev[n] = abs(v[n]) * own
            ed[n] = abs(d[n]) * (own + relative + 3.0)
            if v[i] != 0.0:
                ed[n] += abs(exponent * v[n] / v[i]) * ed[i]
            if operation == 7 and v[i] > 0.0:
                ev[n] += abs(v[n] * math.log(v[i])) * ev[j]
                ed[n] += abs(v[n]) * (
                    abs(math.log(v[i])) * (ed[j] + 3.0 * abs(d[j])) + abs(d[i] / v[i]) * ev[j]
                )
        else:
            _, slope = call(operation, v[i])
            # |f''| ≤ |f'| + |f| + … of these functions where they are smooth; log has 1/x² = f'².
            bend = (
                abs(slope) * abs(slope)
                if operation == 9
                else abs(slope) + abs(v[n]) * (1.0 + 2.0 * abs(slope))
            )
            if operation >= 13:
                bend = 0.0
            ev[n] = abs(slope) * ev[i] + 2.0 * abs(v[n])
            ed[n] = abs(slope) * ed[i] + abs(d[i]) * bend * ev[i] + 3.0 * abs(d[n])
    return D, float(ed[result])
