"""The loop, the radicand P = p² on it, and the ends of a libration, with twice the digits."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.doubled.arithmetic import (
    Twice,
    add,
    divide,
    exponential,
    logarithm,
    multiply,
    root,
    run_doubled,
    scale,
    sine_and_cosine,
    subtract,
)
from workers.solvers.compiled.evaluation.interpreter import derivative_with_bound
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.records import Formula, Loop
from workers.solvers.compiled.workspace import Places

FloatArray = NDArray[np.float64]

ROUNDING_RATIO = 2.0**-45
"""Roundings here against those of doubles: 2^-98 to 2^-53, where those of powers are the largest."""
SLOPE_STEP_SHARE = 2.0**-28
"""Distance, against that of both ends, over which the slope of P at an end is a difference."""
END_ERROR_SHARE = 2.0**-78
"""Error of an end that may be left open, relative to the distance of both ends."""

ANGLE, RADICAND, SQUARE, G1, COSINE, SLOPED, BELOW = 0, 2, 4, 6, 12, 14, 16
"""Rows of double-doubles, each followed by its low part: v, P, g2², g1, g2, g3, cos v, and P as a quotient.
P is a double alone where nobody asks for more."""
ROWS = 18


class DoubledCurve(NamedTuple):
    """The numbers that define a loop."""

    alpha: Twice
    factor: Twice
    z: Twice
    g: Twice
    log_g: Twice


@kernel
def curve_of(loop: Loop) -> DoubledCurve:
    """Return Z and G of Z² + (Z/λ)^2α = 1 by a step of Newton's in log Z from doubles, and the rest."""
    alpha = (loop.alpha, loop.alpha_low)
    log_lambda = (loop.log_lambda, loop.log_lambda_low)
    u = math.log(loop.z)
    first = exponential((2.0 * u, 0.0))
    log_g = multiply(alpha, subtract((u, 0.0), log_lambda))
    second = exponential((2.0 * log_g[0], 2.0 * log_g[1]))
    miss = subtract(add(first, second), (1.0, 0.0))
    slope = add(first, multiply(alpha, second))
    log_z = subtract((u, 0.0), divide(miss, (2.0 * slope[0], 2.0 * slope[1])))
    log_g = multiply(alpha, subtract(log_z, log_lambda))
    return DoubledCurve(alpha, (loop.factor, loop.factor_low), exponential(log_z), exponential(log_g), log_g)


@kernel
def quotients_doubled(
    formula: Formula, loop: Loop, curve: DoubledCurve, pairs: FloatArray, count: int
) -> None:
    """Fill in what P is the quotient of, and what that is made of, at places of which v is known."""
    for m in range(count):
        sine, cosine = sine_and_cosine((pairs[ANGLE, m], pairs[ANGLE + 1, m]))
        size = sine if sine[0] > 0.0 else (-sine[0], -sine[1])
        if curve.alpha[0] == 2.0 and curve.alpha[1] == 0.0:
            first = multiply(curve.g, multiply(size, size))
        else:
            first = exponential(add(curve.log_g, multiply(curve.alpha, logarithm(size))))
        third = multiply(curve.z, sine)
        square = subtract((1.0, 0.0), add(multiply(first, first), multiply(third, third)))
        second = root(square)
        if cosine[0] < 0.0:
            second = (-second[0], -second[1])
        pairs[SQUARE, m], pairs[SQUARE + 1, m] = square
        pairs[COSINE, m], pairs[COSINE + 1, m] = cosine
        first = scale(first, loop.sign1)
        one, other = (third, first) if loop.mirrored else (first, third)
        pairs[G1, m], pairs[G1 + 1, m] = one
        pairs[G1 + 2, m], pairs[G1 + 3, m] = second
        pairs[G1 + 4, m], pairs[G1 + 5, m] = other
    registers, D = formula.registers, formula.turn.results[0]
    for k in range(3):
        for m in range(count):
            registers[0, k, m], registers[1, k, m] = pairs[G1 + 2 * k, m], pairs[G1 + 2 * k + 1, m]
    run_doubled(formula.turn.code, formula.constants, formula.lows, registers, count)
    for m in range(count):
        one, other = (pairs[G1, m], pairs[G1 + 1, m]), (pairs[G1 + 4, m], pairs[G1 + 5, m])
        up, down = (one, other) if loop.mirrored else (other, one)
        value = multiply(curve.factor, multiply(up, (registers[0, D, m], registers[1, D, m])))
        sign = -1.0 if loop.mirrored else 1.0
        pairs[SLOPED, m], pairs[SLOPED + 1, m] = sign * value[0], sign * value[1]
        pairs[BELOW, m], pairs[BELOW + 1, m] = down
        pairs[RADICAND, m], pairs[RADICAND + 1, m] = sign * value[0] / down[0], 0.0


