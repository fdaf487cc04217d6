"""Numbers of twice the digits, each a double and what it leaves out (Dekker 1971), and the loop in them.

A sum, product, quotient or root is off by a few 2^-104 of itself, sines and cosines by as much of 1, powers
by that times the size of the logarithm besides. So are the radicand P = p² on the loop, and the ends of a
libration.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from workers.solvers.compiled.evaluation.interpreter import (
    CompiledArithmetic,
    Constant,
    derivative_with_bound,
    get_pair,
    interpreter_of,
    put_pair,
)
from workers.solvers.compiled.evaluation.program import ABS, EXP, LOG, SIGN, SIN, TAN
from workers.solvers.compiled.kernels import fused, inlined, kernel
from workers.solvers.compiled.records import Formula, Loop
from workers.solvers.compiled.workspace import Places, two_sum

FloatArray = NDArray[np.float64]
Twice = tuple[float, float]
"""A double and the rest."""
SIXTEENTHS: Final = 16
"""Number of parts of π between the angles whose sines are kept."""
HALVINGS: Final = 5
"""Number of halvings of the argument of the exponential function before its series."""
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


def doubled(value: arb) -> Twice:
    """Return a ball of enough bits as a double and the rest."""
    high = float(value)
    return high, float(value - high)


def _tables() -> tuple[FloatArray, FloatArray, FloatArray]:
    with ctx.workprec(160):
        pairs = [(arb.pi() * k / SIXTEENTHS).sin_cos() for k in range(2 * SIXTEENTHS)]
        turns = np.array([[*doubled(sine), *doubled(cosine)] for sine, cosine in pairs])
        steps = np.array([doubled(arb.pi() / SIXTEENTHS), doubled(arb(2).log())])
        factorials = np.array([doubled(1 / arb(math.factorial(k))) for k in range(20)])
    return turns, steps, factorials


TURNS, STEPS, INVERSE = _tables()
"""Sines and cosines at the sixteenths of π; π/16 and log 2; 1/k!."""


@kernel
def quick_sum(a: float, b: float) -> Twice:
    """Return a + b and what that leaves out, |a| ≥ |b|."""
    total = a + b
    return total, b - (total - a)


@kernel
def exact_product(a: float, b: float) -> Twice:
    """Return a b and what that leaves out."""
    product = a * b
    return product, fused(a, b, -product)


@kernel
def add(a: Twice, b: Twice) -> Twice:
    """Return the sum; it has its digits also where much cancels."""
    high, rest = two_sum(a[0], b[0])
    low, left = two_sum(a[1], b[1])
    high, rest = quick_sum(high, rest + low)
    return quick_sum(high, rest + left)


@kernel
def subtract(a: Twice, b: Twice) -> Twice:
    """Return the difference."""
    return add(a, (-b[0], -b[1]))


@kernel
def multiply(a: Twice, b: Twice) -> Twice:
    """Return the product."""
    high, rest = exact_product(a[0], b[0])
    return quick_sum(high, rest + (a[0] * b[1] + a[1] * b[0]))


@kernel
def scale(a: Twice, b: float) -> Twice:
    """Return the product with a double."""
    high, rest = exact_product(a[0], b)
    return quick_sum(high, rest + a[1] * b)


@kernel
def divide(a: Twice, b: Twice) -> Twice:
    """Return the quotient."""
    first = a[0] / b[0]
    rest = subtract(a, scale(b, first))
    second = rest[0] / b[0]
    rest = subtract(rest, scale(b, second))
    high, low = quick_sum(first, second)
    return quick_sum(high, low + rest[0] / b[0])


@kernel
def root(a: Twice) -> Twice:
    """Return the square root, NaN of what is negative."""
    if a[0] == 0.0:
        return 0.0, 0.0
    near = math.sqrt(a[0]) if a[0] > 0.0 else math.nan
    rest = subtract(a, exact_product(near, near))
    high, low = quick_sum(near, 0.5 * rest[0] / near)
    # One more step of Newton's, with what is left.
    rest = subtract(a, multiply((high, low), (high, low)))
    return quick_sum(high, low + 0.5 * rest[0] / near)


@kernel
def sine_and_cosine(angle: Twice) -> tuple[Twice, Twice]:
    """Return the sine and the cosine of an angle of a few turns."""
    step = (STEPS[0, 0], STEPS[0, 1])
    k = math.floor(angle[0] / step[0] + 0.5)
    x = subtract(angle, scale(step, k))
    square = multiply(x, x)
    z = square[0]
    # The later terms of both series are so small that doubles do.
    odd = -INVERSE[11, 0] + z * (INVERSE[13, 0] - z * (INVERSE[15, 0] - z * INVERSE[17, 0]))
    even = -INVERSE[10, 0] + z * (INVERSE[12, 0] - z * (INVERSE[14, 0] - z * INVERSE[16, 0]))
    s, c, sign = (z * odd, 0.0), (z * even, 0.0), 1.0
    for n in range(4, 0, -1):
        s = add(s, (sign * INVERSE[2 * n + 1, 0], sign * INVERSE[2 * n + 1, 1]))
        c = add(c, (sign * INVERSE[2 * n, 0], sign * INVERSE[2 * n, 1]))
        s, c = multiply(s, square), multiply(c, square)
        sign = -sign
    s, c = add(x, multiply(x, s)), add((1.0, 0.0), c)
    row = TURNS[int(k) % (2 * SIXTEENTHS)]
    sine, cosine = (row[0], row[1]), (row[2], row[3])
    return (add(multiply(sine, c), multiply(cosine, s)), subtract(multiply(cosine, c), multiply(sine, s)))


@kernel
def exponential(a: Twice) -> Twice:
    """Return e^a."""
    two = (STEPS[1, 0], STEPS[1, 1])
    k = math.floor(a[0] / two[0] + 0.5)
    if not abs(k) < 1000.0:
        return math.nan, math.nan
    shrink = 0.5**HALVINGS
    x = subtract(a, scale(two, k))
    x = (x[0] * shrink, x[1] * shrink)
    z = x[0]
    later = z * (INVERSE[7, 0] + z * (INVERSE[8, 0] + z * (INVERSE[9, 0] + z * INVERSE[10, 0])))
    total = (later + z**5 * INVERSE[11, 0], 0.0)
    for n in range(6, 0, -1):
        total = add(total, (INVERSE[n, 0], INVERSE[n, 1]))
        total = multiply(total, x)
    for _ in range(HALVINGS):
        # (1 + y)² − 1.
        total = add((2.0 * total[0], 2.0 * total[1]), multiply(total, total))
    total = add(total, (1.0, 0.0))
    whole = int(k)
    return math.ldexp(total[0], whole), math.ldexp(total[1], whole)


@kernel
def logarithm(a: Twice) -> Twice:
    """Return log a, NaN of what is not positive."""
    if not a[0] > 0.0:
        return math.nan, math.nan
    near = math.log(a[0])
    off = subtract(multiply(a, exponential((-near, 0.0))), (1.0, 0.0))
    return add((near, 0.0), (off[0], off[1] - 0.5 * off[0] * off[0]))


@kernel
def power(base: Twice, exponent: Twice) -> Twice:
    """Return base^exponent; NaN where undefined."""
    if abs(exponent[0]) == 0.5 and exponent[1] == 0.0:
        found = root(base)
        return divide((1.0, 0.0), found) if exponent[0] < 0.0 else found
    return exponential(multiply(exponent, logarithm(base)))


@kernel
def call(operation: int, a: Twice) -> Twice:
    """Return a function, numbered as in :mod:`compiled.evaluation.program`."""
    if operation == EXP:
        return exponential(a)
    if operation == LOG:
        return logarithm(a)
    if operation in (ABS, SIGN):
        sign = 1.0 if a[0] > 0.0 else -1.0 if a[0] < 0.0 else 0.0
        return (sign * a[0], sign * a[1]) if operation == ABS else (sign, 0.0)
    sine, cosine = sine_and_cosine(a)
    if operation == TAN:
        return divide(sine, cosine)
    return sine if operation == SIN else cosine


@inlined
def _number(constant: Constant) -> Twice:
    constants, lows, slot, more = constant
    return add((constants[slot], lows[slot]), (float(more), 0.0)) if slot >= 0 else (float(more), 0.0)


@inlined
def _negate(a: Twice) -> Twice:
    return -a[0], -a[1]


run_doubled = interpreter_of(
    CompiledArithmetic(get_pair, put_pair, _number, add, multiply, divide, _negate, power, call),
    __name__,
    "run_doubled",
)


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
