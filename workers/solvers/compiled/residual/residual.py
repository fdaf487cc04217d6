"""Residuals of a function of time in the six equations, bounded on all of every piece by compiled code.

It is what :mod:`service.dynamics.defect` computes for a function of time that keeps its claim, with the same
theorem, points and ellipse: pieces are cut until F is bounded about each stretch so well that interpolation
leaves out less than the goal, D is summed up from stretch to stretch, and the integrals are compared at all
points. What is not settled here, or breaks a bound, is left to it (:mod:`service.dynamics.defect.evidence`
says by how much a claim is too small): here no claim is ever changed.
"""

import math
from math import inf, isfinite

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.defect.accumulation import ELLIPSE_RHO, SERIES_RELATIVE_ROUNDING
from service.dynamics.defect.evidence import MIN_TRUNCATION, TRUNCATION_SHARE, ResidualEvidence
from service.dynamics.equations.euler_poisson import moments_of
from service.dynamics.identity_cache import IdentityCache
from service.dynamics.motion import Estimate
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.solution.dense_output import DenseOutput
from workers.solvers.compiled.evaluation.interpreter import new_registers
from workers.solvers.compiled.evaluation.program import make_program
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.lanes import (
    ROW,
    first_row,
    new_rows,
    number_at,
    place_of,
    put,
    put_number,
    take,
)
from workers.solvers.compiled.records import Equations
from workers.solvers.compiled.residual.nodes import (
    HALVES,
    HIGHEST_DEGREE,
    PLACES,
    STATE,
    TAILS,
    WIDTH,
    evaluate,
    in_lanes,
    integrals_on,
    largest_rates,
    put_distances,
    put_gains,
    put_part_states,
    put_series,
    put_whole_states,
    whole_disc,
)
from workers.solvers.compiled.workspace import two_sum

FloatArray = NDArray[np.float64]
MAX_CUTS = 8
"""Cuts of a piece into halves."""
CUT_PARTS = 2
SHORTEST_SHARE = 1e-3
"""Share, of the time that may be left out, below which a stretch is not cut any more."""
STATE_ROUNDING = 2.0**-50
"""Rounding error of a state, relative to its size."""
SKIPPED_SHARE = 1e-12
"""Share of the time, next to poles, on which forces may have no bound."""


@kernel
def disc_of(
    series: FloatArray,
    middle: float,
    half: float,
    sum_of_axes: float,
    centres: FloatArray,
    radii: FloatArray,
    T: FloatArray,
) -> None:
    """Fill in discs that hold the six polynomials, shape (degree + 1, 6), on an ellipse of a stretch."""
    count = len(series)
    # The ellipse lies in a disc of its larger semi-axis.
    s = 0.5 * (sum_of_axes + 1.0 / sum_of_axes) * half
    rho = 1.0 + s + math.sqrt(s * (2.0 + s))
    T[0, 0], T[1, 0], T[0, 1], T[1, 1] = 1.0, middle, 0.0, 1.0
    for k in range(2, count):
        T[k, 0] = 2.0 * middle * T[k - 1, 0] - T[k - 2, 0]
        T[k, 1] = 2.0 * T[k - 1, 0] + 2.0 * middle * T[k - 1, 1] - T[k - 2, 1]
    for a in range(6):
        centre, total, slope, steep, first, second = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        up = 1.0
        for k in range(count):
            size = abs(series[k, a])
            centre += T[k, 0] * series[k, a]
            slope += T[k, 1] * series[k, a]
            total += size
            if k > 0:
                steep += k * k * size
                first += k * k * up * size
                second += k * k * (k * k - 1.0) / 3.0 * (up / rho if k > 1 else 1.0) * size
                up *= rho
        slope = abs(slope) + SERIES_RELATIVE_ROUNDING * steep
        wide = min(s * first, s * slope + 0.5 * s * s * second) * (1.0 + SERIES_RELATIVE_ROUNDING)
        centres[a], radii[a] = centre, wide + SERIES_RELATIVE_ROUNDING * total


@kernel
def are_explained(
    equations: Equations,
    discs: FloatArray,
    states: FloatArray,
    integrals: FloatArray,
    count: int,
    claim: float,
    reference: FloatArray,
    slack: float,
) -> tuple[bool, float]:
    """Say whether an error ``claim`` of each state explains its integrals; return the largest departure too.

    Where the kinetic energy alone does not, V and all others are bounded on discs about the state.
    """
    drift = 0.0
    centres, radii, found = np.empty(6), np.empty(6), np.empty((2, 3))
    for m in range(count):
        energy, areas, length = slack, 0.0, 0.0
        for a in range(3):
            omega, gamma = abs(states[a, m]), abs(states[3 + a, m])
            energy += claim * omega * equations.moments[a]
            areas += claim * (omega + gamma) * equations.moments[a]
            length += claim * 2.0 * gamma
        far, astray, long = (
            abs(integrals[0, m] - reference[0]),
            abs(integrals[1, m] - reference[1]),
            abs(integrals[2, m] - reference[2]),
        )
        if not (far < math.inf and astray < math.inf and long < math.inf):
            return False, math.nan
        drift = max(drift, far, astray, long)
        if far <= energy and astray <= areas and long <= length:
            continue
        for a in range(6):
            centres[a], radii[a] = states[a, m], claim + STATE_ROUNDING * abs(states[a, m])
        integrals_on(equations, discs, centres, radii, found)
        for k in range(3):
            if not abs(found[0, k] - reference[k]) <= found[1, k] + (slack if k == 0 else 0.0):
                return False, drift
    return True, drift


