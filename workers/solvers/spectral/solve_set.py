"""From the numbers of one problem to its motion, compiled: the one path of single problems and sweeps."""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.spectral import curve
from workers.solvers.spectral.compiled import kernel
from workers.solvers.spectral.sampling import extent, sample
from workers.solvers.spectral.time_map import build_time_map, largest_noise, time_at
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


@kernel
def find_orbit(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    half: float,
    window: int,
    wishes: FloatArray,
    places: FloatArray,
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
    number = find_arcs(code, result, constants, loop, half, is_smooth, places, arcs, work)
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


@kernel
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
    work: FloatArray,
) -> tuple[int, float]:
    """Build the time map, set period and origin; return the number of panels and the period's error."""
    number, length, error = build_time_map(
        code, result, constants, loop, tolerance, matrix, points, panels, work
    )
    turns = 1.0 if loop[curve.ROTATES] != 0.0 else 2.0
    loop[curve.PERIOD_HI], loop[curve.PERIOD_LO] = turns * length, 0.0
    loop[curve.ORIGIN] = time_at(panels, number, start) if number else math.nan
    loop[curve.BACKWARDS] = 1.0 if sense < 0.0 else 0.0
    return number, turns * error


@kernel
def describe(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    panels: FloatArray,
    number: int,
    error: float,
    work: FloatArray,
    about: FloatArray,
) -> None:
    """Fill in (panels, period, its error, largest slope, largest |p| or |r|, relative error of dt/du)."""
    about[:] = math.nan
    about[0] = float(number)
    if number:
        about[1], about[2] = loop[curve.PERIOD_HI], error
        about[3], about[4] = extent(loop, panels, number)
        about[5] = largest_noise(code, result, constants, loop, panels, number, work)
        if not (about[2] < math.inf and about[3] < math.inf and about[5] < math.inf):
            about[0] = 0.0


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
    places: FloatArray,
    matrix: FloatArray,
    points: FloatArray,
    times: FloatArray,
    columns: IntArray,
    keep: FloatArray,
    out: FloatArray,
    about: FloatArray,
) -> None:
    """Solve every row of ``constants`` and ``loops``, and sample it.

    ``given`` holds (log λ, -) of each set, or (u at the start, sense) where the loop
    is known by its roots. ``about`` gets (panels, period, its error, largest slope,
    largest |p| or |r|, relative error of dt/du); 0 panels where it was not decided.
    ``keep`` is the last table of panels.
    """
    work = np.empty((4, code.shape[0] + 3))
    for n in range(len(constants)):
        loop = loops[n]
        if loop[curve.ROOTS_MODE] != 0.0:
            start, sense = given[n, 0], given[n, 1]
        else:
            loop[curve.Z], loop[curve.G] = equator_of(loop[curve.ALPHA], given[n, 0])
            start, sense = find_orbit(code, result, constants[n], loop, half, window, wishes, places, work)
        number, error = 0, math.inf
        if start == start:
            number, error = map_time(
                code, result, constants[n], loop, start, sense, tolerance, matrix, points, keep, work
            )
        describe(code, result, constants[n], loop, keep, number, error, work, about[n])
        if about[n, 0] == 0.0:
            out[n] = math.nan
            continue
        sample(loop, keep, number, times, columns, out[n])
