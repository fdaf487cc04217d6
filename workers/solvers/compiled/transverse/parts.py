"""Parts of the panels of a time map, crossed by collocation, with what their errors are made of, compiled."""

import math

import numpy as np
from numpy.typing import NDArray

from service.dynamics.solution.dense_output import EPSILON
from workers.solvers.compiled.evaluation.curve import place, radicands_with_bounds
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import NODES, Formula, Loop, Panel, Records
from workers.solvers.compiled.time_map.series import POINTS, at, distance, last_coefficients
from workers.solvers.compiled.transverse.hill import WIDTH, coefficients
from workers.solvers.compiled.transverse.steps import STAGES, WEIGHTS, cross
from workers.solvers.compiled.workspace import Places

FloatArray = NDArray[np.float64]

RATE_PLACES, INTERPOLATION_FACTOR = 8, 2.0
"""Places of a panel where the rounding of P is bounded; factor by which interpolation amplifies it."""
POLE_PHASE_DISTANCES = (2.0**-16, 2.0**-26)
"""Distances from a pole, in θ."""
FARTHEST_POLE = 0.99
"""Largest distance of a pole from the middle of a libration, in parts of the half width."""
Q, M, ALPHA, BETA, C, C_ERROR, RELATIVE, ALPHA_ERROR, BETA_ERROR, ROWS = 0, 2, 4, 5, 6, 7, 8, 9, 10, 11
"""Rows of stages: q and M/(B ω) of both solutions, the coefficients, c, and errors, multiplied by weights."""


@inlined
def _put(loop: Loop, places: Places, k: int, anchor: int, w: float) -> None:
    places.below[k], places.above[k], places.sine[k], places.cosine[k], places.speed[k] = place(
        loop, anchor, w
    )


@kernel
def doubt_of_ends(formula: Formula, loop: Loop, places: Places, panels: Records, number: int) -> float:
    """Return by how much the ends of a libration, zeros of P, may be wrong in v."""
    if loop.rotates:
        return 0.0
    places.sine[0], places.cosine[0] = loop.s_lower, loop.c_lower
    places.sine[1], places.cosine[1] = loop.s_upper, loop.c_upper
    radicands_with_bounds(formula, loop, places, 2)
    doubt = 0.0
    for k in range(2):
        panel = panels[0 if k == 0 else number - 1]
        _, slope = at(panel, panel.first if k == 0 else panel.last)
        rate = slope * 2.0 / (panel.high - panel.low)
        # dt/du = π Z/(c √K), and P' = 2 h K at the end.
        root = math.pi * loop.z / (places.c[k] * rate)
        doubt = max(doubt, places.bound[k] / (2.0 * loop.half_width * root * root))
    return doubt + EPSILON


@kernel
def error_of_rate(formula: Formula, loop: Loop, panel: Panel, places: Places) -> tuple[float, float]:
    """Return the relative error of dt/dx on a panel, and an absolute one.

    The rounding of P is looked at where the series was made. Where nothing is proved, the last coefficients
    say what a series leaves out, as for the time map (:mod:`compiled.time_map.error`).
    """
    is_half = panel.last - panel.first < 2.0
    for k in range(RATE_PLACES):
        j = 2 * k
        if is_half:
            j = k if panel.last > 0.0 else NODES - 1 - k
        _put(loop, places, k, panel.anchor, distance(panel, POINTS[j]))
    radicands_with_bounds(formula, loop, places, RATE_PLACES)
    total = 0.0
    for k in range(RATE_PLACES):
        total += places.bound[k] / abs(places.radicand[k])
    noise = INTERPOLATION_FACTOR * 0.5 * total / RATE_PLACES + 8.0 * EPSILON
    if not math.isnan(panel.proved):
        return noise + panel.proved, 0.0
    return noise, 2.0 * last_coefficients(panel.slopes)


@kernel
def cross_part(
    formula: Formula,
    loop: Loop,
    panel: Panel,
    spans: tuple[float, float],
    about: tuple[float, float, float, float, float],
    moments: FloatArray,
    places: Places,
    stages: FloatArray,
    end: FloatArray,
) -> float:
    """Fill in the propagator of a part of a panel, and the rows of its ``stages``; return max p² + r².

    ``about`` are ω, B ω, the doubt of the ends, and the relative and the absolute error of dt/dx.
    """
    frequency, scale, doubt, relative, absolute = about
    middle, half = 0.5 * (spans[0] + spans[1]), 0.5 * (spans[1] - spans[0])
    alpha, beta, c, errors = stages[ALPHA], stages[BETA], stages[C], stages[C_ERROR]
    for k in range(WIDTH):
        _put(loop, places, k, panel.anchor, distance(panel, middle + half * STAGES[k]))
    fastest = coefficients(formula, loop, moments, places, c, errors)
    for k in range(WIDTH):
        _, slope = at(panel, middle + half * STAGES[k])
        alpha[k], beta[k] = frequency * (slope * half), c[k] / scale * (slope * half)
    cross(alpha, beta, stages[Q:M], stages[M:ALPHA], end)
    for k in range(WIDTH):
        j = k if k < WIDTH - 1 else k - 1
        error = errors[k]
        if doubt > 0.0:
            error += doubt * abs((c[j + 1] - c[j]) / (places.below[j + 1] - places.below[j]))
        stages[RELATIVE, k] = WEIGHTS[k] * relative
        stages[ALPHA_ERROR, k] = WEIGHTS[k] * absolute * half * frequency
        stages[BETA_ERROR, k] = (
            WEIGHTS[k] * (absolute * half * abs(c[k]) + abs(alpha[k] / frequency) * error) / scale
        )
    return fastest


@kernel
def is_integrable(
    formula: Formula,
    loop: Loop,
    scale: float,
    moments: FloatArray,
    places: Places,
    c: FloatArray,
    errors: FloatArray,
) -> bool:
    """Tell whether |c| times the distance from each pole falls towards it, as is required in balls."""
    middle = math.atan2(loop.s_middle, loop.c_middle)
    for pole in range(-1, 3):
        if loop.rotates:
            if pole < 0 or pole > 1:
                continue
            anchor, w = 2 * pole, 0.0
        else:
            share = (math.pi * pole - middle) / loop.half_width
            if abs(share) >= 1.0:
                continue
            if abs(share) > FARTHEST_POLE:
                return False
            anchor, w = 1, math.asin(share) / math.pi
        for k in range(WIDTH):
            side = 1.0 if k % 2 else -1.0
            _put(loop, places, k, anchor, w + side * POLE_PHASE_DISTANCES[(k // 2) % 2] / math.pi)
        coefficients(formula, loop, moments, places, c, errors)
        for k in range(2):
            far = max(abs(c[k]), scale) * POLE_PHASE_DISTANCES[0]
            if not abs(c[2 + k]) * POLE_PHASE_DISTANCES[1] < 0.5 * far:
                return False
    return True
