"""Departures of the integrals of many motions from their values, by the functions of a single job.

V, and Kovalevskaya's integral, are summed with twice the digits: near a collision large terms cancel. A job
takes them from balls of 128 bits, and rounds once; the double is the same wherever :func:`nearest` tells one.
All else is a double's arithmetic, in a job's order.

Numbers of twice the digits carry a bound of their error here. The bounds are those of
:mod:`compiled.doubled.arithmetic`, with room: a sum, product, quotient or root is off by less than
``OPERATION_ERROR`` of itself, a function by less than ``FUNCTION_ERROR`` of itself and of its argument, which
is reduced. Bounds are rounded to nearest: whoever uses one doubles it.
"""

import math
from collections.abc import Mapping
from fractions import Fraction
from typing import Final

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.further_integrals import FurtherIntegral
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from workers.solvers.compiled.discs.arithmetic import UNDERFLOW
from workers.solvers.compiled.doubled.arithmetic import (
    add,
    divide,
    exponential,
    logarithm,
    multiply,
    root,
    sine_and_cosine,
)
from workers.solvers.compiled.evaluation.interpreter import (
    CompiledArithmetic,
    Constant,
    get_triple,
    interpreter_of,
    new_registers,
    put_triple,
)
from workers.solvers.compiled.evaluation.program import (
    ABS,
    COS,
    EXP,
    LOG,
    SIGN,
    SIN,
    Program,
    make_program,
    rest_of,
    rests_of,
)
from workers.solvers.compiled.kernels import kernel

FloatArray = NDArray[np.float64]
Known = tuple[float, float, float]
"""A double, the rest, and how far the number may be from their sum: inf or NaN where it is not known."""
IntArray = NDArray[np.int64]
OPERATION_ERROR: Final = 2.0**-100
FUNCTION_ERROR: Final = 2.0**-94
_LARGEST_ANGLE: Final = 1e5
_CONSTANT_ERROR: Final = 2.0**-104
"""Relative error of a constant whose low part is rounded too."""

UNKNOWN: Known = (0.0, 0.0, math.inf)
ENERGY, GEOMETRIC, AREAS = range(3)
"""Columns of what :func:`drifts_of_many` returns."""


@kernel
def constant(high: float, low: float) -> Known:
    """Return a constant by its double and the double of the rest."""
    is_exact = low == 0.0 and (high == 0.0 or abs(high) > UNDERFLOW)
    return high, low, 0.0 if is_exact else _CONSTANT_ERROR * abs(high) + UNDERFLOW


@kernel
def plus(x: Known, y: Known) -> Known:
    """Return x + y."""
    high, low = add((x[0], x[1]), (y[0], y[1]))
    return high, low, x[2] + y[2] + OPERATION_ERROR * abs(high)


@kernel
def minus(x: Known, y: Known) -> Known:
    """Return x − y."""
    return plus(x, (-y[0], -y[1], y[2]))


@kernel
def times(x: Known, y: Known) -> Known:
    """Return x y."""
    high, low = multiply((x[0], x[1]), (y[0], y[1]))
    error = abs(x[0]) * y[2] + abs(y[0]) * x[2] + x[2] * y[2]
    return high, low, error + OPERATION_ERROR * abs(high) + UNDERFLOW


@kernel
def over(x: Known, y: Known) -> Known:
    """Return x/y; x'/y' − x/y = ((x' − x) − (y' − y) x/y)/y'."""
    least = abs(y[0]) - y[2]
    if not least > 0.0:
        return UNKNOWN
    high, low = divide((x[0], x[1]), (y[0], y[1]))
    return high, low, (x[2] + abs(high) * y[2]) / least + OPERATION_ERROR * abs(high) + UNDERFLOW


@kernel
def square_root(x: Known) -> Known:
    """Return √x of what is certainly positive."""
    if not x[0] - x[2] > UNDERFLOW:
        return UNKNOWN
    high, low = root((x[0], x[1]))
    return high, low, x[2] / high + OPERATION_ERROR * high


@kernel
def exponential_of(x: Known) -> Known:
    """Return e^x."""
    high, low = exponential((x[0], x[1]))
    if not x[2] < 0.5:
        return UNKNOWN
    return high, low, high * (2.0 * x[2] + FUNCTION_ERROR * (1.0 + abs(x[0]))) + UNDERFLOW


@kernel
def logarithm_of(x: Known) -> Known:
    """Return log x of what is certainly positive."""
    least = x[0] - x[2]
    if not least > UNDERFLOW:
        return UNKNOWN
    high, low = logarithm((x[0], x[1]))
    return high, low, x[2] / least + FUNCTION_ERROR * (1.0 + abs(high))


@kernel
def power(x: Known, exponent: Known) -> Known:
    """Return x^exponent, no whole one, of what is certainly positive."""
    if exponent[2] == 0.0 and exponent[1] == 0.0 and abs(exponent[0]) == 0.5:
        found = square_root(x)
        return over((1.0, 0.0, 0.0), found) if exponent[0] < 0.0 else found
    return exponential_of(times(exponent, logarithm_of(x)))


