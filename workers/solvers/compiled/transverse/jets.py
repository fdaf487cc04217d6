r"""V with four of its derivatives at many points, each with a first-order bound of its rounding.

The derivatives are those that Hill's equation needs: with g1 = √ρ cos φ, g3 = √ρ sin φ and g2 kept, the first
and the second in φ, and the first along a field Y on the sphere. Errors are absolute, in units of 2^-53; the
interpreter is that of :mod:`compiled.evaluation.interpreter`, with more numbers to each register.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.evaluation.interpreter import power
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import Formula
from workers.solvers.compiled.transverse.functions import derivatives_of_call

FloatArray = NDArray[np.float64]

WIDTH = 16
"""Points that are gone through together."""
V, D, E, Y, V_ERROR, D_ERROR, E_ERROR, Y_ERROR = range(8)
"""Parts of the registers: V, ∂V/∂φ, ∂²V/∂φ², the derivative along Y, and the bounds of their errors."""


@inlined
def _of_product(a: float, a_error: float, b: float, b_error: float) -> float:
    """Return the error of a product, its own rounding included."""
    return abs(a) * b_error + a_error * abs(b) + abs(a * b)


@kernel
def evaluate_jets(formula: Formula, jets: FloatArray) -> None:
    """Fill in ``jets``, shape (8, registers, WIDTH); those of g1, g2 and g3 are given."""
    code, constants = formula.code, formula.constants
    for k in range(code.shape[0]):
        operation, i, j, slot, n = code[k, 0], code[k, 1], code[k, 2], code[k, 3], 3 + k
        if operation == 0:
            for part in range(8):
                for m in range(WIDTH):
                    jets[part, n, m] = 0.0
            for m in range(WIDTH):
                jets[V, n, m], jets[V_ERROR, n, m] = constants[slot], abs(constants[slot])
        elif operation == 1:
            _sum(jets, i, j, n, 1.0)
        elif operation == 2:
            _sum(jets, i, j, n, -1.0)
        elif operation == 3:
            _product(jets, i, j, n)
        elif operation == 4:
            _quotient(jets, i, j, n)
        elif operation == 5:
            for part in range(4):
                for m in range(WIDTH):
                    jets[part, n, m] = -jets[part, i, m]
                    jets[4 + part, n, m] = jets[4 + part, i, m]
        elif operation == 6:
            _power(jets, i, n, constants[slot])
        elif operation == 7:
            # A power that is no number: rare, and left to balls.
            for part in range(8):
                for m in range(WIDTH):
                    jets[part, n, m] = math.nan
        else:
            _call(jets, operation, i, n)


@inlined
def _sum(jets: FloatArray, i: int, j: int, n: int, sign: float) -> None:
    for part in range(4):
        for m in range(WIDTH):
            value = jets[part, i, m] + sign * jets[part, j, m]
            jets[part, n, m] = value
            jets[4 + part, n, m] = jets[4 + part, i, m] + jets[4 + part, j, m] + abs(value)


@kernel
def _product(jets: FloatArray, i: int, j: int, n: int) -> None:
    for m in range(WIDTH):
        x, x1, x2, xy = jets[V, i, m], jets[D, i, m], jets[E, i, m], jets[Y, i, m]
        a, a1, a2, ay = jets[V_ERROR, i, m], jets[D_ERROR, i, m], jets[E_ERROR, i, m], jets[Y_ERROR, i, m]
        y, y1, y2, yy = jets[V, j, m], jets[D, j, m], jets[E, j, m], jets[Y, j, m]
        b, b1, b2, by = jets[V_ERROR, j, m], jets[D_ERROR, j, m], jets[E_ERROR, j, m], jets[Y_ERROR, j, m]
        first, second, along = x * y1 + x1 * y, x * y2 + 2.0 * (x1 * y1) + x2 * y, x * yy + xy * y
        jets[V, n, m], jets[D, n, m], jets[E, n, m], jets[Y, n, m] = x * y, first, second, along
        jets[V_ERROR, n, m] = _of_product(x, a, y, b)
        jets[D_ERROR, n, m] = _of_product(x, a, y1, b1) + _of_product(x1, a1, y, b) + abs(first)
        jets[E_ERROR, n, m] = (
            _of_product(x, a, y2, b2)
            + 3.0 * _of_product(x1, a1, y1, b1)
            + _of_product(x2, a2, y, b)
            + 2.0 * abs(second)
        )
        jets[Y_ERROR, n, m] = _of_product(x, a, yy, by) + _of_product(xy, ay, y, b) + abs(along)


@kernel
def _quotient(jets: FloatArray, i: int, j: int, n: int) -> None:
    """V = x/y: (v y)' = x' and (v y)'' = x'' are solved for v' and v''."""
    for m in range(WIDTH):
        x, x1, x2, xy = jets[V, i, m], jets[D, i, m], jets[E, i, m], jets[Y, i, m]
        a, a1, a2, ay = jets[V_ERROR, i, m], jets[D_ERROR, i, m], jets[E_ERROR, i, m], jets[Y_ERROR, i, m]
        y, y1, y2, yy = jets[V, j, m], jets[D, j, m], jets[E, j, m], jets[Y, j, m]
        b, b1, b2, by = jets[V_ERROR, j, m], jets[D_ERROR, j, m], jets[E_ERROR, j, m], jets[Y_ERROR, j, m]
        v = x / y
        first, along = (x1 - y1 * v) / y, (xy - yy * v) / y
        second = (x2 - 2.0 * (y1 * first) - y2 * v) / y
        size = abs(y)
        v_error = (a + abs(v) * b) / size + abs(v)
        over, rest = _of_product(y1, b1, v, v_error), abs(x1 - y1 * v)
        first_error = (a1 + over + rest + abs(first) * b) / size + abs(first)
        over, rest = _of_product(yy, by, v, v_error), abs(xy - yy * v)
        along_error = (ay + over + rest + abs(along) * b) / size + abs(along)
        over = 3.0 * _of_product(y1, b1, first, first_error) + _of_product(y2, b2, v, v_error)
        rest = abs(x2) + 2.0 * abs(y1 * first) + abs(y2 * v)
        jets[V, n, m], jets[D, n, m], jets[E, n, m], jets[Y, n, m] = v, first, second, along
        jets[V_ERROR, n, m], jets[D_ERROR, n, m], jets[Y_ERROR, n, m] = v_error, first_error, along_error
        jets[E_ERROR, n, m] = (a2 + over + 2.0 * rest + abs(second) * b) / size + abs(second)


