"""Departures of the integrals of many motions from their values, by the functions of a single job.

V, and Kovalevskaya's integral, are summed with twice the digits: near a collision large terms cancel. A job
takes them from balls of 128 bits, and rounds once; the double is the same wherever :func:`.known.nearest`
tells one. All else is a double's arithmetic, in a job's order.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.evaluation.interpreter import new_registers
from workers.solvers.compiled.integrals.known import (
    Known,
    constant,
    minus,
    nearest,
    over,
    plus,
    run_known,
    times,
)
from workers.solvers.compiled.kernels import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


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
