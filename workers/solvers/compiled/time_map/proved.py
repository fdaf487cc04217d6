"""Builds a time map whose truncation errors are proved on whole panels; panels that fail are halved."""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.evaluation.low_degree import is_of_low_degree
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.records import MAX_PANELS, NODES, Formula, Loop, Panel, Records
from workers.solvers.compiled.time_map.panels import build_panels
from workers.solvers.compiled.time_map.truncation import (
    LARGEST_ETA,
    PANELS_TOGETHER,
    bound_left_out,
    seen_between,
)
from workers.solvers.compiled.workspace import Workspace

FloatArray = NDArray[np.float64]

ATTEMPTS = 40
"""To cut panels on which the bounds do not prove enough."""
TIME_SLACK, TIME_SLACK_BY_ROOTS, RATE_SLACK = 2.0, 0.25, 50.0
"""Errors that bounds may leave, in tolerances: of a time on a panel, the second by roots, and of dt/du."""


@kernel
def build_time_map(
    formula: Formula, loop: Loop, tolerance: float, panels: Records, workspace: Workspace
) -> tuple[int, float]:
    """Fill the table of panels; return their number and the length of time.

    For a libration they cover 0 ≤ u ≤ 1, half a period. The number is 0 if dt/du is not resolved, or if
    that is not proved on the whole of each panel. For a V of low degree the last coefficients of each series
    decide, which is no proof, and what they leave out is seen later: bounds would cost several times the map.
    """
    proves = loop.by_roots or not is_of_low_degree(formula)
    squares = np.empty((MAX_PANELS if proves else 0, NODES))
    forced = 0
    kept = panels[:0]
    for _ in range(ATTEMPTS):
        number, length = build_panels(formula, loop, tolerance, panels, workspace, forced, kept, squares)
        if number == 0 or not proves:
            return number, length
        before = forced
        forced = _prove(formula, loop, tolerance, length, panels, number, squares, workspace, forced)
        if forced == before:
            return number, length
        if forced < 0:
            break
        kept = panels[:number].copy()
    return 0, math.nan


@kernel
def _prove(
    formula: Formula,
    loop: Loop,
    tolerance: float,
    length: float,
    panels: Records,
    number: int,
    squares: FloatArray,
    workspace: Workspace,
    forced: int,
) -> int:
    """Fill in PROVED; put panels on which it is too large among the coarse ones; return how many there are.

    The number is −1 if there are too many.
    """
    middles, left_out = np.empty((PANELS_TOGETHER, 3)), np.empty(PANELS_TOGETHER)
    at_once = np.empty(PANELS_TOGETHER, dtype=np.int64)
    here = 0
    for n in range(number):
        panel = panels[n]
        if math.isnan(panel.proved):
            middles[here, 0], middles[here, 1] = panel.anchor, 0.5 * (panel.low + panel.high)
            middles[here, 2] = 0.5 * (panel.high - panel.low)
            at_once[here] = n
            here += 1
        if here < PANELS_TOGETHER and n < number - 1:
            continue
        bound_left_out(formula, loop, middles, here, workspace.discs, left_out)
        for k in range(here):
            panel = panels[at_once[k]]
            unseen, seen = _prove_one(panel, middles[k, 2], left_out[k], squares[at_once[k]])
            slack = TIME_SLACK_BY_ROOTS if loop.by_roots else TIME_SLACK
            is_good = unseen * panel.length <= slack * tolerance * length and unseen <= RATE_SLACK * tolerance
            if not ((is_good or unseen <= seen) and seen + unseen < LARGEST_ETA):
                if forced == MAX_PANELS:
                    return -1
                cut = workspace.coarse[forced]
                cut.anchor, cut.low, cut.high = panel.anchor, panel.low, panel.high
                forced += 1
        here = 0
    return forced


@kernel
def _prove_one(panel: Panel, half: float, left_out: float, squares: FloatArray) -> tuple[float, float]:
    """Fill in PROVED; return what the bounds leave open, and what is seen between the nodes."""
    rates_here = panel.slopes / half
    largest = 0.0
    for k in range(NODES):
        largest += abs(rates_here[k])
    seen, unseen = seen_between(rates_here, squares), largest * largest * left_out
    eta = seen + unseen
    # (1 − η)^(−1/2) − 1 ≤ η/2 (1 + η) up to η = 1/4.
    panel.proved = 0.5 * eta * (1.0 + eta) if eta < LARGEST_ETA else math.inf
    return unseen, seen
