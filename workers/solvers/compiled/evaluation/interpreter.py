"""The loop over the operations of a program, for any arithmetic; that of doubles, without and with bounds.

Every instruction is carried out at all points before the next: what it costs to read a program is shared, and
plain arithmetic goes through several points at once. Each point has the digits it has alone. An arithmetic
states its eight operations on numbers of its own; whole powers are products in each of them.
"""

import math
from collections.abc import Callable
from typing import Final, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.evaluation.program import (
    ABS,
    ADD,
    CONSTANT,
    COS,
    DIVIDE,
    EXP,
    LOG,
    MULTIPLY,
    NEGATE,
    POWER,
    SIN,
    SUBTRACT,
    TAN,
)
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import Formula

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
T = TypeVar("T")

LARGEST_PRODUCT: Final = 64.0
"""Whole powers up to this one are products."""
Run = Callable[[IntArray, FloatArray, FloatArray, FloatArray, int], None]
"""Fills in the registers of a program at some points, given the code, the constants, their low parts, and the
number of points. Registers have the shape (parts of a number, 4 + instructions, at least so many); those of
g1, g2 and g3 are there, and the last is scratch."""


class CompiledArithmetic(NamedTuple, Generic[T]):
    """Kernels that compute with numbers of a kind; what is undefined is the kind's NaN."""

    get: Callable[[FloatArray, int, int], T]
    put: Callable[[FloatArray, int, int, T], None]
    """Read and write a register at a point."""
    number: Callable[[FloatArray, FloatArray, int, int], T]
    """Returns a constant, of the constants and their low parts by its place (-1: 0), and an integer more."""
    add: Callable[[T, T], T]
    subtract: Callable[[T, T], T]
    multiply: Callable[[T, T], T]
    divide: Callable[[T, T], T]
    negate: Callable[[T], T]
    power: Callable[[T, T], T]
    """Returns the power to a number that is not whole, or is large."""
    call: Callable[[int, T], T]
    """Returns a function, numbered as in :mod:`.program`."""
    inverts_first: bool = False
    """Whether 1/x^n is (1/x)^n, which is narrower where x is a disc, and rounded more often."""


def interpreter(arithmetic: CompiledArithmetic[T], module: str, name: str) -> Run:
    """Return the loop over a program's operations in an arithmetic, which gets this name in a module."""
    get, put, number, add, subtract, multiply, divide, negate, power, call, inverts_first = arithmetic

    def run(
        code: IntArray, constants: FloatArray, lows: FloatArray, registers: FloatArray, count: int
    ) -> None:
        free = registers.shape[1] - 1
        # No views of single registers: making them takes longer than the arithmetic.
        for k in range(code.shape[0]):
            operation, i, j, slot, n = code[k, 0], code[k, 1], code[k, 2], code[k, 3], 3 + k
            if operation == MULTIPLY:
                for m in range(count):
                    put(registers, n, m, multiply(get(registers, i, m), get(registers, j, m)))
            elif operation == ADD:
                for m in range(count):
                    put(registers, n, m, add(get(registers, i, m), get(registers, j, m)))
            elif operation == SUBTRACT:
                for m in range(count):
                    put(registers, n, m, subtract(get(registers, i, m), get(registers, j, m)))
            elif operation == DIVIDE:
                for m in range(count):
                    put(registers, n, m, divide(get(registers, i, m), get(registers, j, m)))
            elif operation == NEGATE:
                for m in range(count):
                    put(registers, n, m, negate(get(registers, i, m)))
            elif operation == CONSTANT:
                exact = number(constants, lows, slot, j)
                for m in range(count):
                    put(registers, n, m, exact)
            elif operation == POWER:
                exact = number(constants, lows, slot, j)
                exponent = (constants[slot] if slot >= 0 else 0.0) + j
                is_exact = slot < 0 or len(lows) == 0 or lows[slot] == 0.0
                if is_exact and exponent == math.floor(exponent) and abs(exponent) <= LARGEST_PRODUCT:
                    left, is_begun, one = int(abs(exponent)), False, number(constants, lows, -1, 1)
                    for m in range(count):
                        x = get(registers, i, m)
                        put(registers, free, m, divide(one, x) if inverts_first and exponent < 0.0 else x)
                        put(registers, n, m, one)
                    while left:
                        if left & 1 and is_begun:
                            for m in range(count):
                                put(registers, n, m, multiply(get(registers, n, m), get(registers, free, m)))
                        elif left & 1:
                            for m in range(count):
                                put(registers, n, m, get(registers, free, m))
                            is_begun = True
                        left >>= 1
                        if left:
                            for m in range(count):
                                square = multiply(get(registers, free, m), get(registers, free, m))
                                put(registers, free, m, square)
                    if exponent < 0.0 and not inverts_first:
                        for m in range(count):
                            put(registers, n, m, divide(one, get(registers, n, m)))
                else:
                    for m in range(count):
                        put(registers, n, m, power(get(registers, i, m), exact))
            elif operation >= EXP:
                for m in range(count):
                    put(registers, n, m, call(operation, get(registers, i, m)))
            else:
                for m in range(count):
                    logarithm = call(LOG, get(registers, i, m))
                    put(registers, n, m, call(EXP, multiply(get(registers, j, m), logarithm)))

    # Its code is found by these, and is made of what the module imports.
    run.__module__, run.__name__, run.__qualname__ = module, name, name
    return kernel(run)


