"""Which arc of the loop a planar motion is on and where it starts, from the zeros of P in doubles."""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.spectral import curve
from workers.solvers.spectral.compiled import kernel
from workers.solvers.spectral.scan import MAX_ZEROS, PASSABLE, radicand_at, scan_half

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

AUTOMATIC, EQUATOR, REST, POINT = range(4)
"""Kinds of start; the wishes are (kind, sign of s, sign of g2, |sin v| of a point)."""
SAME, CLEARLY_DIFFERENT = 1e-12, 1e-7
"""Places closer than the first are mirror images; between the two it is left open."""
SAME_LIMIT = 1e-6
ROTATION = 1.0

# Rows of the table of arcs: ends in |v| unrolled from the half that is asked, from below 0
# to above π; whether they are rest points; the largest |sin v|; the number of the window.
LO, HI, LO_RESTS, HI_RESTS, SIZE, WINDOW = range(6)


@kernel
def half_angle(y: float) -> float:
    """Return |v| = 2 arctan e^y."""
    return 2.0 * math.atan(math.exp(y))


@kernel
def _largest_sine(lo: float, hi: float) -> float:
    for quarter in (-0.5, 0.5, 1.5):
        if lo < quarter * math.pi < hi:
            return 1.0
    return max(abs(math.sin(lo)), abs(math.sin(hi)))


@kernel
def find_arcs(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    half: float,
    is_smooth: bool,
    table: FloatArray,
    arcs: FloatArray,
    desk: FloatArray,
    work: FloatArray,
) -> int:
    """Fill the table of arcs that meet the half of the loop; return their number, −1 if undecided.

    The number is 0 with a ROTATION in the first place of the table if P > 0 on the whole loop.
    """
    zeros, others = np.empty(MAX_ZEROS), np.empty(MAX_ZEROS)
    count, sign, north, south = scan_half(code, result, constants, loop, half, table, zeros, desk, work)
    arcs[0, 0] = 0.0
    if count < 0:
        return -1
    goes_north, goes_south = north == PASSABLE, south == PASSABLE
    beyond_north, beyond_south = -math.pi, 2.0 * math.pi
    if goes_north or goes_south:
        if not is_smooth:
            return -1
        other, _, other_north, other_south = scan_half(
            code, result, constants, loop, -half, table, others, desk, work
        )
        if other < 0 or (goes_north and other_north != PASSABLE) or (goes_south and other_south != PASSABLE):
            return -1
        for end, goes in ((table[0, 0], goes_north), (table[0, -1], goes_south)):
            if goes:
                here = radicand_at(code, result, constants, loop, half, end, desk, work)
                there = radicand_at(code, result, constants, loop, -half, end, desk, work)
                # With another limit beyond the pole no motion goes on there.
                if not abs(here - there) < SAME_LIMIT * abs(here):
                    return -1
        if other == 0:
            if count or not (goes_north and goes_south):
                return -1
            arcs[0, 0] = ROTATION
            return 0
        beyond_north, beyond_south = -half_angle(others[0]), 2.0 * math.pi - half_angle(others[other - 1])
    number = 0
    for k in range(count + 1):
        if sign > 0:
            rests_below, rests_above = k > 0 or goes_north, k < count or goes_south
            lo = half_angle(zeros[k - 1]) if k > 0 else (beyond_north if goes_north else 0.0)
            hi = half_angle(zeros[k]) if k < count else (beyond_south if goes_south else math.pi)
            arcs[number, LO], arcs[number, HI] = lo, hi
            arcs[number, LO_RESTS], arcs[number, HI_RESTS] = 1.0 * rests_below, 1.0 * rests_above
            arcs[number, SIZE], arcs[number, WINDOW] = _largest_sine(lo, hi), -1.0
            number += 1
        sign = -sign
    return number


