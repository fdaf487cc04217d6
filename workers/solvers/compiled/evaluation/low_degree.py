"""Tells whether V is a sum of low powers, which have no features much narrower than the sphere."""

import math

from workers.solvers.compiled.evaluation.interpreter import (
    CompiledArithmetic,
    Constant,
    double_of,
    get_triple,
    interpreter_of,
    new_registers,
    put_triple,
)
from workers.solvers.compiled.evaluation.program import ABS
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import Formula

HIGHEST_DEGREE = 12.0
"""Degree, of either sign, of the products of g1, g2 and g3 that V is a sum of."""
NUMBER, PRODUCT, SUM, OTHER = 0.0, 1.0, 2.0, 3.0
"""The kinds of registers: a number, a product of powers of g1 and g3, a sum of such products and whole powers
of g2, and anything else."""
Degrees = tuple[float, float, float]
"""The lowest and the highest degree, and the kind."""


@inlined
def _number(constant: Constant) -> Degrees:
    # Its value instead of its degrees, which are 0: it may be an exponent.
    return double_of(constant), 0.0, NUMBER


@inlined
def _of(x: Degrees) -> Degrees:
    return (0.0, 0.0, NUMBER) if x[2] == NUMBER else x


@inlined
def _within(low: float, high: float, kind: float) -> Degrees:
    return low, high, kind if low >= -HIGHEST_DEGREE and high <= HIGHEST_DEGREE else OTHER


@kernel
def _sum(x: Degrees, y: Degrees) -> Degrees:
    x, y = _of(x), _of(y)
    kind = max(x[2], y[2])
    return min(x[0], y[0]), max(x[1], y[1]), kind if kind == NUMBER else max(kind, SUM)


@kernel
def _product(x: Degrees, y: Degrees) -> Degrees:
    x, y = _of(x), _of(y)
    return _within(x[0] + y[0], x[1] + y[1], max(x[2], y[2]))


@kernel
def _quotient(x: Degrees, y: Degrees) -> Degrees:
    x, y = _of(x), _of(y)
    return _within(x[0] - y[1], x[1] - y[0], max(x[2], y[2]) if y[2] <= PRODUCT else OTHER)


@inlined
def _opposite(x: Degrees) -> Degrees:
    return x


@kernel
def _power(x: Degrees, exponent: Degrees) -> Degrees:
    (low, high, kind), by = _of(x), exponent[0]
    is_known = kind <= PRODUCT or (by >= 0.0 and by == math.floor(by))
    return _within(min(by * low, by * high), max(by * low, by * high), kind if is_known else OTHER)


@inlined
def _function(operation: int, x: Degrees) -> Degrees:
    is_known = x[2] == NUMBER or (operation == ABS and x[2] == PRODUCT)
    return x[0], x[1], x[2] if is_known else OTHER


run_degrees = interpreter_of(
    CompiledArithmetic(
        get_triple, put_triple, _number, _sum, _product, _quotient, _opposite, _power, _function
    ),
    __name__,
    "run_degrees",
)


@kernel
def is_of_low_degree(formula: Formula) -> bool:
    """Say whether V is a sum of products of real powers of g1 and g3 and whole powers of g2, of low degree.

    A feature of such a V is about as wide as the sphere over its degree, and leaves its trace in the last
    coefficients of a series. A quotient by a sum, a function or a high power may make one of any width, but
    those of numbers are numbers.
    """
    registers = new_registers(formula.code, 3, 1)
    for k in range(3):
        put_triple(registers, k, 0, (1.0, 1.0, SUM if k == 1 else PRODUCT))
    run_degrees(formula.code, formula.constants, formula.lows, registers, 1)
    return bool(registers[2, formula.result, 0] < OTHER)