@kernel
def power(base: float, exponent: float) -> float:
    """Return base^exponent by multiplications for a small integer; NaN where undefined."""
    size = abs(exponent)
    if size == 0.5:
        found = math.sqrt(base) if base >= 0.0 else math.nan
        return found if exponent > 0.0 else 1.0 / found
    if size <= LARGEST_PRODUCT and size == math.floor(size):
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
def call(operation: int, x: float) -> float:
    """Return a function, numbered as in :mod:`.program`."""
    if operation == EXP:
        return math.exp(x)
    if operation == LOG:
        return math.log(x) if x > 0.0 else math.nan
    if operation == SIN:
        return math.sin(x)
    if operation == COS:
        return math.cos(x)
    if operation == TAN:
        return math.tan(x)
    if operation == ABS:
        return abs(x)
    return 1.0 if x > 0.0 else -1.0 if x < 0.0 else 0.0


@inlined
def _get(registers: FloatArray, n: int, m: int) -> float:
    return float(registers[0, n, m])


@inlined
def _put(registers: FloatArray, n: int, m: int, x: float) -> None:
    registers[0, n, m] = x


@inlined
def _number(constants: FloatArray, _lows: FloatArray, slot: int, more: int) -> float:
    return (constants[slot] if slot >= 0 else 0.0) + more


@inlined
def _add(x: float, y: float) -> float:
    return x + y


@inlined
def _subtract(x: float, y: float) -> float:
    return x - y


@inlined
def _multiply(x: float, y: float) -> float:
    return x * y


@inlined
def _divide(x: float, y: float) -> float:
    return x / y


@inlined
def _negate(x: float) -> float:
    return -x


run_double = interpreter(
    CompiledArithmetic(_get, _put, _number, _add, _subtract, _multiply, _divide, _negate, power, call),
    __name__,
    "run_double",
)

Bounded = tuple[float, float]
"""A double, and the bound of its error in units of 2^-53 (first order)."""


@inlined
def _get_bounded(registers: FloatArray, n: int, m: int) -> Bounded:
    return registers[0, n, m], registers[1, n, m]


@inlined
def _put_bounded(registers: FloatArray, n: int, m: int, x: Bounded) -> None:
    registers[0, n, m], registers[1, n, m] = x


