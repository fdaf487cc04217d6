"""Finds the stretch of the loop that a motion fills, and its start, from the zeros of P, all of them found.

Every zero on half of the loop is proved to be the only one in its interval. The half is covered by panels of
v, beside the power of s = |sin v| that D = g1 V_3 − g3 V_1 has at the poles, and by the cells at the poles
themselves, where that power leads. On each, D is enclosed in a disc (:mod:`compiled.discs.rows`), which
bounds what a short series of it leaves out (:mod:`.signs`). What that does not settle is halved. Zeros are
then found along y, v = 2 arctan e^y: sin v = 1/cosh y and cos v = −tanh y. Whatever doubles leave in doubt
(zeros about to merge, undefined values) is not decided here.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.discs.rows import SAME_POWER, derivatives_on_discs, put_disc, put_pole
from workers.solvers.compiled.evaluation.curve import radicands
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.records import Formula, Loop, Records, Start
from workers.solvers.compiled.windows.signs import (
    BEGINS,
    EDGE_RATIO,
    EDGES,
    ENDS,
    HALF_WIDTHS,
    MIDDLE_COSINES,
    MIDDLE_SINES,
    NODES,
    PANELS,
    PANELS_TOGETHER,
    POLE_SINE,
    SIDES,
    is_certain,
    pole_cells,
    read_alone,
    read_panel,
    resolve,
    value_and_slope,
)
from workers.solvers.compiled.workspace import Workspace

FloatArray = NDArray[np.float64]
MAX_ZEROS = 16
NARROWEST_PANEL = 1e-12
"""Relative width of a panel that is not halved."""
MAX_CUT_PANELS = 400
"""Beside the first ones."""
BLOCKED, PASSABLE, OPEN = 0, 1, 2
"""At a pole: P < 0; P > 0 with a finite limit; P > 0 and it diverges or dies out."""
POLE_HEIGHT = 13.0
"""|y| where P is taken for its limit at a pole."""
AUTOMATIC, EQUATOR, REST, POINT = range(4)
"""Kinds of start."""
SAME_ANGLE, OTHER_ANGLE = 1e-12, 1e-7
"""Places closer than the first are mirror images; between the two it is left open."""
LIMIT_CHANGE = 1e-6
UNDECIDED, WHOLE_LOOP = -1, -2
"""Instead of a number of arcs; P > 0 on the whole loop."""


@kernel
def radicand_at(formula: Formula, loop: Loop, half: float, y: float, workspace: Workspace) -> float:
    """Return P at y on the half of the loop with this sign of g3."""
    places = workspace.places
    places.sine[0], places.cosine[0] = half / math.cosh(y), -math.tanh(y)
    radicands(formula, loop, places, 1)
    return float(places.radicand[0])


@kernel
def _zero(
    formula: Formula, loop: Loop, half: float, a: float, b: float, fa: float, fb: float, workspace: Workspace
) -> float:
    """Return the zero between a and b, where the signs differ, by Anderson and Björck's rule."""
    for step in range(200):
        x = 0.5 * (a + b) if step % 4 == 3 else (a * fb - b * fa) / (fb - fa)
        if not (min(a, b) < x < max(a, b)):
            x = 0.5 * (a + b)
        if x in (a, b):
            break
        fx = radicand_at(formula, loop, half, x, workspace)
        if fx == 0.0:
            return x
        if (fx > 0.0) == (fb > 0.0):
            weight = 1.0 - fx / fb
            fa *= weight if weight > 0.0 else 0.5
        else:
            a, fa = b, fb
        last = b
        b, fb = x, fx
        if abs(last - x) <= 2e-16 * abs(x) or abs(b - a) <= 2e-16 * abs(b):
            break
    return b


