"""Bounds g1, g2, g3 and D on discs around places of the loop, and on intervals that begin at a pole."""

import math

from workers.solvers.compiled.discs.arithmetic import FUNCTION_ERROR
from workers.solvers.compiled.discs.rows import SCALE, forget_powers, run_rows
from workers.solvers.compiled.evaluation.interpreter import power
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.records import Formula, Loop
from workers.solvers.compiled.workspace import DiscWorkspace

EQUATOR_ERROR = 2.0**-47
"""Relative error of Z and G, which are solved for in doubles."""


@kernel
def put_disc(discs: DiscWorkspace, lane: int, sine: float, cosine: float, radius: float) -> None:
    """Put in the disc of this radius around the v that has this sine and cosine."""
    even, odd = 2.0 * math.sinh(0.5 * radius) ** 2, math.sinh(radius)
    s, c = abs(sine), abs(cosine)
    discs.s_centre[lane], discs.c_centre[lane] = s, cosine
    discs.s_radius[lane] = (s * even + c * odd) * (1.0 + FUNCTION_ERROR) + FUNCTION_ERROR * s
    discs.c_radius[lane] = (c * even + s * odd) * (1.0 + FUNCTION_ERROR) + FUNCTION_ERROR
    # 2 cos² v = 1 + cos 2v
    even, odd = 4.0 * even + 2.0 * even * even, 2.0 * odd * (1.0 + even)
    discs.t_radius[lane] = (abs(0.5 - s * s) * even + s * c * odd) * (1.0 + FUNCTION_ERROR) + FUNCTION_ERROR
    discs.sign[lane] = -1.0 if sine < 0.0 else 1.0


@kernel
def put_pole(discs: DiscWorkspace, lane: int, sine: float, hemisphere: float, half: float) -> None:
    """Put in the disc of the real v with 0 < |sin v| ≤ ``sine``, on one hemisphere and half of the loop."""
    least = math.sqrt((1.0 - sine) * (1.0 + sine)) * (1.0 - FUNCTION_ERROR)
    discs.s_centre[lane] = discs.s_radius[lane] = 0.5 * sine
    discs.c_centre[lane], discs.c_radius[lane] = hemisphere * 0.5 * (1.0 + least), 0.5 * (1.0 - least)
    # Of the disc around a quarter of the square of the sine.
    discs.t_radius[lane] = 0.75 * sine * sine * (1.0 + FUNCTION_ERROR)
    discs.sign[lane] = half


@kernel
def put_squares(loop: Loop, discs: DiscWorkspace, count: int) -> None:
    """Fill in c² on the discs."""
    first, third = loop.g * loop.g, loop.z * loop.z
    for m in range(count):
        s, sr, tr = discs.s_centre[m], discs.s_radius[m], discs.t_radius[m]
        ratio, ratio_r = _equator_ratio(loop.alpha, s, sr, tr)
        square = third + first * ratio
        discs.square[m], discs.square_radius[m] = square, first * ratio_r + 4.0 * EQUATOR_ERROR * square


@kernel
def derivatives_on_discs(formula: Formula, loop: Loop, discs: DiscWorkspace, count: int) -> int:
    """Return the row of D on the discs, which is beside a power of s = |sin v|; fill in c²."""
    c, r, e = formula.discs
    alpha, size, z, sign = loop.alpha, loop.g, loop.z, loop.sign1
    put_squares(loop, discs, count)
    first, second, third = (2, 1, 0) if loop.mirrored else (0, 1, 2)
    for m in range(count):
        s, sr, k, kr = discs.s_centre[m], discs.s_radius[m], discs.c_centre[m], discs.c_radius[m]
        c[SCALE, m], r[SCALE, m] = s, sr
        c[first, m], r[first, m] = sign * size, size * EQUATOR_ERROR
        c[third, m], r[third, m] = discs.sign[m] * z, z * EQUATOR_ERROR
        square, square_r = discs.square[m], discs.square_radius[m]
        root = math.sqrt(square)
        # √ of a disc: the nearest point to 0 moves most.
        root_r = (
            root - math.sqrt(square - square_r) + FUNCTION_ERROR * root if square > square_r else math.nan
        )
        c[second, m] = root * k
        r[second, m] = (root * kr + root_r * (abs(k) + kr)) * (1.0 + FUNCTION_ERROR) + FUNCTION_ERROR * abs(
            root * k
        )
    e[SCALE], e[first], e[second], e[third] = 1.0, alpha, 0.0, 1.0
    forget_powers(formula.discs)
    run_rows(formula.turn.code, formula.constants, formula.lows, formula.discs, count)
    D: int = formula.turn.results[0]
    return D


@kernel
def _equator_ratio(alpha: float, s: float, sr: float, square_r: float) -> tuple[float, float]:
    """Return (1 − s^2α)/cos² v on a disc."""
    square = s * s
    if alpha == 2.0:
        return 1.0 + square, square_r
    exponent = 2.0 * alpha
    is_analytic = sr <= s or exponent == 2.0 * math.floor(0.5 * exponent)
    if not is_analytic:
        return math.nan, math.nan
    # With t = cos² v the ratio is α ∫ (1 − tξ)^(α−1) dξ over 0 ≤ ξ ≤ 1: it varies most at real t.
    t = 1.0 - square
    edge = t - square_r if alpha >= 2.0 else t + square_r
    if edge < 0.98:
        value = _ratio(alpha, t)
        return value, abs(_ratio(alpha, edge) - value) * (1.0 + FUNCTION_ERROR) + 4.0 * FUNCTION_ERROR * value
    top = power(s, exponent)
    top_r = (power(s + sr, exponent) - top) * (1.0 + FUNCTION_ERROR) + FUNCTION_ERROR
    left = t - square_r
    if not left > 0.0:
        return math.nan, math.nan
    value = (1.0 - top) / t
    return value, (top_r + value * square_r) / left * (1.0 + FUNCTION_ERROR) + FUNCTION_ERROR * value


@kernel
def _ratio(alpha: float, t: float) -> float:
    return -math.expm1(alpha * math.log1p(-t)) / t if abs(t) > 1e-300 else alpha
