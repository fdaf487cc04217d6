r"""Solves one problem from its numbers to its motion: single problems and sweeps run this same code.

Besides, the precession per period of motions round the whole loop. Its integral is that of
:mod:`workers.solvers.orientation.advance`, of one function of v, λ and α,

.. math:: \frac{d\psi_1}{dv} = α Z \frac{|g_1|}{c\,(g_2^2 + g_3^2)} ,

four times from the pole to the equator. Panels are halved until 16 nodes of Gauss on each half give what they
give on the whole; what both differ by, and the rounding of the integrand, are the error.
"""

import math

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from service.dynamics.solution.dense_output import UNIT_ROUNDOFF
from workers.solvers.compiled.discs.rows import new_discs
from workers.solvers.compiled.doubled.time_map import map_time_doubled
from workers.solvers.compiled.evaluation.curve import size_and_c
from workers.solvers.compiled.evaluation.interpreter import new_registers
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import Formula, Found, Instructions, Loop, Records, Start
from workers.solvers.compiled.time_map.error import add_roundings, build_time_map, map_error
from workers.solvers.compiled.time_map.panels import time_at
from workers.solvers.compiled.time_map.sampling import extent, sample
from workers.solvers.compiled.windows.arcs import (
    POINT,
    REST,
    WHOLE_LOOP,
    choose_start,
    find_arcs,
    number_windows,
    set_orbit,
)
from workers.solvers.compiled.workspace import POINTS, Workspace

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
NOTHING = np.empty(0)
NODES, WEIGHTS = legendre.leggauss(16)
RESOLVED_CHANGE = 2.0**-56
"""Change of a panel by halving that is small enough, relative to the whole."""
MAX_WAITING = 60
"""Panels that wait: one for each time that one is halved."""
NARROWEST_PANEL = 1e-15
INTEGRAND_ULPS = 8.0
"""Rounding error of the integrand, in 2^-53 of it, where λ and the power of the sine are exact."""


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
def new_formula(code: IntArray, result: int, turn: Instructions, constants: FloatArray) -> Formula:
    """Return a program with its constants, and what it is worked out on."""
    registers, discs = new_registers(turn.code, 2, POINTS), new_discs(5 + turn.code.shape[0])
    return Formula(code, result, turn, constants, NOTHING, registers, discs, NOTHING)


@inlined
def find_orbit(formula: Formula, loop: Loop, workspace: Workspace) -> tuple[float, float]:
    """Choose the window, describe the orbit; return u at the start (NaN: undecided) and the sense."""
    alpha, half, window, s = loop.alpha, loop.half, loop.window, loop.s_sign
    is_smooth = 0.5 * alpha == math.floor(0.5 * alpha)
    sine = 0.0
    if loop.kind == POINT:
        size = loop.size_of_g1
        sine = size / loop.z if loop.mirrored else math.exp(math.log(size / loop.g) / alpha)
    number = find_arcs(formula, loop, half, is_smooth, workspace)
    if number == WHOLE_LOOP:
        if loop.kind == REST or window > 0:
            return math.nan, 1.0
        loop.rotates, loop.direction = True, s * half
        u = 0.5
        if loop.kind == POINT:
            if not sine < 1.0:
                return math.nan, 1.0
            u = math.asin(sine) / math.pi
            u = u if loop.g2_sign > 0.0 else 1.0 - u
        return (u if s > 0.0 else 2.0 - u), 1.0
    if number <= 0:
        return math.nan, 1.0
    windows = number_windows(workspace.arcs, number)
    if windows < 1 or (window < 0 and windows > 1) or window >= windows:
        return math.nan, 1.0
    start = Start(loop.kind, s, loop.g2_sign, sine)
    chosen, at, sense = choose_start(workspace.arcs, number, max(window, 0), start)
    if chosen < 0:
        return math.nan, 1.0
    lo, hi = workspace.arcs[chosen].lo, workspace.arcs[chosen].hi
    set_orbit(loop, half, lo, hi)
    loop.place = half * at
    if abs(at - 0.5 * (lo + hi)) < 1e-15:
        u = 0.5
    else:
        u = 2.0 / math.pi * math.atan2(math.sqrt(max(at - lo, 0.0)), math.sqrt(max(hi - at, 0.0)))
    if half < 0.0:
        u = 1.0 - u
    return u, sense * half