@kernel
def scan_half(
    formula: Formula, loop: Loop, half: float, zeros: FloatArray, workspace: Workspace
) -> tuple[int, int, int, int]:
    """Return the number of zeros (−1: undecided), P's sign before the first, and its north and south pole.

    The zeros y go into ``zeros``, growing.
    """
    c, r, e = formula.discs
    for n in range(PANELS):
        put_disc(workspace.discs, n, half * MIDDLE_SINES[n], MIDDLE_COSINES[n], HALF_WIDTHS[n])
    for k in range(2):
        put_pole(workspace.discs, PANELS + k, POLE_SINE, 1.0 - 2.0 * k, half)
    row = derivatives_on_discs(formula, loop, workspace.discs, PANELS + 2)
    exponent = e[row]
    if not abs(exponent) < math.inf:
        return -1, 0, 0, 0
    certain = np.zeros(PANELS)
    errors, all_series = np.empty((PANELS, 2)), np.empty((PANELS, NODES))
    open_panels, number = np.empty(PANELS, dtype=np.int64), 0
    for n in range(PANELS):
        if abs(c[row, n]) > r[row, n]:
            certain[n] = np.sign(c[row, n])
        else:
            open_panels[number] = n
            number += 1
    first = loop.factor * loop.sign1 * half * (-1.0 if loop.mirrored else 1.0)
    turned = 1.0 if first > 0.0 else -1.0
    poles, more = np.empty(2), np.zeros(2, dtype=np.int64)
    for k in range(2):
        poles[k] = np.sign(c[row, PANELS + k]) if abs(c[row, PANELS + k]) > r[row, PANELS + k] else 0.0
    for k in range(2):
        if poles[k] == 0.0:
            more[k] = pole_cells(formula, loop, half, 1.0 - 2.0 * k, workspace)
            if more[k] < 0:
                return -1, 0, 0, 0
            poles[k] = np.sign(c[row, more[k] - 1])
    for start in range(0, number, PANELS_TOGETHER):
        stop = min(number, start + PANELS_TOGETHER)
        resolve(formula, loop, half, exponent, open_panels[start:stop], errors, all_series, workspace)
    brackets, state, kept = np.empty((MAX_ZEROS, 4)), np.zeros(4), np.zeros(4)
    found = is_certain(state, poles[0], 0.0, 1.0, EDGES[0] / EDGE_RATIO ** more[0], 1.0, brackets, 0)
    waiting = np.empty((MAX_CUT_PANELS, 3))
    evaluated = 0
    for n in range(-1, PANELS + 1):
        pending = 0
        if 0 <= n < PANELS:
            begin, end, side = BEGINS[n], ENDS[n], SIDES[n]
            kept[:] = state
            before = found
            if certain[n] != 0.0:
                found = is_certain(state, certain[n], begin, side, end, side, brackets, found)
            else:
                found = read_panel(
                    all_series[n], errors[n, 0], errors[n, 1], begin, end, side, state, brackets, found
                )
            if found < 0:
                state[:] = kept
                found = before
                pending = _halve(waiting, 0, begin, end, side)
        else:
            # North from the pole to the first panel, south the other way round.
            k = 0 if n < 0 else 1
            for m in range(more[k]):
                near, far = EDGES[0] / EDGE_RATIO ** (m + 1.0), EDGES[0] / EDGE_RATIO**m
                at = m if k == 0 else more[k] - 1 - m
                waiting[at, 0], waiting[at, 1] = (near, far) if k == 0 else (far, near)
                waiting[at, 2] = 1.0 - 2.0 * k
            pending = more[k]
        while pending:
            pending -= 1
            begin, end, side = waiting[pending, 0], waiting[pending, 1], waiting[pending, 2]
            evaluated += 1
            if evaluated == MAX_CUT_PANELS:
                return -1, 0, 0, 0
            found_now = read_alone(
                formula, loop, half, begin, end, side, exponent, state, brackets, found, workspace
            )
            if found_now >= 0:
                found = found_now
                continue
            if abs(end - begin) < NARROWEST_PANEL * (begin + end) or pending + 2 >= MAX_CUT_PANELS:
                return -1, 0, 0, 0
            pending = _halve(waiting, pending, begin, end, side)
    found = is_certain(state, poles[1], EDGES[0] / EDGE_RATIO ** more[1], -1.0, 0.0, -1.0, brackets, found)
    if found < 0:
        return -1, 0, 0, 0
    for k in range(found):
        a, b = _height(brackets[k, 0], brackets[k, 1]), _height(brackets[k, 2], brackets[k, 3])
        near, width = _guess(brackets[k], certain, errors, all_series)
        fa, fb = 1.0, 1.0
        if width < math.inf:
            closer_a, closer_b = _height(near - width, brackets[k, 1]), _height(near + width, brackets[k, 1])
            fa = radicand_at(formula, loop, half, closer_a, workspace)
            fb = radicand_at(formula, loop, half, closer_b, workspace)
        if fa * np.sign(fb) < 0.0:
            a, b = closer_a, closer_b
        else:
            fa = radicand_at(formula, loop, half, a, workspace)
            fb = radicand_at(formula, loop, half, b, workspace)
        if not (abs(fa) < math.inf and abs(fb) < math.inf and fa * np.sign(fb) < 0.0):
            return -1, 0, 0, 0
        zeros[k] = _zero(formula, loop, half, a, b, fa, fb, workspace)
    # P = D g3/g1 up to constants.
    poles *= turned
    leading = exponent + 1.0 - loop.alpha
    north = BLOCKED if poles[0] < 0.0 else PASSABLE if abs(leading) < SAME_POWER else OPEN
    south = BLOCKED if poles[1] < 0.0 else PASSABLE if abs(leading) < SAME_POWER else OPEN
    return found, 1 if poles[0] > 0.0 else -1, north, south


@kernel
def _halve(waiting: FloatArray, pending: int, begin: float, end: float, side: float) -> int:
    """Put both halves of a panel on the stack, the first on top."""
    middle = 0.5 * (begin + end)
    waiting[pending, 0], waiting[pending, 1], waiting[pending, 2] = middle, end, side
    waiting[pending + 1, 0], waiting[pending + 1, 1], waiting[pending + 1, 2] = begin, middle, side
    return pending + 2


@kernel
def _guess(
    bracket: FloatArray, certain: FloatArray, errors: FloatArray, all_series: FloatArray
) -> tuple[float, float]:
    """Return about where the zero of a bracket is in one of the first panels, and how far off (inf: none)."""
    a, b, side = bracket[0], bracket[2], bracket[1]
    for n in range(PANELS):
        begin, end = BEGINS[n], ENDS[n]
        is_inside = min(begin, end) <= min(a, b) and max(a, b) <= max(begin, end)
        if is_inside and bracket[3] == side == SIDES[n] and certain[n] == 0.0:
            middle, half = 0.5 * (begin + end), 0.5 * (end - begin)
            low, high = (a - middle) / half, (b - middle) / half
            x = 0.5 * (low + high)
            for _ in range(8):
                value, slope = value_and_slope(all_series[n], x)
                step = value / slope
                x = min(high, max(low, x - step))
                if abs(step) < 1e-3 * errors[n, 0] / abs(slope):
                    break
            width = abs(half) * 0.5 * errors[n, 0] / abs(slope)
            away = middle + half * x
            is_clear = width < 0.2 * abs(b - a) and min(a, b) + width < away < max(a, b) - width
            return away, (width if is_clear else math.inf)
    return math.nan, math.inf


@kernel
def _height(away: float, side: float) -> float:
    """Return y at a distance from the pole of one side."""
    return side * math.log(math.tan(0.5 * away))


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
