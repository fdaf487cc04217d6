"""The phase at a time, and the six variables there, compiled."""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.spectral import curve
from workers.solvers.spectral.compiled import kernel
from workers.solvers.spectral.curve import loop_point, place
from workers.solvers.spectral.time_map import (
    ANCHOR,
    FIRST,
    GUESS,
    HIGH,
    LAST,
    LENGTH,
    LOW,
    START,
    distance,
    series_at,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SPLIT = 134217729.0
"""2^27 + 1, Veltkamp's constant for doubles."""
STEP = 1e-8
"""A Newton step after which the error, its square, is below rounding."""


@kernel
def reduced(time: float, hi: float, lo: float) -> float:
    """Return time − n (hi + lo) in about [−hi/2, hi/2] (Dekker's product)."""
    n = math.floor(time / hi + 0.5)
    if n == 0.0:
        return time
    product = n * hi
    a_high = SPLIT * n - (SPLIT * n - n)
    b_high = SPLIT * hi - (SPLIT * hi - hi)
    a_low, b_low = n - a_high, hi - b_high
    rest = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    return ((time - product) - rest) - n * lo


@kernel
def variables_at(
    loop: FloatArray, panels: FloatArray, number: int, time: float
) -> tuple[float, float, float, float, float]:
    """Return the client's p, r, g1, g2, g3 at a time."""
    hi = loop[curve.PERIOD_HI]
    local = reduced(time, hi, loop[curve.PERIOD_LO])
    sense = 1.0
    if loop[curve.BACKWARDS] != 0.0:
        local = -local
        sense = -sense
    local += loop[curve.ORIGIN]
    if local < 0.0:
        local += hi
    elif local >= hi:
        local -= hi
    if loop[curve.ROTATES] == 0.0 and 2.0 * local > hi:
        local = hi - local
        sense = -sense
    n = _panel_of(panels, number, local)
    x, slope = _place_of(panels[n], local - panels[n, START])
    return _variables(loop, panels[n], x, slope, sense)


@kernel
def _panel_of(panels: FloatArray, number: int, local: float) -> int:
    """Return the panel of a time, by bisection."""
    low, high = 0, number - 1
    while low < high:
        middle = (low + high + 1) // 2
        if panels[middle, START] <= local:
            low = middle
        else:
            high = middle - 1
    return low


@kernel
def _place_of(panel: FloatArray, target: float) -> tuple[float, float]:
    """Return x where ``target`` has passed since the panel's start, and dt/dx there: Newton, safeguarded."""
    share, m = target / panel[LENGTH], panel[GUESS + 6]
    x = panel[GUESS + 4] + panel[GUESS + 5] * (share - 1.0)
    x = panel[GUESS + 2] + (share - m) * (panel[GUESS + 3] + (share - m) * x)
    first, last = panel[FIRST], panel[LAST]
    x = min(last, max(first, panel[GUESS] + share * (panel[GUESS + 1] + share * x)))
    low, high, slope = first, last, 1.0
    for _ in range(60):
        value, slope = series_at(panel, x)
        miss = value - target
        if miss > 0.0:
            high = x
        else:
            low = x
        step = miss / slope
        if abs(step) <= STEP:
            x = min(last, max(first, x - step))
            _, slope = series_at(panel, x)
            break
        x = x - step if low < x - step < high else 0.5 * (low + high)
    return x, slope


@kernel
def _variables(
    loop: FloatArray, panel: FloatArray, x: float, slope: float, sense: float
) -> tuple[float, float, float, float, float]:
    """Return the client's p, r, g1, g2, g3 at x; p = −(Z/c) dv/dt, dt/dv being known from the series."""
    _, _, sine, cosine, speed = place(loop, int(panel[ANCHOR]), distance(panel, x))
    g1, g2, g3, c = loop_point(loop, sine, cosine)
    velocity = sense * speed * 0.5 * (panel[HIGH] - panel[LOW]) / slope
    if loop[curve.ROTATES] != 0.0:
        velocity *= loop[curve.DIRECTION]
    p = -loop[curve.Z] * velocity / c
    r = -loop[curve.ALPHA] * g1 * p / g3 if g3 != 0.0 else 0.0
    if loop[curve.MIRRORED] != 0.0:
        return -r, -p, g3, g2, g1
    return p, r, g1, g2, g3


@kernel
def sample(
    loop: FloatArray, panels: FloatArray, number: int, times: FloatArray, columns: IntArray, out: FloatArray
) -> None:
    """Fill ``out`` (times, columns) with the columns asked, numbered 0 to 5 for p, q, r, g1, g2, g3."""
    row = np.empty(6)
    for n in range(len(times)):
        row[0], row[2], row[3], row[4], row[5] = variables_at(loop, panels, number, times[n])
        row[1] = 0.0
        for k in range(len(columns)):
            out[n, k] = row[columns[k]]


@kernel
def extent(loop: FloatArray, panels: FloatArray, number: int) -> tuple[float, float]:
    """Return the largest time derivative of any variable, and the largest |p| or |r|, over all panels.

    Derivatives are differences between neighbouring places, a factor added for what is between them.
    """
    steepest, largest, last = 0.0, 0.0, math.nan
    previous, now = np.empty(5), np.empty(5)
    for n in range(number):
        panel = panels[n]
        for k in range(8 + (n == number - 1)):
            x = panel[FIRST] + 0.125 * k * (panel[LAST] - panel[FIRST])
            value, slope = series_at(panel, x)
            t = panel[START] + value
            step = t - last
            if step <= 1e-9 * loop[curve.PERIOD_HI]:
                continue
            now[0], now[1], now[2], now[3], now[4] = _variables(loop, panel, x, slope, 1.0)
            largest = max(largest, abs(now[0]), abs(now[1]))
            if step > 0.0:
                for i in range(5):
                    steepest = max(steepest, abs(now[i] - previous[i]) / step)
            previous[:] = now
            last = t
    return 1.25 * steepest, largest
