"""D = g1 V_3 − g3 V_1 of a formula on discs, by forward differentiation with the arithmetic of discs."""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.discs.arithmetic import (
    FIRST_FREE,
    POWERS,
    TINY,
    add,
    function,
    invert,
    multiply,
    raise_to,
)
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.records import Formula
from workers.solvers.compiled.workspace import LANES

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

G = FIRST_FREE
"""The rows of g1, g2, g3, each followed by that of its slope; then those of the instructions."""
ONE, OTHER, RISE = FIRST_FREE - 5, FIRST_FREE - 4, FIRST_FREE - 3
"""Scratch that :mod:`.arithmetic` does not use."""
OWN = 2.0**-52
"""More than the rounding of a constant."""


@kernel
def disc_derivative(
    formula: Formula,
    count: int,
) -> int:
    """Return the row of D; the scale and the rows of g1, g2, g3 (without slopes) are filled in."""
    code, constants = formula.code, formula.constants
    c, r, e = formula.centres, formula.radii, formula.powers
    for k in range(1, 1 + POWERS):
        e[k] = 0.0
    for m in range(LANES):
        c[G + 1, m], r[G + 1, m] = -c[G + 4, m], r[G + 4, m]
        c[G + 5, m], r[G + 5, m] = c[G, m], r[G, m]
    e[G + 1], e[G + 3], e[G + 5] = e[G + 4], math.nan, e[G]
    for k in range(code.shape[0]):
        operation, slot, to = code[k, 0], code[k, 3], G + 6 + 2 * k
        i, j = G + 2 * code[k, 1], G + 2 * code[k, 2]
        if operation == 0:
            for m in range(LANES):
                c[to, m], r[to, m] = constants[slot], abs(constants[slot]) * OWN
            e[to], e[to + 1] = 0.0, math.nan
        elif operation == 1 or operation == 2:
            sign = 1.0 if operation == 1 else -1.0
            add(c, r, e, to, i, j, sign, count)
            add(c, r, e, to + 1, i + 1, j + 1, sign, count)
        elif operation == 3:
            multiply(c, r, e, to, i, j)
            _slope_of_product(c, r, e, to + 1, i, j, count)
        elif operation == 4:
            _divide(c, r, e, to, i, j, count)
        elif operation == 5:
            for m in range(LANES):
                c[to, m], r[to, m] = -c[i, m], r[i, m]
                c[to + 1, m], r[to + 1, m] = -c[i + 1, m], r[i + 1, m]
            e[to], e[to + 1] = e[i], e[i + 1]
        elif operation == 6:
            _power(c, r, e, to, i, constants[slot], count)
        elif operation == 7:
            _general_power(c, r, e, to, i, j, count)
        else:
            function(operation, c, r, e, to, RISE, i, count)
            multiply(c, r, e, to + 1, RISE, i + 1)
            if operation == 14:
                # A sign is no constant where it may jump.
                for m in range(count):
                    c[to + 1, m], r[to + 1, m] = 0.0, r[to, m]
                e[to + 1] = e[i + 1]
    return G + 2 * formula.result + 1


@kernel
def _slope_of_product(
    c: FloatArray, r: FloatArray, e: FloatArray, to: int, i: int, j: int, count: int
) -> None:
    if math.isnan(e[j + 1]):
        multiply(c, r, e, to, i + 1, j)
    elif math.isnan(e[i + 1]):
        multiply(c, r, e, to, i, j + 1)
    else:
        multiply(c, r, e, ONE, i, j + 1)
        multiply(c, r, e, OTHER, i + 1, j)
        add(c, r, e, to, ONE, OTHER, 1.0, count)


@kernel
def _divide(c: FloatArray, r: FloatArray, e: FloatArray, to: int, i: int, j: int, count: int) -> None:
    """x/y and (x' − (x/y) y')/y."""
    invert(c, r, e, RISE, j)
    multiply(c, r, e, to, i, RISE)
    if math.isnan(e[j + 1]):
        multiply(c, r, e, to + 1, i + 1, RISE)
        return
    multiply(c, r, e, ONE, to, j + 1)
    add(c, r, e, OTHER, i + 1, ONE, -1.0, count)
    multiply(c, r, e, to + 1, OTHER, RISE)


@kernel
def _power(c: FloatArray, r: FloatArray, e: FloatArray, to: int, i: int, exponent: float, count: int) -> None:
    raise_to(c, r, e, to, i, exponent, count)
    if math.isnan(e[i + 1]):
        e[to + 1] = math.nan
        return
    raise_to(c, r, e, RISE, i, exponent - 1.0, count)
    for m in range(LANES):
        c[RISE, m] *= exponent
        r[RISE, m] = (r[RISE, m] * abs(exponent) + 2.0 * abs(c[RISE, m]) * OWN) * (1.0 + 2.0 * OWN) + TINY
    multiply(c, r, e, to + 1, RISE, i + 1)


@kernel
def _general_power(c: FloatArray, r: FloatArray, e: FloatArray, to: int, i: int, j: int, count: int) -> None:
    """x^y = exp(y log x), and its slope x^y (y' log x + y x'/x)."""
    function(9, c, r, e, ONE, RISE, i, count)
    multiply(c, r, e, OTHER, RISE, i + 1)
    multiply(c, r, e, RISE, OTHER, j)
    multiply(c, r, e, OTHER, ONE, j + 1)
    add(c, r, e, to + 1, RISE, OTHER, 1.0, count)
    multiply(c, r, e, OTHER, ONE, j)
    function(8, c, r, e, ONE, RISE, OTHER, count)
    for m in range(count):
        c[to, m], r[to, m] = c[ONE, m], r[ONE, m]
    e[to] = e[ONE]
    multiply(c, r, e, OTHER, to + 1, ONE)
    for m in range(count):
        c[to + 1, m], r[to + 1, m] = c[OTHER, m], r[OTHER, m]
    e[to + 1] = e[OTHER]