@kernel
def samples_are_explained(
    equations: Equations, samples: FloatArray, claim: float, reference: FloatArray, slack: float
) -> bool:
    """Say whether an error ``claim`` explains the integrals of all samples, shape (n, 6)."""
    code = equations.gradient.code
    registers, discs = new_registers(code, 1, WIDTH), new_registers(code, 2, 1)
    states, rates, integrals = np.empty((6, WIDTH)), np.empty((6, WIDTH)), np.empty((3, WIDTH))
    for begin in range(0, len(samples), WIDTH):
        count = min(WIDTH, len(samples) - begin)
        for m in range(count):
            for a in range(6):
                states[a, m] = samples[begin + m, a]
        evaluate(equations, registers, states, rates, integrals, count)
        is_good, _ = are_explained(equations, discs, states, integrals, count, claim, reference, slack)
        if not is_good:
            return False
    return True


@kernel
def _level_for(bounds: FloatArray, share: float) -> int:
    """Return the number of points that leaves out no more than ``share`` in a unit of time; -1 for none."""
    for level in range(len(TAILS)):
        is_settled = True
        for a in range(STATE):
            is_settled = is_settled and TAILS[level] * bounds[a] <= share
        if is_settled:
            return level
    return -1


@kernel
def hold(
    equations: Equations,
    breaks: FloatArray,
    coefficients: FloatArray,
    degrees: int,
    goal: float,
    allowed: float,
    compares: bool,
    claim: float,
    reference: FloatArray,
    slack: float,
    skipped: float,
) -> tuple[bool, float, float]:
    """Say whether a run from 0 on keeps all bounds; return the bound of |D| and the largest drift too.

    Shapes are (pieces + 1,) and (pieces, at least ``degrees``, LANES). On no stretch may D grow by more than
    ``allowed``. If ``compares``, D may nowhere be beyond twice the ``claim``, and an error ``claim`` explains
    what the integrals do about the ``reference``; their drift is that at the nodes. ``goal`` is what
    interpolation may leave out in all, ``skipped`` the share of the time on which F may have no bound: there
    D stays what it is.
    """
    code = equations.gradient.code
    registers, discs = new_registers(code, 1, WIDTH), new_registers(code, 2, 1)
    states, rates, integrals = np.empty((STATE, WIDTH)), np.empty((STATE, WIDTH)), np.empty((3, WIDTH))
    centres, radii, bounds = np.empty(STATE), np.empty(STATE), np.empty(STATE)
    T, waiting = np.empty((HIGHEST_DEGREE + 1, 2)), np.empty((CUT_PARTS * MAX_CUTS + 1, 2))
    gained, lost, first, missing = np.zeros(STATE), np.zeros(STATE), np.empty(STATE), np.zeros(STATE)
    kept = new_rows(2 * WIDTH + 10 * PLACES + 2)
    at_nodes = first_row(kept)
    slopes_at = at_nodes + ROW * WIDTH
    few = slopes_at + ROW * WIDTH
    even = few + 2 * ROW
    odd, integral = even + ROW * PLACES, even + 2 * ROW * PLACES
    own, room = even + 4 * ROW * PLACES, even + 6 * ROW * PLACES
    if degrees > HIGHEST_DEGREE + 1:
        return False, math.nan, math.nan
    rows = place_of(coefficients)
    share, left_out, most = goal / abs(breaks[-1]), 0.0, skipped * abs(breaks[-1])
    defect, drift, is_first = 0.0, 0.0, True
    for n in range(len(breaks) - 1):
        series = rows + ROW * coefficients.shape[1] * n
        waiting[0, 0], waiting[0, 1] = 0.0, 1.0
        left = 1
        while left > 0:
            left -= 1
            middle, half = waiting[left, 0], waiting[left, 1]
            if half == 1.0:
                whole_disc(series, degrees, few, centres, radii)
            else:
                disc_of(coefficients[n, :degrees], middle, half, ELLIPSE_RHO, centres, radii, T)
            largest_rates(equations, discs, centres, radii, bounds)
            level = _level_for(bounds, share)
            if level < 0:
                span = abs(breaks[n + 1] - breaks[n]) * half
                if half < 0.5 * CUT_PARTS ** (1.0 - MAX_CUTS) or span < SHORTEST_SHARE * most:
                    left_out += span
                    if not left_out <= most:
                        return False, math.nan, math.nan
                    put_part_states(series, degrees, middle, half, 0, at_nodes)
                    for a in range(STATE):
                        started = number_at(at_nodes, 2 * HALVES[0], a)
                        if is_first:
                            first[a] = started
                        gained[a], rest = two_sum(gained[a], number_at(at_nodes, 0, a) - started)
                        lost[a] += rest
                    is_first = False
                    continue
                for k in range(CUT_PARTS):
                    waiting[left + k, 0] = middle + (CUT_PARTS - 1.0 - 2.0 * k) * half / CUT_PARTS
                    waiting[left + k, 1] = half / CUT_PARTS
                left += CUT_PARTS
                continue
            if half != 1.0:
                # What is not a whole piece has no series of its own: its points must resolve it.
                level = len(TAILS) - 1
            count = 2 * HALVES[level] + 1
            if half == 1.0:
                put_whole_states(series, degrees, level, at_nodes, room)
            else:
                put_part_states(series, degrees, middle, half, level, at_nodes)
            for m in range(count):
                for a in range(STATE):
                    states[a, m] = number_at(at_nodes, m, a)
            evaluate(equations, registers, states, rates, integrals, count)
            if compares:
                is_good, far = are_explained(
                    equations, discs, states, integrals, count, claim, reference, slack
                )
                if not is_good:
                    return False, math.nan, math.nan
                drift = max(drift, far)
            for m in range(count):
                for a in range(STATE):
                    put_number(slopes_at, m, a, rates[a, m])
            time = 0.5 * (breaks[n + 1] - breaks[n]) * half
            begin = at_nodes + ROW * (count - 1)
            mine, owned = series, degrees
            if half != 1.0:
                put_series(at_nodes, level, room, even, odd)
                for k in range(count):
                    put(own, k, take(even if k % 2 == 0 else odd, k // 2))
                mine, owned = own, count
            put_series(slopes_at, level, room, even, odd)
            put_gains(even, odd, level, time, integral, few)
            put_distances(mine, owned, integral, count + 1, begin, few)
            for a in range(STATE):
                step, within, started = number_at(few, 0, a), number_at(few, 1, a), number_at(begin, 0, a)
                tail = 2.0 * abs(time) * TAILS[level] * bounds[a]
                if not within + tail <= allowed:
                    return False, math.nan, math.nan
                if is_first:
                    first[a] = started
                # D at the beginning of the stretch.
                before = (started - first[a]) - gained[a] - lost[a]
                size = abs(before) + within + tail + missing[a]
                if not size < math.inf:
                    return False, math.nan, math.nan
                defect = max(defect, size)
                missing[a] += tail
                gained[a], rest = two_sum(gained[a], step)
                lost[a] += rest
            is_first = False
    # Up to here the rows have an owner.
    kept[0, 0] = 0.0
    return not compares or defect <= 2.0 * claim, defect, drift


def kept_claim(
    body: RigidBody, potential: Potential, dense: DenseOutput, claim: float, energy: Estimate
) -> ResidualEvidence | None:
    """Return what a planar ``dense`` shows if that is within ``claim``; None if it is not settled."""
    degree = dense.coefficients.shape[1] - 1
    equations = _equations(body, potential)
    if equations is None or not 0 < degree <= HIGHEST_DEGREE or dense.breaks[0] != 0.0:
        return None
    goal = max(TRUNCATION_SHARE * claim, MIN_TRUNCATION * float(np.abs(dense.coefficients).max(initial=1.0)))
    for skipped in (0.0, SKIPPED_SHARE):
        is_kept, defect, drift = hold(
            equations,
            dense.breaks,
            in_lanes(dense.coefficients),
            degree + 1,
            goal,
            inf,
            True,
            claim,
            _reference(energy),
            energy.error,
            skipped,
        )
        if is_kept or isfinite(defect):
            return ResidualEvidence(defect, drift, 1.0 - skipped, claim) if is_kept else None
    return None


def samples_keep_claim(
    body: RigidBody, potential: Potential, samples: FloatArray, claim: float, energy: Estimate
) -> bool:
    """Say whether the integrals of planar ``samples``, shape (n, 6), are explained by an error ``claim``."""
    equations = _equations(body, potential)
    if equations is None:
        return False
    return samples_are_explained(
        equations, np.ascontiguousarray(samples), claim, _reference(energy), energy.error
    )


def _equations(body: RigidBody, potential: Potential) -> Equations | None:
    try:
        program, constants = make_program(potential.tape)
    except NoClosedFormError:
        return None
    return Equations(program.gradient, constants, _moments_of(body))


def _moments(body: RigidBody) -> FloatArray:
    return np.array([float(each) for each in moments_of(body)])


_moments_of = IdentityCache(_moments)


def _reference(energy: Estimate) -> FloatArray:
    """Return the integrals of a planar motion: its energy, 0 and 1."""
    return np.array([energy.value, 0.0, 1.0])
