"""The loop over the operations of a program, for any arithmetic; that of doubles, without and with bounds.

Every instruction is carried out at all points before the next: what it costs to read a program is shared, and
plain arithmetic goes through several points at once. Each point has the digits it has alone. An arithmetic
states its operations on numbers of its own, or on whole registers where the points of one have something in
common; whole powers are products in each of them.
"""

import math
import operator
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
    GENERAL_POWER,
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
R = TypeVar("R")
F = TypeVar("F", bound=Callable[..., object])

COPY: Final = -1
LARGEST_PRODUCT: Final = 64.0
"""Whole powers up to this one are products."""
Run = Callable[[IntArray, FloatArray, FloatArray, R, int], None]
"""Fills in the registers of a program, given the code, the constants, their low parts, the registers, and
the number of points. Those of g1, g2 and g3 are there, and behind those of the instructions are two more."""


class Constant(NamedTuple):
    """A number of a program, as kernels see it."""

    constants: FloatArray
    lows: FloatArray
    """Low parts that the doubles of the constants leave out."""
    slot: int
    """The place among these, -1 for 0."""
    more: int
    """An integer that is added."""


class RowArithmetic(NamedTuple, Generic[R]):
    """Kernels that fill a whole register from others, told by their numbers; these may be the same one."""

    number: Callable[[R, int, Constant, int], None]
    add: Callable[[R, int, int, int, int], None]
    subtract: Callable[[R, int, int, int, int], None]
    multiply: Callable[[R, int, int, int, int], None]
    divide: Callable[[R, int, int, int, int], None]
    power: Callable[[R, int, int, Constant, int], None]
    """Puts the power to a number that is not whole, or is large."""
    apply: Callable[[R, int, int, int, int], None]
    """Puts a register itself (COPY), its opposite, or a function of it, numbered as in :mod:`.program`."""
    inverts_first: bool = False
    """Whether 1/x^n is (1/x)^n, which is narrower where x is a disc, and rounded more often."""


class CompiledArithmetic(NamedTuple, Generic[T]):
    """Kernels that compute with numbers of a kind; what is undefined is the kind's NaN."""

    get: Callable[[FloatArray, int, int], T]
    put: Callable[[FloatArray, int, int, T], None]
    """Read and write a register at a point; the shape is (parts of a number, registers, points)."""
    number: Callable[[Constant], T]
    add: Callable[[T, T], T]
    multiply: Callable[[T, T], T]
    divide: Callable[[T, T], T]
    negate: Callable[[T], T]
    power: Callable[[T, T], T]
    call: Callable[[int, T], T]
    inverts_first: bool = False
    """Powers and inverses are as in :class:`RowArithmetic`."""


@inlined
def _unused(n: int, free: int, product: int, factor: int) -> int:
    """Return one of three registers that is none of two others."""
    if free not in (product, factor):
        return free
    return n if n not in (product, factor) else free + 1


def interpreter(rows: RowArithmetic[R], module: str, name: str) -> Run[R]:
    """Return the loop over a program's operations in an arithmetic, which gets this name in a module."""
    number, add, subtract, multiply, divide, power, apply, inverts_first = rows

    def run(code: IntArray, constants: FloatArray, lows: FloatArray, registers: R, count: int) -> None:
        free, one = 3 + code.shape[0], Constant(constants, lows, -1, 1)
        for k in range(code.shape[0]):
            operation, i, j, slot, n = code[k, 0], code[k, 1], code[k, 2], code[k, 3], 3 + k
            if operation == MULTIPLY:
                multiply(registers, n, i, j, count)
            elif operation == ADD:
                add(registers, n, i, j, count)
            elif operation == SUBTRACT:
                subtract(registers, n, i, j, count)
            elif operation == DIVIDE:
                divide(registers, n, i, j, count)
            elif operation == CONSTANT:
                number(registers, n, Constant(constants, lows, slot, j), count)
            elif operation == POWER:
                exponent = (constants[slot] if slot >= 0 else 0.0) + j
                is_exact = slot < 0 or len(lows) == 0 or lows[slot] == 0.0
                if is_exact and exponent == math.floor(exponent) and abs(exponent) <= LARGEST_PRODUCT:
                    left, factor, product = int(abs(exponent)), i, -1
                    is_inverse = exponent < 0.0
                    if inverts_first and is_inverse:
                        number(registers, n, one, count)
                        divide(registers, free, n, i, count)
                        factor, is_inverse = free, False
                    # No register is filled from itself but where none is left: that goes number by number.
                    while left:
                        if left & 1:
                            if product >= 0:
                                to = n if left == 1 and not is_inverse else _unused(n, free, product, factor)
                                multiply(registers, to, product, factor, count)
                                product = to
                            else:
                                product = factor
                        left >>= 1
                        if left:
                            is_last = left == 1 and product < 0 and not is_inverse
                            to = n if is_last else _unused(n, free, product, factor)
                            multiply(registers, to, factor, factor, count)
                            factor = to
                    if product < 0:
                        number(registers, n, one, count)
                    elif is_inverse:
                        to = _unused(n, free, product, n)
                        number(registers, to, one, count)
                        divide(registers, n, to, product, count)
                    elif product != n:
                        apply(registers, n, product, COPY, count)
                else:
                    power(registers, n, i, Constant(constants, lows, slot, j), count)
            elif operation == GENERAL_POWER:
                apply(registers, free, i, LOG, count)
                multiply(registers, free, j, free, count)
                apply(registers, n, free, EXP, count)
            else:
                apply(registers, n, i, operation, count)

    return kernel(named(run, module, name))


