"""Computes D = g1 V_3 − g3 V_1 of a formula at many points, with a bound of the rounding of each value.

Every instruction is carried out at all points before the next: what it costs to read a
program is shared, and plain arithmetic goes through several points at once. Each point
has the digits it has alone.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.records import Formula
from workers.solvers.compiled.workspace import POINTS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

VALUE, SLOPE, VALUE_ULPS, SLOPE_ULPS = range(4)
"""Parts of the registers, shape (4, registers, POINTS)."""


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
def new_registers(code: IntArray) -> FloatArray:
    """Return the registers that the interpreter of a program works on."""
    return np.empty((4, code.shape[0] + 3, POINTS))


@kernel
def derivative(
    formula: Formula,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
    count: int,
) -> FloatArray:
    """Return D, one of the registers, at ``count`` ≤ POINTS points, which have these g1, g2 and g3."""
    code, constants, v, d = (
        formula.code,
        formula.constants,
        formula.registers[VALUE],
        formula.registers[SLOPE],
    )
    for m in range(count):
        g1, g3 = first[m], third[m]
        v[0, m], v[1, m], v[2, m] = g1, second[m], g3
        d[0, m], d[1, m], d[2, m] = -g3, 0.0, g1
    # No views of single registers: making them takes longer than the arithmetic.
    for k in range(code.shape[0]):
        operation, i, j, slot, n = code[k, 0], code[k, 1], code[k, 2], code[k, 3], 3 + k
        if operation == 0:
            for m in range(count):
                v[n, m], d[n, m] = constants[slot], 0.0
        elif operation == 5:
            for m in range(count):
                v[n, m], d[n, m] = -v[i, m], -d[i, m]
        elif operation == 6:
            _power(v, d, i, n, count, constants[slot])
        elif operation >= 8:
            for m in range(count):
                value, rise = call(operation, v[i, m])
                v[n, m], d[n, m] = value, rise * d[i, m]
        else:
            _combine(operation, v, d, i, j, n, count)
    D: FloatArray = d[formula.result, :count]
    return D


@kernel
def _combine(operation: int, v: FloatArray, d: FloatArray, i: int, j: int, n: int, count: int) -> None:
    """Carry out what has two operands."""
    if operation == 3:
        for m in range(count):
            v[n, m] = v[i, m] * v[j, m]
            d[n, m] = v[i, m] * d[j, m] + d[i, m] * v[j, m]
    elif operation == 1:
        for m in range(count):
            v[n, m], d[n, m] = v[i, m] + v[j, m], d[i, m] + d[j, m]
    elif operation == 2:
        for m in range(count):
            v[n, m], d[n, m] = v[i, m] - v[j, m], d[i, m] - d[j, m]
    elif operation == 4:
        for m in range(count):
            value = v[i, m] / v[j, m]
            v[n, m], d[n, m] = value, (d[i, m] - d[j, m] * value) / v[j, m]
    else:
        for m in range(count):
            x, y = v[i, m], v[j, m]
            value = x**y if x > 0.0 else math.nan
            v[n, m], d[n, m] = value, value * (d[j, m] * math.log(x) + y * d[i, m] / x)


@kernel
def _power(v: FloatArray, d: FloatArray, i: int, n: int, count: int, exponent: float) -> None:
    if exponent == 2.0 or exponent == -2.0:
        # As :func:`power` has it, several points at once.
        for m in range(count):
            square = v[i, m] * v[i, m]
            inverse = 1.0 / square if square != 0.0 else math.nan
            v[n, m] = square if exponent > 0.0 else inverse
    else:
        for m in range(count):
            v[n, m] = power(v[i, m], exponent)
    for m in range(count):
        rise = exponent * v[n, m] / v[i, m] * d[i, m]
        d[n, m] = 0.0 if d[i, m] == 0.0 else rise


@kernel
def derivative_with_bound(
    formula: Formula,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
    count: int,
) -> tuple[FloatArray, FloatArray]:
    """Return D and the bound of its rounding in units of 2^-53 (first order), inputs being a few ulp off."""
    D = derivative(formula, first, second, third, count)
    code, constants, v, d = (
        formula.code,
        formula.constants,
        formula.registers[VALUE],
        formula.registers[SLOPE],
    )
    ev, ed = formula.registers[VALUE_ULPS], formula.registers[SLOPE_ULPS]
    for m in range(count):
        ev[0, m], ev[1, m], ev[2, m] = 2.0 * abs(v[0, m]), 2.0 * abs(v[1, m]), 2.0 * abs(v[2, m])
        ed[0, m], ed[1, m], ed[2, m] = 2.0 * abs(v[2, m]), 0.0, 2.0 * abs(v[0, m])
    for k in range(code.shape[0]):
        operation, i, j, slot, n = code[k, 0], code[k, 1], code[k, 2], code[k, 3], 3 + k
        if operation == 0:
            for m in range(count):
                ev[n, m], ed[n, m] = abs(v[n, m]), 0.0
        elif operation == 5:
            for m in range(count):
                ev[n, m], ed[n, m] = ev[i, m], ed[i, m]
        elif operation == 6:
            for m in range(count):
                ev[n, m], ed[n, m] = _bound_power(
                    constants[slot], v[i, m], ev[i, m], ed[i, m], v[n, m], d[n, m]
                )
        elif operation >= 8:
            for m in range(count):
                _bound_call(operation, v, d, ev, ed, i, n, m)
        else:
            _bound_combined(operation, v, d, ev, ed, i, j, n, count)
    return D, ed[formula.result, :count]


@kernel
def _bound_combined(
    operation: int,
    v: FloatArray,
    d: FloatArray,
    ev: FloatArray,
    ed: FloatArray,
    i: int,
    j: int,
    n: int,
    count: int,
) -> None:
    if operation == 3:
        for m in range(count):
            x, y, dx, dy = abs(v[i, m]), abs(v[j, m]), abs(d[i, m]), abs(d[j, m])
            ev[n, m] = x * ev[j, m] + ev[i, m] * y + abs(v[n, m])
            ed[n, m] = (
                x * (ed[j, m] + dy) + ev[i, m] * dy + (ed[i, m] + dx) * y + dx * ev[j, m] + abs(d[n, m])
            )
    elif operation == 4:
        for m in range(count):
            size, dy, value, slope = abs(v[j, m]), abs(d[j, m]), abs(v[n, m]), abs(d[n, m])
            ulps = (ev[i, m] + value * ev[j, m]) / size + value
            ev[n, m] = ulps
            ed[n, m] = (
                ed[i, m] + (ed[j, m] + 2.0 * dy) * value + dy * ulps + slope * ev[j, m]
            ) / size + 2.0 * slope
    elif operation == 7:
        for m in range(count):
            x = v[i, m]
            ev[n, m], ed[n, m] = _bound_power(v[j, m], x, ev[i, m], ed[i, m], v[n, m], d[n, m])
            if x > 0.0:
                logarithm = math.log(x)
                ev[n, m] += abs(v[n, m] * logarithm) * ev[j, m]
                ed[n, m] += abs(v[n, m]) * (
                    abs(logarithm) * (ed[j, m] + 3.0 * abs(d[j, m])) + abs(d[i, m] / x) * ev[j, m]
                )
    else:
        for m in range(count):
            ev[n, m] = ev[i, m] + ev[j, m] + abs(v[n, m])
            ed[n, m] = ed[i, m] + ed[j, m] + abs(d[n, m])


@kernel
def _bound_power(
    exponent: float, x: float, ex: float, edx: float, value: float, slope: float
) -> tuple[float, float]:
    relative = ex / abs(x) if x != 0.0 else 0.0
    size = abs(exponent)
    own = size * relative + min(size, 8.0) + 2.0 + (size * abs(math.log(abs(x))) if x != 0.0 else 0.0)
    ulps = abs(slope) * (own + relative + 3.0)
    if x != 0.0:
        ulps += abs(exponent * value / x) * edx
    return abs(value) * own, ulps


@kernel
def _bound_call(
    operation: int,
    v: FloatArray,
    d: FloatArray,
    ev: FloatArray,
    ed: FloatArray,
    i: int,
    n: int,
    m: int,
) -> None:
    _, rise = call(operation, v[i, m])
    size = abs(rise)
    # |f''| ≤ |f'| + |f| + … of these functions where they are smooth; log has 1/x² = f'².
    bend = size * size if operation == 9 else size + abs(v[n, m]) * (1.0 + 2.0 * size)
    if operation >= 13:
        bend = 0.0
    ev[n, m] = size * ev[i, m] + 2.0 * abs(v[n, m])
    ed[n, m] = size * ed[i, m] + abs(d[i, m]) * bend * ev[i, m] + 3.0 * abs(d[n, m])