@kernel
def function(operation: int, x: Known) -> Known:
    """Return a function of x, numbered as in :mod:`.program`."""
    if operation == EXP:
        return exponential_of(x)
    if operation == LOG:
        return logarithm_of(x)
    if operation in (ABS, SIGN):
        if not abs(x[0]) > x[2]:
            return UNKNOWN
        sign = 1.0 if x[0] > 0.0 else -1.0
        return (sign * x[0], sign * x[1], x[2]) if operation == ABS else (sign, 0.0, 0.0)
    if not abs(x[0]) <= _LARGEST_ANGLE:
        return UNKNOWN
    s, c = sine_and_cosine((x[0], x[1]))
    error = x[2] + FUNCTION_ERROR * (1.0 + abs(x[0]))
    if operation == SIN:
        return s[0], s[1], error
    if operation == COS:
        return c[0], c[1], error
    return over((s[0], s[1], error), (c[0], c[1], error))


@kernel
def _number(of: Constant) -> Known:
    constants, lows, slot, more = of
    if slot < 0:
        return float(more), 0.0, 0.0
    known = constant(constants[slot], lows[slot])
    return known if more == 0 else plus(known, (float(more), 0.0, 0.0))


@kernel
def _opposite(x: Known) -> Known:
    return -x[0], -x[1], x[2]


run_known = interpreter_of(
    CompiledArithmetic(get_triple, put_triple, _number, plus, times, over, _opposite, power, function),
    __name__,
    "run_known",
)


@kernel
def nearest(x: Known) -> float:
    """Return the double nearest to a number, NaN if its error leaves two of them.

    The number itself and all others within twice the error round to it: also the middle of a ball of more
    digits that encloses it.
    """
    error = 2.0 * x[2]
    high = x[0] + x[1]
    rest = x[1] - (high - x[0])
    return high if high + (rest - error) == high == high + (rest + error) else math.nan


@kernel
def _evaluate(
    code: IntArray, constants: FloatArray, lows: FloatArray, samples: FloatArray, registers: FloatArray
) -> None:
    """Fill in the registers of a formula, of three parts, at samples (n, 6)."""
    for k in range(3):
        for m in range(len(samples)):
            registers[0, k, m], registers[1, k, m], registers[2, k, m] = samples[m, 3 + k], 0.0, 0.0
    run_known(code, constants, lows, registers, len(samples))


@kernel
def _value(registers: FloatArray, n: int, m: int) -> float:
    return nearest((registers[0, n, m], registers[1, n, m], registers[2, n, m]))


@kernel
def potential_energies(
    code: IntArray, result: int, constants: FloatArray, lows: FloatArray, samples: FloatArray, out: FloatArray
) -> None:
    """Fill in V at samples (n, 6), NaN where it is not known."""
    registers = new_registers(code, 3, len(samples))
    _evaluate(code, constants, lows, samples, registers)
    for m in range(len(samples)):
        out[m] = _value(registers, result, m)


@kernel
def energy_drifts(
    code: IntArray,
    result: int,
    constants: FloatArray,
    lows: FloatArray,
    moments: FloatArray,
    energies: FloatArray,
    samples: FloatArray,
    wanted: IntArray,
    out: FloatArray,
) -> None:
    """Fill in the largest departures of energy, γ·γ and areas integral of the ``wanted`` motions, (sets, 3).

    ``constants`` and their ``lows`` are (sets, constants), ``samples`` (sets, n, 6); ``moments`` are A, B, C.
    What is not known is NaN.
    """
    A, B, C = moments
    count = samples.shape[1]
    registers = new_registers(code, 3, count)
    for n in wanted:
        here = samples[n]
        _evaluate(code, constants[n], lows[n], here, registers)
        energy, geometric, areas = 0.0, 0.0, 0.0
        for m in range(count):
            p, q, r, g1, g2, g3 = here[m]
            V = _value(registers, result, m)
            total = ((A * (p * p) + B * (q * q)) + C * (r * r)) / 2.0 + V
            departure = abs(total - energies[n])
            # NaN passes no comparison: what is not known stays so.
            energy = energy if departure <= energy else departure if energy == energy else math.nan
            geometric = max(geometric, abs(((g1 * g1 + g2 * g2) + g3 * g3) - 1.0))
            areas = max(areas, abs(((A * p) * g1 + (B * q) * g2) + (C * r) * g3))
        out[n, 0], out[n, 1], out[n, 2] = energy, geometric, areas


@kernel
def _constant_at(numbers: FloatArray, k: int) -> Known:
    return constant(numbers[2 * k], numbers[2 * k + 1])