@inlined
def _number_bounded(constants: FloatArray, lows: FloatArray, slot: int, more: int) -> Bounded:
    value = _number(constants, lows, slot, more)
    return value, (abs(value) + abs(constants[slot]) if slot >= 0 else 0.0)


@inlined
def _add_bounded(x: Bounded, y: Bounded) -> Bounded:
    value = x[0] + y[0]
    return value, x[1] + y[1] + abs(value)


@inlined
def _subtract_bounded(x: Bounded, y: Bounded) -> Bounded:
    value = x[0] - y[0]
    return value, x[1] + y[1] + abs(value)


@inlined
def _multiply_bounded(x: Bounded, y: Bounded) -> Bounded:
    value = x[0] * y[0]
    return value, abs(x[0]) * y[1] + x[1] * abs(y[0]) + abs(value)


@inlined
def _divide_bounded(x: Bounded, y: Bounded) -> Bounded:
    value = x[0] / y[0]
    return value, (x[1] + abs(value) * y[1]) / abs(y[0]) + abs(value)


@inlined
def _negate_bounded(x: Bounded) -> Bounded:
    return -x[0], x[1]


@kernel
def _power_bounded(x: Bounded, exponent: Bounded) -> Bounded:
    value = power(x[0], exponent[0])
    own = 2.0
    if x[0] != 0.0:
        own += abs(exponent[0]) * x[1] / abs(x[0]) + exponent[1] * abs(math.log(abs(x[0])))
    return value, abs(value) * own


@kernel
def _call_bounded(operation: int, x: Bounded) -> Bounded:
    value = call(operation, x[0])
    if operation > ABS:
        # Where the sign may be another, its error is no small one.
        return value, 0.0 if abs(x[0]) > x[1] * 2.0**-53 else math.inf
    slope = 1.0
    if operation == EXP:
        slope = value
    elif operation == LOG:
        slope = 1.0 / x[0]
    elif operation == SIN:
        slope = math.cos(x[0])
    elif operation == COS:
        slope = math.sin(x[0])
    elif operation == TAN:
        slope = 1.0 + value * value
    return value, abs(slope) * x[1] + 2.0 * abs(value)


run_bounded = interpreter(
    CompiledArithmetic(
        _get_bounded,
        _put_bounded,
        _number_bounded,
        _add_bounded,
        _subtract_bounded,
        _multiply_bounded,
        _divide_bounded,
        _negate_bounded,
        _power_bounded,
        _call_bounded,
    ),
    __name__,
    "run_bounded",
)


@kernel
def new_registers(code: IntArray, parts: int, width: int) -> FloatArray:
    """Return the registers on which a program is run."""
    return np.empty((parts, code.shape[0] + 4, width))


@kernel
def derivative(
    formula: Formula, first: FloatArray, second: FloatArray, third: FloatArray, count: int
) -> FloatArray:
    """Return D = g1 V_3 − g3 V_1 at ``count`` ≤ POINTS points with these g1, g2 and g3: a register."""
    registers = formula.registers
    for m in range(count):
        registers[0, 0, m], registers[0, 1, m], registers[0, 2, m] = first[m], second[m], third[m]
    run_double(formula.turn.code, formula.constants, formula.lows, registers, count)
    D: FloatArray = registers[0, formula.turn.results[0], :count]
    return D


@kernel
def derivative_with_bound(
    formula: Formula, first: FloatArray, second: FloatArray, third: FloatArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """Return D and the bound of its rounding in units of 2^-53 (first order), inputs being a few ulp off."""
    registers = formula.registers
    for m in range(count):
        registers[0, 0, m], registers[0, 1, m], registers[0, 2, m] = first[m], second[m], third[m]
        for k in range(3):
            registers[1, k, m] = 2.0 * abs(registers[0, k, m])
    run_bounded(formula.turn.code, formula.constants, formula.lows, registers, count)
    D = formula.turn.results[0]
    return registers[0, D, :count], registers[1, D, :count]