def named(function: F, module: str, name: str) -> F:
    """Return a function under the name by which its code is found, with what that module imports."""
    function.__module__, function.__name__, function.__qualname__ = module, name, name
    return function


def interpreter_of(arithmetic: CompiledArithmetic[T], module: str, name: str) -> Run[FloatArray]:
    """Return :func:`interpreter` in an arithmetic of numbers, which is gone through point by point."""
    get, put, number, add, multiply, divide, negate, power, call, inverts_first = arithmetic

    # No views of single registers: making them takes longer than the arithmetic.
    def put_number(registers: FloatArray, to: int, constant: Constant, count: int) -> None:
        exact = number(constant)
        for m in range(count):
            put(registers, to, m, exact)

    def put_sum(registers: FloatArray, to: int, i: int, j: int, count: int) -> None:
        for m in range(count):
            put(registers, to, m, add(get(registers, i, m), get(registers, j, m)))

    def put_difference(registers: FloatArray, to: int, i: int, j: int, count: int) -> None:
        for m in range(count):
            put(registers, to, m, add(get(registers, i, m), negate(get(registers, j, m))))

    def put_product(registers: FloatArray, to: int, i: int, j: int, count: int) -> None:
        for m in range(count):
            put(registers, to, m, multiply(get(registers, i, m), get(registers, j, m)))

    def put_quotient(registers: FloatArray, to: int, i: int, j: int, count: int) -> None:
        for m in range(count):
            put(registers, to, m, divide(get(registers, i, m), get(registers, j, m)))

    def put_power(registers: FloatArray, to: int, i: int, constant: Constant, count: int) -> None:
        exponent = number(constant)
        for m in range(count):
            put(registers, to, m, power(get(registers, i, m), exponent))

    def put_function(registers: FloatArray, to: int, i: int, operation: int, count: int) -> None:
        if operation == COPY:
            for m in range(count):
                put(registers, to, m, get(registers, i, m))
        elif operation == NEGATE:
            for m in range(count):
                put(registers, to, m, negate(get(registers, i, m)))
        else:
            for m in range(count):
                put(registers, to, m, call(operation, get(registers, i, m)))

    def inside(function: F) -> F:
        return inlined(named(function, module, f"{name}_{function.__name__}"))

    rows = RowArithmetic(
        inside(put_number),
        inside(put_sum),
        inside(put_difference),
        inside(put_product),
        inside(put_quotient),
        inside(put_power),
        inside(put_function),
        inverts_first,
    )
    return interpreter(rows, module, name)


@inlined
def get_pair(registers: FloatArray, n: int, m: int) -> tuple[float, float]:
    """Return a number of two parts."""
    return registers[0, n, m], registers[1, n, m]


@inlined
def put_pair(registers: FloatArray, n: int, m: int, x: tuple[float, float]) -> None:
    """Put a number of two parts into a register."""
    registers[0, n, m], registers[1, n, m] = x


@inlined
def get_triple(registers: FloatArray, n: int, m: int) -> tuple[float, float, float]:
    """Return a number of three parts."""
    return registers[0, n, m], registers[1, n, m], registers[2, n, m]


@inlined
def put_triple(registers: FloatArray, n: int, m: int, x: tuple[float, float, float]) -> None:
    """Put a number of three parts into a register."""
    registers[0, n, m], registers[1, n, m], registers[2, n, m] = x


@inlined
def double_of(constant: Constant) -> float:
    """Return the double of a constant."""
    return (constant.constants[constant.slot] if constant.slot >= 0 else 0.0) + constant.more


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


run_double = interpreter_of(
    CompiledArithmetic(
        _get, _put, double_of, operator.add, operator.mul, operator.truediv, operator.neg, power, call
    ),
    __name__,
    "run_double",
)

Bounded = tuple[float, float]
"""A double, and the bound of its error in units of 2^-53 (first order)."""


@inlined
def _number_bounded(constant: Constant) -> Bounded:
    value, slot = double_of(constant), constant.slot
    return value, (abs(value) + abs(constant.constants[slot]) if slot >= 0 else 0.0)


@inlined
def _add_bounded(x: Bounded, y: Bounded) -> Bounded:
    value = x[0] + y[0]
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


run_bounded = interpreter_of(
    CompiledArithmetic(
        get_pair,
        put_pair,
        _number_bounded,
        _add_bounded,
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
    return np.empty((parts, code.shape[0] + 5, width))


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
