"""From the numbers of one problem to its motion, compiled: the one path of single problems and sweeps."""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.spectral import curve
from workers.solvers.spectral.compiled import inlined, kernel
from workers.solvers.spectral.interpreter import POINTS, new_desk
from workers.solvers.spectral.map_error import map_error
from workers.solvers.spectral.sampling import extent, sample
from workers.solvers.spectral.time_map import build_time_map, time_at
from workers.solvers.spectral.windows import choose_start, find_arcs, number_windows, set_orbit

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@kernel
def equator_of(alpha: float, log_lambda: float) -> tuple[float, float]:
    """Solve Z² + (Z/λ)^2α = 1 by Newton in log Z; return Z and G."""
    u = min(0.0, log_lambda)
    for _ in range(100):
        first, second = math.exp(2.0 * u), math.exp(2.0 * alpha * (u - log_lambda))
        step = (first + second - 1.0) / (2.0 * first + 2.0 * alpha * second)
        u -= step
        if abs(step) < 1e-16 * max(1.0, abs(u)):
            break
    return math.exp(u), math.exp(alpha * (u - log_lambda))


@inlined
def find_orbit(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    half: float,
    window: int,
    wishes: FloatArray,
    table: FloatArray,
    desk: FloatArray,
    work: FloatArray,
) -> tuple[float, float]:
    """Choose the window, describe the orbit; return u at the start (NaN: undecided) and the sense."""
    alpha = loop[curve.ALPHA]
    is_smooth = 0.5 * alpha == math.floor(0.5 * alpha)
    wishes = wishes.copy()
    if wishes[0] == 3.0:
        size = wishes[3]
        wishes[3] = size / loop[curve.Z]
        if loop[curve.MIRRORED] == 0.0:
            wishes[3] = math.exp(math.log(size / loop[curve.G]) / alpha)
    arcs = np.empty((64, 6))
    number = find_arcs(code, result, constants, loop, half, is_smooth, table, arcs, desk, work)
    if number == 0 and arcs[0, 0] == 1.0:
        kind, s = int(wishes[0]), wishes[1]
        if kind == 2 or window > 0:
            return math.nan, 1.0
        loop[curve.ROTATES], loop[curve.DIRECTION] = 1.0, s * half
        u = 0.5
        if kind == 3:
            if not wishes[3] < 1.0:
                return math.nan, 1.0
            u = math.asin(wishes[3]) / math.pi
            u = u if wishes[2] > 0.0 else 1.0 - u
        return (u if s > 0.0 else 2.0 - u), 1.0
    if number <= 0:
        return math.nan, 1.0
    windows = number_windows(arcs, number)
    if windows < 1 or (window < 0 and windows > 1) or window >= windows:
        return math.nan, 1.0
    chosen, at, sense = choose_start(arcs, number, max(window, 0), wishes)
    if chosen < 0:
        return math.nan, 1.0
    lo, hi = arcs[chosen, 0], arcs[chosen, 1]
    set_orbit(loop, half, lo, hi)
    if abs(at - 0.5 * (lo + hi)) < 1e-15:
        u = 0.5
    else:
        u = 2.0 / math.pi * math.atan2(math.sqrt(max(at - lo, 0.0)), math.sqrt(max(hi - at, 0.0)))
    if half < 0.0:
        u = 1.0 - u
    return u, sense * half


@inlined
def map_time(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    start: float,
    sense: float,
    tolerance: float,
    matrix: FloatArray,
    points: FloatArray,
    panels: FloatArray,
    desk: FloatArray,
    work: FloatArray,
    about: FloatArray,
) -> int:
    """Build the time map, set period and origin, and say what is known; return the number of panels.

    ``about`` gets that number, the period, its error, the largest slope, the largest |p| or |r|, and
    the relative error of dt/du. The number is 0 where any of them is not known.
    """
    about[:] = math.nan
    about[0] = 0.0
    number, length = build_time_map(
        code, result, constants, loop, tolerance, matrix, points, panels, desk, work
    )
    if number == 0:
        return 0
    turns = 1.0 if loop[curve.ROTATES] != 0.0 else 2.0
    loop[curve.PERIOD_HI], loop[curve.PERIOD_LO] = turns * length, 0.0
    loop[curve.ORIGIN], loop[curve.ORIGIN_LO] = time_at(panels, number, start)
    loop[curve.BACKWARDS] = 1.0 if sense < 0.0 else 0.0
    error, rate_error = map_error(code, result, constants, loop, panels, number, desk, work)
    steepest, largest = extent(loop, panels, number)
    about[1], about[2], about[3], about[4], about[5] = (
        loop[curve.PERIOD_HI],
        turns * error,
        steepest,
        largest,
        rate_error,
    )
    if about[2] < math.inf and about[3] < math.inf and about[5] < math.inf:
        about[0] = float(number)
        return number
    return 0


@kernel
def solve_sets(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loops: FloatArray,
    given: FloatArray,
    half: float,
    window: int,
    wishes: FloatArray,
    tolerance: float,
    table: FloatArray,
    matrix: FloatArray,
    points: FloatArray,
    times: FloatArray,
    rests: FloatArray,
    columns: IntArray,
    keep: FloatArray,
    out: FloatArray,
    about: FloatArray,
) -> None:
    """Solve every row of ``constants`` and ``loops``, and sample it at ``times`` + ``rests``.

    ``given`` holds (log λ, -) of each set, or (u at the start, sense) where the loop
    is known by its roots. ``about`` gets what :func:`map_time` says of each; 0 panels
    where it was not decided. ``keep`` is the last table of panels.
    """
    work, desk = new_desk(code), np.empty((curve.ROWS, POINTS))
    for n in range(len(constants)):
        loop = loops[n]
        if loop[curve.ROOTS_MODE] != 0.0:
            start, sense = given[n, 0], given[n, 1]
        else:
            loop[curve.Z], loop[curve.G] = equator_of(loop[curve.ALPHA], given[n, 0])
            start, sense = find_orbit(
                code, result, constants[n], loop, half, window, wishes, table, desk, work
            )
        number = 0
        if start == start:
            number = map_time(
                code,
                result,
                constants[n],
                loop,
                start,
                sense,
                tolerance,
                matrix,
                points,
                keep,
                desk,
                work,
                about[n],
            )
        else:
            about[n] = math.nan
            about[n, 0] = 0.0
        if number == 0:
            out[n] = math.nan
            continue
        sample(loop, keep, number, times, rests, columns, out[n])
