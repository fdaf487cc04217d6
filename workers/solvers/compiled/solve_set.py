"""Solves one problem from its numbers to its motion: single problems and sweeps run this same code."""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.discs.rows import new_discs
from workers.solvers.compiled.doubled.time_map import map_time_doubled
from workers.solvers.compiled.evaluation.interpreter import new_registers
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import Formula, Found, Instructions, Loop, Records, Start
from workers.solvers.compiled.time_map.error import add_roundings, map_error
from workers.solvers.compiled.time_map.proved import build_time_map
from workers.solvers.compiled.time_map.sampling import extent, sample
from workers.solvers.compiled.time_map.series import time_at
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

NOTHING = np.empty(0)

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

    Called by :func:`.batch.solve_batch` alone, which says what is what. A loop that is known by its roots has
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