@inlined
def _chain(
    jets: FloatArray, i: int, n: int, m: int, f: tuple[float, float, float], e: tuple[float, float, float]
) -> None:
    """Fill in a function of register i with the values of f, f' and f'' there, and their errors."""
    x1, x2, xy = jets[D, i, m], jets[E, i, m], jets[Y, i, m]
    a1, a2, ay = jets[D_ERROR, i, m], jets[E_ERROR, i, m], jets[Y_ERROR, i, m]
    square = x1 * x1
    # What does not vary has no derivatives, also where those of the function are infinite.
    first = f[1] * x1 if x1 != 0.0 else 0.0
    along = f[1] * xy if xy != 0.0 else 0.0
    second = (f[2] * square if x1 != 0.0 else 0.0) + (f[1] * x2 if x2 != 0.0 else 0.0)
    jets[V, n, m], jets[D, n, m], jets[E, n, m], jets[Y, n, m] = f[0], first, second, along
    jets[V_ERROR, n, m] = e[0]
    jets[D_ERROR, n, m] = _of_product(f[1], e[1], x1, a1) if x1 != 0.0 or a1 != 0.0 else 0.0
    jets[Y_ERROR, n, m] = _of_product(f[1], e[1], xy, ay) if xy != 0.0 or ay != 0.0 else 0.0
    by_slope = _of_product(f[2], e[2], square, 2.0 * abs(x1) * a1 + square) if a1 + abs(x1) != 0.0 else 0.0
    by_bend = _of_product(f[1], e[1], x2, a2) if a2 + abs(x2) != 0.0 else 0.0
    jets[E_ERROR, n, m] = by_slope + by_bend + abs(second)


@kernel
def _power(jets: FloatArray, i: int, n: int, exponent: float) -> None:
    for m in range(WIDTH):
        x, s = jets[V, i, m], exponent
        off = jets[V_ERROR, i, m] / abs(x)
        v = power(x, s)
        first, own = s * v / x, abs(s) + 3.0
        if s != math.floor(s):
            own += abs(s * math.log(abs(x)))  # the exponent's own rounding
        second = (s - 1.0) * first / x
        errors = (
            abs(v) * (abs(s) * off + own),
            abs(first) * (abs(s - 1.0) * off + own + 3.0),
            abs(second) * (abs(s - 2.0) * off + own + 6.0),
        )
        _chain(jets, i, n, m, (v, first, second), errors)


@kernel
def _call(jets: FloatArray, operation: int, i: int, n: int) -> None:
    for m in range(WIDTH):
        f, third, own = derivatives_of_call(operation, jets[V, i, m])
        off = jets[V_ERROR, i, m]
        errors = (
            abs(f[1]) * off + own[0],
            abs(f[2]) * off + own[1],
            abs(third) * off + own[2],
        )
        _chain(jets, i, n, m, f, errors)