@kernel
def radicands_doubled(
    formula: Formula, loop: Loop, curve: DoubledCurve, pairs: FloatArray, count: int
) -> None:
    """Fill in P as well."""
    quotients_doubled(formula, loop, curve, pairs, count)
    for m in range(count):
        sloped, below = (pairs[SLOPED, m], pairs[SLOPED + 1, m]), (pairs[BELOW, m], pairs[BELOW + 1, m])
        pairs[RADICAND, m], pairs[RADICAND + 1, m] = divide(sloped, below)


@kernel
def roundings_of(formula: Formula, loop: Loop, pairs: FloatArray, count: int, places: Places) -> None:
    """Fill in a bound of the rounding of P: that of doubles at the same places, made finer."""
    D, ulps = derivative_with_bound(formula, pairs[G1], pairs[G1 + 2], pairs[G1 + 4], count)
    for m in range(count):
        factor, cosine = pairs[G1 + 4, m] / pairs[G1, m], pairs[COSINE, m]
        factor = loop.factor * abs(1.0 / factor if loop.mirrored else factor)
        # g2 is a difference, off by so much of its square.
        away = abs(D[m]) * (6.0 + 1.0 / (cosine * cosine))
        places.bound[m] = ROUNDING_RATIO * factor * (ulps[m] + away) * 2.0**-53


@kernel
def ends_of(
    formula: Formula,
    loop: Loop,
    curve: DoubledCurve,
    lower: float,
    upper: float,
    pairs: FloatArray,
    places: Places,
) -> tuple[Twice, Twice, float]:
    """Return both ends of a libration by a step of Newton's from doubles, and a bound of what they are off.

    The bound is NaN where it is not a small one. The slope is a difference, off by the square of its step.
    """
    away = SLOPE_STEP_SHARE * (upper - lower)
    ends = ((lower, 0.0), (upper, 0.0))
    pairs[ANGLE + 1, :6] = 0.0
    for k in range(3):
        pairs[ANGLE, k] = lower + (k - 1) * away
        pairs[ANGLE, 3 + k] = upper + (k - 1) * away
    radicands_doubled(formula, loop, curve, pairs, 6)
    found = ends
    rises = np.empty(2)
    for k in range(2):
        rise = (pairs[RADICAND, 3 * k + 2] - pairs[RADICAND, 3 * k]) / (
            pairs[ANGLE, 3 * k + 2] - pairs[ANGLE, 3 * k]
        )
        rises[k] = rise
        miss = (pairs[RADICAND, 3 * k + 1], pairs[RADICAND + 1, 3 * k + 1])
        step = divide(miss, (rise, 0.0))
        at = subtract((pairs[ANGLE, 3 * k + 1], 0.0), step)
        found = (at, found[1]) if k == 0 else (found[0], at)
    for k in range(2):
        at = found[0] if k == 0 else found[1]
        pairs[ANGLE, k], pairs[ANGLE + 1, k] = at
    radicands_doubled(formula, loop, curve, pairs, 2)
    left = np.empty(2)
    for k in range(2):
        left[k] = abs(pairs[RADICAND, k])
    roundings_of(formula, loop, pairs, 2, places)
    off = 0.0
    for k in range(2):
        off = max(off, (left[k] + places.bound[k]) / abs(rises[k]))
    return found[0], found[1], (2.0 * off if off <= END_ERROR_SHARE * (upper - lower) else math.nan)
