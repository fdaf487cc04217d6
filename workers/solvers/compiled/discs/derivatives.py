"""D = g1 V_3 − g3 V_1 of a formula on discs, by its program.

The loop is not :func:`.interpreter.interpreter`'s: here a number is a whole row, with one power of the scale.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.discs.arithmetic import (
    FIRST_FREE,
    POWERS,
    add,
    function,
    invert,
    multiply,
    raise_to,
)
from workers.solvers.compiled.evaluation.program import (
    ADD,
    CONSTANT,
    DIVIDE,
    MULTIPLY,
    NEGATE,
    POWER,
    SUBTRACT,
)
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.records import Formula
from workers.solvers.compiled.workspace import LANES

FloatArray = NDArray[np.float64]

G = FIRST_FREE
"""The rows of g1, g2, g3; then those of the instructions."""
INVERSE = FIRST_FREE - 3
"""Scratch that :mod:`.arithmetic` does not use."""
OWN = 2.0**-52
"""More than the rounding of a constant."""


@kernel
def disc_derivative(formula: Formula, count: int) -> int:
    """Return the row of D; the scale and the rows of g1, g2, g3 are filled in."""
    code, constants = formula.turn.code, formula.constants
    c, r, e = formula.centres, formula.radii, formula.powers
    for k in range(1, 1 + POWERS):
        e[k] = 0.0
    for k in range(code.shape[0]):
        operation, slot, to = code[k, 0], code[k, 3], G + 3 + k
        i, j = G + code[k, 1], G + code[k, 2]
        known = constants[slot] if slot >= 0 else 0.0
        if operation == CONSTANT:
            value = known + code[k, 2]
            for m in range(LANES):
                c[to, m], r[to, m] = value, (abs(value) + abs(known)) * OWN
            e[to] = 0.0 if slot >= 0 or value != 0.0 else math.nan
        elif operation == MULTIPLY:
            multiply(c, r, e, to, i, j)
        elif operation == ADD:
            add(c, r, e, to, i, j, 1.0, count)
        elif operation == SUBTRACT:
            add(c, r, e, to, i, j, -1.0, count)
        elif operation == DIVIDE:
            invert(c, r, e, INVERSE, j)
            multiply(c, r, e, to, i, INVERSE)
        elif operation == NEGATE:
            for m in range(LANES):
                c[to, m], r[to, m] = -c[i, m], r[i, m]
            e[to] = e[i]
        elif operation == POWER:
            raise_to(c, r, e, to, i, known + code[k, 2], count)
        else:
            function(operation, c, r, e, to, i, count)
    D: int = G + formula.turn.results[0]
    return D