@kernel
def number_windows(arcs: FloatArray, number: int) -> int:
    """Join mirror images and number the windows by growing size; return how many, −1 if undecided."""
    windows = 0
    sizes = np.empty(number)
    groups = np.full(number, -1, dtype=np.int64)
    for i in range(number):
        if groups[i] >= 0:
            continue
        groups[i], sizes[windows] = windows, arcs[i, SIZE]
        for j in range(i + 1, number):
            gap = max(abs(arcs[i, LO] + arcs[j, HI] - math.pi), abs(arcs[i, HI] + arcs[j, LO] - math.pi))
            if (
                gap < SAME
                and arcs[i, LO_RESTS] == arcs[j, HI_RESTS]
                and arcs[i, HI_RESTS] == arcs[j, LO_RESTS]
            ):
                groups[j] = windows
                break
            if gap < CLEARLY_DIFFERENT:
                return -1
        windows += 1
    for i in range(number):
        rank = 0
        for w in range(windows):
            difference = sizes[w] - sizes[groups[i]]
            if w != groups[i] and abs(difference) < CLEARLY_DIFFERENT * sizes[w]:
                return -1
            rank += difference < 0.0
        arcs[i, WINDOW] = float(rank)
    return windows


@kernel
def choose_start(arcs: FloatArray, number: int, window: int, wishes: FloatArray) -> tuple[int, float, int]:
    """Return the arc (−1: none that is periodic), |v| unrolled, and the sense in which |v| goes at first."""
    kind = int(wishes[0])
    chosen = -1
    reaches_equator = False
    for i in range(number):
        if int(arcs[i, WINDOW]) == window:
            chosen = i if chosen < 0 else chosen
            if arcs[i, LO_RESTS] == 0.0 or arcs[i, HI_RESTS] == 0.0:
                return -1, 0.0, 0
            reaches_equator = reaches_equator or arcs[i, SIZE] == 1.0
    if chosen < 0:
        return -1, 0.0, 0
    equator = 0.5 * math.pi
    if kind == EQUATOR or (kind == AUTOMATIC and reaches_equator):
        for i in range(number):
            if int(arcs[i, WINDOW]) == window and arcs[i, LO] < equator < arcs[i, HI]:
                return i, equator, int(wishes[1])
        return -1, 0.0, 0
    if kind == POINT:
        quarter = math.asin(wishes[3]) if wishes[3] <= 1.0 else math.nan
        at = quarter if wishes[2] > 0.0 else math.pi - quarter
        for i in range(number):
            if int(arcs[i, WINDOW]) == window:
                for turned in (at - 2.0 * math.pi, at, at + 2.0 * math.pi):
                    if arcs[i, LO] + SAME < turned < arcs[i, HI] - SAME:
                        return i, turned, int(wishes[1])
        return -1, 0.0, 0
    best, best_rank, place, direction = -1, -1.0, 0.0, 0
    wanted = wishes[2] if kind == REST else 1.0
    for i in range(number):
        if int(arcs[i, WINDOW]) != window:
            continue
        for side in range(2):
            at = arcs[i, LO + side]
            fits = (math.cos(at) > 0.0) == (wanted > 0.0)
            if kind == REST and not fits:
                continue
            rank = 4.0 * fits + 2.0 * (math.sin(at) > 0.0) + abs(math.sin(at))
            if rank > best_rank:
                best, best_rank, place, direction = i, rank, at, 1 - 2 * side
    return best, place, direction


@kernel
def set_orbit(loop: FloatArray, half: float, lo: float, hi: float) -> None:
    """Describe the libration over lo ≤ |v| ≤ hi (unrolled) in the loop's slots."""
    loop[curve.ROTATES] = 0.0
    loop[curve.HALF] = 0.5 * (hi - lo)
    a, b = (lo, hi) if half > 0.0 else (-hi, -lo)
    loop[curve.S_LOWER], loop[curve.C_LOWER] = math.sin(a), math.cos(a)
    loop[curve.S_UPPER], loop[curve.C_UPPER] = math.sin(b), math.cos(b)
    middle = 0.5 * (a + b)
    sine, cosine = math.sin(middle), math.cos(middle)
    # The middle of a symmetric arc is a pole or at the equator, exactly.
    if abs(cosine) < 1e-15:
        sine, cosine = math.copysign(1.0, sine), 0.0
    elif abs(sine) < 1e-15:
        sine, cosine = 0.0, math.copysign(1.0, cosine)
    loop[curve.S_MIDDLE], loop[curve.C_MIDDLE] = sine, cosine
