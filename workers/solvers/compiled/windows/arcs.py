"""Finds the stretch of the loop that a motion fills, and its start, from the zeros of P."""

import math

import numpy as np

from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.records import Formula, Loop, Records, Start
from workers.solvers.compiled.windows.scan import MAX_ZEROS, PASSABLE, POLE_HEIGHT, radicand_at, scan_half
from workers.solvers.compiled.workspace import Workspace

AUTOMATIC, EQUATOR, REST, POINT = range(4)
"""Kinds of start."""
SAME_ANGLE, OTHER_ANGLE = 1e-12, 1e-7
"""Places closer than the first are mirror images; between the two it is left open."""
LIMIT_CHANGE = 1e-6
UNDECIDED, WHOLE_LOOP = -1, -2
"""Instead of a number of arcs; P > 0 on the whole loop."""


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
def find_arcs(formula: Formula, loop: Loop, half: float, is_smooth: bool, workspace: Workspace) -> int:
    """Fill the table of arcs that meet the half of the loop; return their number, or one of those above."""
    zeros, others, arcs = np.empty(MAX_ZEROS), np.empty(MAX_ZEROS), workspace.arcs
    count, sign, north, south = scan_half(formula, loop, half, zeros, workspace)
    if count < 0:
        return UNDECIDED
    goes_north, goes_south = north == PASSABLE, south == PASSABLE
    beyond_north, beyond_south = -math.pi, 2.0 * math.pi
    if goes_north or goes_south:
        if not is_smooth:
            return UNDECIDED
        other, _, other_north, other_south = scan_half(formula, loop, -half, others, workspace)
        if other < 0 or (goes_north and other_north != PASSABLE) or (goes_south and other_south != PASSABLE):
            return UNDECIDED
        for end, goes in ((-POLE_HEIGHT, goes_north), (POLE_HEIGHT, goes_south)):
            if goes:
                here = radicand_at(formula, loop, half, end, workspace)
                there = radicand_at(formula, loop, -half, end, workspace)
                # With another limit beyond the pole no motion goes on there.
                if not abs(here - there) < LIMIT_CHANGE * abs(here):
                    return UNDECIDED
        if other == 0:
            if count or not (goes_north and goes_south):
                return UNDECIDED
            return WHOLE_LOOP
        beyond_north, beyond_south = -half_angle(others[0]), 2.0 * math.pi - half_angle(others[other - 1])
    number = 0
    for k in range(count + 1):
        if sign > 0:
            rests_below, rests_above = k > 0 or goes_north, k < count or goes_south
            lo = half_angle(zeros[k - 1]) if k > 0 else (beyond_north if goes_north else 0.0)
            hi = half_angle(zeros[k]) if k < count else (beyond_south if goes_south else math.pi)
            arc = arcs[number]
            arc.lo, arc.hi, arc.lo_rests, arc.hi_rests = lo, hi, rests_below, rests_above
            arc.reach, arc.window = _largest_sine(lo, hi), -1
            number += 1
        sign = -sign
    return number


@kernel
def number_windows(arcs: Records, number: int) -> int:
    """Join mirror images and number the windows by growing size; return how many, −1 if undecided."""
    windows = 0
    sizes = np.empty(number)
    groups = np.full(number, -1, dtype=np.int64)
    for i in range(number):
        if groups[i] >= 0:
            continue
        groups[i], sizes[windows] = windows, arcs[i].reach
        for j in range(i + 1, number):
            gap = max(abs(arcs[i].lo + arcs[j].hi - math.pi), abs(arcs[i].hi + arcs[j].lo - math.pi))
            if (
                gap < SAME_ANGLE
                and arcs[i].lo_rests == arcs[j].hi_rests
                and arcs[i].hi_rests == arcs[j].lo_rests
            ):
                groups[j] = windows
                break
            if gap < OTHER_ANGLE:
                return -1
        windows += 1
    for i in range(number):
        rank = 0
        for w in range(windows):
            difference = sizes[w] - sizes[groups[i]]
            if w != groups[i] and abs(difference) < OTHER_ANGLE * sizes[w]:
                return -1
            rank += 1 if difference < 0.0 else 0
        arcs[i].window = rank
    return windows


@kernel
def choose_start(arcs: Records, number: int, window: int, start: Start) -> tuple[int, float, int]:
    """Return the arc (−1: none that is periodic), |v| unrolled, and the sense in which |v| goes at first."""
    kind = start.kind
    chosen = -1
    reaches_equator = False
    for i in range(number):
        if arcs[i].window == window:
            chosen = i if chosen < 0 else chosen
            if not (arcs[i].lo_rests and arcs[i].hi_rests):
                return -1, 0.0, 0
            reaches_equator = reaches_equator or arcs[i].reach == 1.0
    if chosen < 0:
        return -1, 0.0, 0
    equator = 0.5 * math.pi
    if kind == EQUATOR or (kind == AUTOMATIC and reaches_equator):
        for i in range(number):
            if arcs[i].window == window and arcs[i].lo < equator < arcs[i].hi:
                return i, equator, int(start.s_sign)
        return -1, 0.0, 0
    if kind == POINT:
        quarter = math.asin(start.sine) if start.sine <= 1.0 else math.nan
        at = quarter if start.g2_sign > 0.0 else math.pi - quarter
        for i in range(number):
            if arcs[i].window == window:
                for turned in (at - 2.0 * math.pi, at, at + 2.0 * math.pi):
                    if arcs[i].lo + SAME_ANGLE < turned < arcs[i].hi - SAME_ANGLE:
                        return i, turned, int(start.s_sign)
        return -1, 0.0, 0
    best, best_rank, place, direction = -1, -1.0, 0.0, 0
    wanted = start.g2_sign if kind == REST else 1.0
    for i in range(number):
        if arcs[i].window != window:
            continue
        for side in range(2):
            at = arcs[i].hi if side else arcs[i].lo
            fits = (math.cos(at) > 0.0) == (wanted > 0.0)
            if kind == REST and not fits:
                continue
            rank = 4.0 * fits + 2.0 * (math.sin(at) > 0.0) + abs(math.sin(at))
            if rank > best_rank:
                best, best_rank, place, direction = i, rank, at, 1 - 2 * side
    return best, place, direction


@kernel
def set_orbit(loop: Loop, half: float, lo: float, hi: float) -> None:
    """Describe the libration over lo ≤ |v| ≤ hi (unrolled)."""
    loop.rotates = False
    loop.half_width = 0.5 * (hi - lo)
    a, b = (lo, hi) if half > 0.0 else (-hi, -lo)
    loop.s_lower, loop.c_lower = math.sin(a), math.cos(a)
    loop.s_upper, loop.c_upper = math.sin(b), math.cos(b)
    middle = 0.5 * (a + b)
    sine, cosine = math.sin(middle), math.cos(middle)
    # The middle of a symmetric arc is a pole or at the equator, exactly.
    if abs(cosine) < 1e-15:
        sine, cosine = math.copysign(1.0, sine), 0.0
    elif abs(sine) < 1e-15:
        sine, cosine = 0.0, math.copysign(1.0, cosine)
    loop.s_middle, loop.c_middle = sine, cosine