@kernel
def _squared(numbers: FloatArray, state: FloatArray) -> Known:
    """Return |W|², as :class:`service.dynamics.further_integrals.FurtherIntegral` writes it."""
    a, b, c1 = _constant_at(numbers, 0), _constant_at(numbers, 1), _constant_at(numbers, 2)
    c2, b1 = _constant_at(numbers, 3), _constant_at(numbers, 4)
    p, q = (state[0], 0.0, 0.0), (state[1], 0.0, 0.0)
    g1, g2, g3 = (state[3], 0.0, 0.0), (state[4], 0.0, 0.0), (state[5], 0.0, 0.0)
    square = times(g3, g3)
    real = minus(times(minus(p, q), plus(p, q)), minus(times(a, g1), times(b, g2)))
    pq = times(p, q)
    imaginary = minus((2.0 * pq[0], 2.0 * pq[1], 2.0 * pq[2]), plus(times(a, g2), times(b, g1)))
    real, imaginary = plus(real, times(c1, square)), plus(imaginary, times(c2, square))
    if b1[0] != 0.0:
        real = minus(real, over(times(b1, times(minus(g1, g2), plus(g1, g2))), square))
        both = times(g1, g2)
        imaginary = minus(imaginary, over(times(b1, (2.0 * both[0], 2.0 * both[1], 2.0 * both[2])), square))
    return plus(times(real, real), times(imaginary, imaginary))


@kernel
def further_drifts(numbers: FloatArray, samples: FloatArray, wanted: IntArray, out: FloatArray) -> None:
    """Fill in K at the first sample, and its largest departure, of the ``wanted`` motions, (sets, 2).

    ``numbers``, shape (sets, 10), are a, b, c1, c2 and b1 over C, each with the rest of its double. What is
    not known is NaN.
    """
    for n in wanted:
        first, drift = 0.0, 0.0
        for m in range(samples.shape[1]):
            value = nearest(_squared(numbers[n], samples[n, m]))
            if m == 0:
                first = value
            departure = abs(value - first)
            drift = drift if departure <= drift else departure if drift == drift else math.nan
        out[n, 0], out[n, 1] = first, drift


def energies_at(potential: Potential, samples: FloatArray) -> FloatArray:
    """Return V at ``samples`` (n, 6), the doubles that its balls round to; NaN where that is not known."""
    out = np.full(len(samples), np.nan)
    try:
        tape = potential.tape
    except NoClosedFormError:
        return out
    program, constants = make_program(tape)
    states = np.ascontiguousarray(samples, dtype=np.float64)
    potential_energies(program.code, program.result, constants, rests_of(tape, constants), states, out)
    return out


def drifts_of_many(
    body: RigidBody,
    program: Program,
    constants: FloatArray,
    rests: FloatArray,
    energies: FloatArray,
    samples: FloatArray,
    wanted: IntArray,
) -> FloatArray:
    """Return the largest departures of the three integrals of planar motions, shape (sets, 3).

    ``constants`` of the program and their ``rests`` are (sets, constants), ``samples`` (sets, n, 6), finite.
    The numbers are those of :func:`workers.solvers.evidence.drifts_of`; those of motions that are not
    ``wanted``, and energies of which twice the digits do not tell every double, are NaN.
    """
    out = np.full((len(samples), 3), np.nan)
    moments = np.array([float(body.A), 0.0 if body.B is None else float(body.B), float(body.C)])
    energy_drifts(
        program.code,
        program.result,
        constants,
        rests,
        moments,
        # Also where they are a column of others: one type of arguments is compiled.
        np.ascontiguousarray(energies),
        np.ascontiguousarray(samples),
        wanted,
        out,
    )
    return out


def further_drifts_of_many(integrals: Mapping[int, FurtherIntegral], samples: FloatArray) -> FloatArray:
    """Return each motion's integral at its first sample, and its largest departure, shape (sets, 2).

    ``integrals`` are those of some sets of ``samples`` (sets, n, 6), by their places; the others are NaN. The
    numbers are those of :func:`service.dynamics.further_integrals.integral_drift`, or NaN as those of
    :func:`drifts_of_many`. Cubic ones are NaN too: no motion of a sweep in blocks has one.
    """
    out = np.full((len(samples), 2), np.nan)
    numbers, row = np.zeros((len(samples), 10)), list[float]()
    last: FurtherIntegral | None = None
    for place, each in integrals.items():
        # Neighbours often share one.
        if each is not last:
            last, row = each, [part for number in _numbers(each) for part in _parts(number)]
        numbers[place] = row
    wanted = np.array([place for place, each in integrals.items() if not each.is_cubic], dtype=np.int64)
    further_drifts(numbers, np.ascontiguousarray(samples), wanted, out)
    return out


def _numbers(integral: FurtherIntegral) -> tuple[Fraction, ...]:
    C = integral.C
    return integral.a / C, integral.b / C, integral.c1 / C, integral.c2 / C, integral.b1 / C


def _parts(number: Fraction) -> tuple[float, float]:
    known = nearest_double(number)
    return known, rest_of(number, known)