@inlined
def map_time(
    formula: Formula, loop: Loop, tolerance: float, panels: Records, workspace: Workspace, found: Found
) -> None:
    """Build the time map, set period and origin, and say what is known.

    The number of panels is 0 where any of it is not.
    """
    number, length = build_time_map(formula, loop, tolerance, panels, workspace)
    if number == 0:
        return
    turns = 1.0 if loop.rotates else 2.0
    loop.period_hi, loop.period_lo = turns * length, 0.0
    loop.origin, loop.origin_lo = time_at(panels, number, loop.start)
    loop.backwards = loop.sense < 0.0
    astray = np.empty(number)
    error, found.rate_error = map_error(formula, loop, panels, number, workspace.places, astray)
    add_roundings(panels, number, astray)
    found.speed, found.largest, found.moved = extent(loop, panels, number, workspace.moments, astray)
    found.period, found.period_error, found.time_error = loop.period_hi, turns * error, turns * error
    if found.period_error < math.inf and found.speed < math.inf and found.rate_error + found.moved < math.inf:
        found.panels = number


@kernel
def solve_sets(
    code: IntArray,
    result: int,
    turn: Instructions,
    constants: FloatArray,
    lows: FloatArray,
    tolerance: float,
    times: FloatArray,
    rests: FloatArray,
    columns: IntArray,
    loops: Records,
    panels: Records,
    founds: Records,
    workspaces: Records,
    out: FloatArray,
) -> None:
    """Solve every row of ``constants`` with its loop, and sample it at ``times`` + ``rests``.

    Called by :func:`.solve.solve_batch` alone, which says what is what. A loop that is known by its roots has
    its start already.
    """
    if len(loops) == 0:
        return
    whole, workspace = new_formula(code, result, turn, constants[0]), workspaces[0]
    for n in range(len(loops)):
        loop, found = loops[n], founds[n]
        formula = Formula(
            code,
            result,
            turn,
            constants[n],
            lows[n] if len(lows) else NOTHING,
            whole.registers,
            whole.discs,
            NOTHING,
        )
        if not loop.by_roots:
            loop.z, loop.g = equator_of(loop.alpha, loop.log_lambda)
            loop.start, loop.sense = find_orbit(formula, loop, workspace)
        found.panels, found.period, found.period_error, found.time_error = 0, math.nan, math.nan, math.nan
        found.speed, found.largest, found.rate_error, found.moved = math.nan, math.nan, math.nan, math.nan
        if loop.start == loop.start and len(lows):
            map_time_doubled(formula, loop, tolerance, panels, workspace, found)
        elif loop.start == loop.start:
            map_time(formula, loop, tolerance, panels, workspace, found)
        if found.panels == 0:
            out[n] = math.nan
            continue
        sample(loop, panels, found.panels, times, rests, columns, workspace.moments, out[n])


@kernel
def _on_panel(loop: Loop, left: float, right: float) -> tuple[float, float]:
    """Return the integral over a panel, and the bound of its rounding."""
    alpha, z, size = loop.alpha, loop.z, loop.g
    middle, half = 0.5 * (left + right), 0.5 * (right - left)
    total, error = 0.0, 0.0
    of_lambda = 4.0 * (1.0 + alpha) * abs(loop.log_lambda)
    for k in range(len(NODES)):
        v = middle + half * NODES[k]
        sine, cosine = math.sin(v), math.cos(v)
        g1, c = size_and_c(alpha, z, size, sine, cosine)
        g2, g3 = c * cosine, z * sine
        value = WEIGHTS[k] * half * (alpha * z * g1 / (c * (g2 * g2 + g3 * g3)))
        total += value
        error += value * (INTEGRAND_ULPS + of_lambda + 2.0 * alpha * abs(math.log(sine)))
    return total, UNIT_ROUNDOFF * error


@kernel
def advance_of(loops: Records) -> tuple[float, float]:
    """Return the integral over the whole loop of the primed axes, and the bound of its error; NaN for none.

    Of the loop only α and log λ count.
    """
    loop = loops[0]
    loop.z, loop.g = equator_of(loop.alpha, loop.log_lambda)
    lefts, rights, values = np.empty(MAX_WAITING), np.empty(MAX_WAITING), np.empty(MAX_WAITING)
    lefts[0], rights[0] = 0.0, 0.5 * math.pi
    values[0], _ = _on_panel(loop, lefts[0], rights[0])
    pending, total, error = 1, 0.0, 0.0
    whole = values[0]
    while pending:
        pending -= 1
        left, right = lefts[pending], rights[pending]
        middle = 0.5 * (left + right)
        one, first = _on_panel(loop, left, middle)
        two, second = _on_panel(loop, middle, right)
        change = abs(one + two - values[pending])
        if not change < math.inf:
            return math.nan, math.nan
        if change <= max(RESOLVED_CHANGE * whole, first + second) or right - left < NARROWEST_PANEL:
            total += one + two
            error += change + first + second
            continue
        if pending + 2 > MAX_WAITING:
            return math.nan, math.nan
        lefts[pending], rights[pending], values[pending] = middle, right, two
        lefts[pending + 1], rights[pending + 1], values[pending + 1] = left, middle, one
        pending += 2
    return 4.0 * total, 4.0 * error
