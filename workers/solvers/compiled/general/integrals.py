"""The three integrals at several states at once, by compiled code: eight go through a formula together."""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.evaluation.interpreter import call, power
from workers.solvers.compiled.general.lanes import LANES, Lanes, place_of, put, spread, take
from workers.solvers.compiled.general.rates import ROWS
from workers.solvers.compiled.general.records import Formula
from workers.solvers.compiled.general.series import STATE
from workers.solvers.compiled.kernels import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_LARGEST_PRODUCT = 64.0
"""Integer powers up to this one are products."""


@kernel
def _whole_power(x: Lanes, exponent: float) -> Lanes:
    result, factor, left = spread(1.0), x, int(abs(exponent))
    while left > 0:
        if left & 1:
            result = result * factor
        factor = factor * factor
        left >>= 1
    return spread(1.0) / result if exponent < 0.0 else result


@kernel
def _put_one(operation: int, exponent: float, registers: FloatArray, i: int, n: int, blocks: int) -> None:
    """Carry out what has one operand, and no lanes but for powers that are products."""
    v = place_of(registers)
    if operation == 6 and abs(exponent) <= _LARGEST_PRODUCT and exponent == math.floor(exponent):
        for m in range(blocks):
            put(v, n * ROWS + m, _whole_power(take(v, i * ROWS + m), exponent))
        return
    for m in range(blocks * LANES):
        x = registers[i, m]
        if operation == 6:
            registers[n, m] = power(x, exponent)
        else:
            registers[n, m], _ = call(operation, x)


@kernel
def _put_two(operation: int, registers: FloatArray, i: int, j: int, n: int, blocks: int) -> None:
    """Carry out what has two operands."""
    v = place_of(registers)
    if operation == 7:
        for m in range(blocks * LANES):
            x = registers[i, m]
            registers[n, m] = x ** registers[j, m] if x > 0.0 else math.nan
        return
    for m in range(blocks):
        x, y = take(v, i * ROWS + m), take(v, j * ROWS + m)
        if operation == 1:
            put(v, n * ROWS + m, x + y)
        elif operation == 2:
            put(v, n * ROWS + m, x - y)
        elif operation == 3:
            put(v, n * ROWS + m, x * y)
        else:
            put(v, n * ROWS + m, x / y)


@kernel
def integrals_at(
    formula: Formula,
    moments: FloatArray,
    registers: FloatArray,
    states: FloatArray,
    integrals: FloatArray,
    count: int,
) -> None:
    """Fill in energy, areas and the square of γ, shape (3, WIDTH), at ``count`` states, the first rows.

    ``registers`` has the shape (3 + instructions, WIDTH). What is found at the states after these, up to a
    multiple of ``LANES``, is nothing.
    """
    v, u, found = place_of(registers), place_of(states), place_of(integrals)
    blocks = (count + LANES - 1) // LANES
    for row in range(3):
        for m in range(blocks):
            put(v, row * ROWS + m, take(u, (3 + row) * ROWS + m))
    for k in range(formula.code.shape[0]):
        operation, i, j = formula.code[k, 0], formula.code[k, 1], formula.code[k, 2]
        slot, n = formula.code[k, 3], 3 + k
        if operation == 0:
            for m in range(blocks):
                put(v, n * ROWS + m, spread(formula.constants[slot]))
        elif operation == 5:
            for m in range(blocks):
                put(v, n * ROWS + m, spread(0.0) - take(v, i * ROWS + m))
        elif operation == 6 or operation >= 8:
            _put_one(operation, formula.constants[slot] if slot >= 0 else 1.0, registers, i, n, blocks)
        else:
            _put_two(operation, registers, i, j, n, blocks)
    for m in range(blocks):
        energy, areas, length = take(v, formula.result * ROWS + m), spread(0.0), spread(0.0)
        for a in range(STATE // 2):
            omega, gamma = take(u, a * ROWS + m), take(u, (3 + a) * ROWS + m)
            momentum = spread(moments[a]) * omega
            energy = energy + spread(0.5) * (momentum * omega)
            areas = areas + momentum * gamma
            length = length + gamma * gamma
        put(found, m, energy)
        put(found, ROWS + m, areas)
        put(found, 2 * ROWS + m, length)
