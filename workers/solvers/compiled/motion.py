"""A periodic planar motion in doubles: samples at any time, with a bound of their error, and its pieces.

A motion that is smooth all along (no passage, no kink, no narrow feature) is resolved in time by the
algorithm of :func:`workers.solvers.assembly.dense.resolve_motion` around a sampler that is compiled too: the
pieces of a generation take one call and no array of Python.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.motion import COLUMNS, Estimate, PlaceError
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import Tier
from service.dynamics.reduction.window import EndKind
from service.dynamics.solution.dense_output import (
    EPSILON,
    Period,
    chebyshev_coefficients,
    chebyshev_points,
    turns_lost,
)
from workers.solvers.assembly.dense import (
    CHECKED_POINTS,
    MAX_RELATIVE_FINENESS,
    PIECE_DEGREE,
    VARIABLE_RELATIVE_ROUNDING,
    ResolvedMotion,
)
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.records import Loop, Records
from workers.solvers.compiled.time_map.sampling import sample, sample_one
from workers.solvers.compiled.workspace import own_workspace

FloatArray = NDArray[np.float64]
NODES = PIECE_DEGREE + 1
PLACES = np.concatenate([chebyshev_points(PIECE_DEGREE), CHECKED_POINTS])
"""Nodes, and places between them at which the series is compared with the motion."""
COUNT = NODES + len(CHECKED_POINTS)
TRANSFORM = np.ascontiguousarray(chebyshev_coefficients(np.eye(NODES)).T)
"""Matrix from values at the nodes, rows, to coefficients."""
SERIES_BETWEEN = np.ascontiguousarray(
    np.polynomial.chebyshev.chebvander(np.array(CHECKED_POINTS), PIECE_DEGREE)
)
"""T_k at the places between, shape (places, degree + 1)."""
ALL = np.arange(6)
FloatLike = float | FloatArray
PIECES = 128
"""Number of pieces of a dense output; a motion that needs more is resolved without this much haste."""
FORMULA_ULPS = 6.0
"""Roundings of a variable once the phase is known, in 2^-52 of itself."""


@kernel
def _resolve_piece(
    states: FloatArray, share: float, atol: float, series: FloatArray, coefficients: FloatArray
) -> tuple[bool, float]:
    """Fill in the series of one piece, shape (NODES, 6); say if it is resolved, and how far it departs.

    ``states`` has the shape (COUNT, 6); ``share`` is the scale of time over the length of the piece.
    """
    is_resolved, departure = True, 0.0
    for a in range(6):
        series[:] = 0.0
        low, high, largest = math.inf, -math.inf, 0.0
        for m in range(COUNT):
            value = states[m, a]
            low, high, largest = min(low, value), max(high, value), max(largest, abs(value))
            # NaN passes no comparison.
            if not abs(value) < math.inf:
                return False, math.nan
        # A column that vanishes, as q does, has nothing to resolve.
        if largest == 0.0:
            coefficients[:, a] = 0.0
            continue
        for m in range(NODES):
            value = states[m, a]
            for k in range(NODES):
                series[k] += TRANSFORM[m, k] * value
        for j in range(COUNT - NODES):
            value = 0.0
            for k in range(NODES):
                value += SERIES_BETWEEN[j, k] * series[k]
            departure = max(departure, abs(value - states[NODES + j, a]))
        allowed = atol + VARIABLE_RELATIVE_ROUNDING * (largest + share * (high - low))
        tail = max(abs(series[NODES - 1]), abs(series[NODES - 2]))
        is_resolved = is_resolved and tail <= allowed
        coefficients[:, a] = series
    return is_resolved, departure


@kernel
def resolve_one(
    loops: Records,
    panels: Records,
    last: float,
    pieces: int,
    atol: float,
    finest: float,
    workspaces: Records,
    rights: FloatArray,
    coefficients: FloatArray,
) -> tuple[int, float, int]:
    """Resolve the only loop's motion from 0 to ``last``, beginning with so many equal ``pieces``.

    Fill in where the pieces end, and their series, shapes (most,) and (most, NODES, 6), in no order. Return
    the number of pieces, 0 if there would be more than these or a value is not finite, the largest departure
    seen between nodes, and the number of states.
    """
    loop, moments, most = loops[0], workspaces[0].moments, len(rights)
    waiting, following = np.empty((most, 2)), np.empty((most, 2))
    for k in range(pieces):
        waiting[k, 0], waiting[k, 1] = last * k / pieces, last * (k + 1) / pieces
    waiting[pieces - 1, 1] = last
    count, done, departure, states_taken = pieces, 0, 0.0, 0
    series = np.empty(NODES)
    while count > 0:
        times, rests = np.empty(count * COUNT), np.zeros(count * COUNT)
        states = np.empty((count * COUNT, 6))
        for n in range(count):
            middle, half = 0.5 * (waiting[n, 0] + waiting[n, 1]), 0.5 * (waiting[n, 1] - waiting[n, 0])
            for m in range(COUNT):
                times[n * COUNT + m] = middle + half * PLACES[m]
        sample(loop, panels, len(panels), times, rests, ALL, moments, states)
        states_taken += count * COUNT
        halved = 0
        for n in range(count):
            left, right = waiting[n, 0], waiting[n, 1]
            share = last / (right - left)
            if done + 2 * halved + 2 + (count - n) > most:
                return 0, departure, states_taken
            is_good, far = _resolve_piece(
                states[n * COUNT : (n + 1) * COUNT], share, atol, series, coefficients[done]
            )
            if not far < math.inf:
                return 0, math.nan, states_taken
            if is_good or share > finest:
                rights[done] = right
                done += 1
                departure = max(departure, far)
                continue
            middle = 0.5 * (left + right)
            following[2 * halved, 0], following[2 * halved, 1] = left, middle
            following[2 * halved + 1, 0], following[2 * halved + 1, 1] = middle, right
            halved += 1
        waiting, following, count = following, waiting, 2 * halved
    return done, departure, states_taken


@dataclass(frozen=True, slots=True)
class Bounds:
    """The parts of the error of a sample; numbers, or arrays for many motions."""

    time: FloatLike
    """Error of t(u) within one period, wherever it is."""
    speed: FloatLike
    """Largest time derivative of any variable."""
    rate: FloatLike
    """Relative, of dt/du, which p and r inherit."""
    largest: FloatLike
    """Largest |p| or |r|."""
    moved: FloatLike
    """Error of a variable by what times are off besides, where they are off: a product at each place."""

    def error_at(self, latest: FloatLike, length: FloatLike, uncertainty: FloatLike) -> FloatArray:
        """Return the bound of any variable's error up to |t| = ``latest``, the period being known so well."""
        turns = latest / length
        # Turns times the rounding of the period's two doubles.
        late = self.time + uncertainty * turns + turns * length * EPSILON**2 + turns_lost(turns) * length
        ulps = FORMULA_ULPS * EPSILON
        return np.asarray(late * self.speed + self.moved + (self.rate + ulps) * self.largest + ulps)


@dataclass(frozen=True, slots=True)
class SpectralMotion:
    """A motion as panels of t(u), u being the phase."""

    period: Period
    loops: Records
    """The only loop, shape (1,), with its orbit."""
    panels: Records
    bounds: Bounds
    potential: Potential

    @property
    def loop(self) -> Loop:
        """Return the loop."""
        loop: Loop = self.loops[0]
        return loop

    @property
    def ends(self) -> tuple[EndKind, EndKind]:
        """Return where |g1| is smallest, where it is largest."""
        number = self._number
        if number("rotates"):
            return "pole", "equator"
        middle, half = math.atan2(number("s_middle"), number("c_middle")), number("half_width")
        lower, upper = (middle - half) / math.pi, (middle + half) / math.pi
        # v is a multiple of π at the poles, and halfway between at the equator.
        passes_pole = math.floor(lower) != math.floor(upper)
        passes_equator = math.floor(lower + 0.5) != math.floor(upper + 0.5)
        return "pole" if passes_pole else "rest", "equator" if passes_equator else "rest"

    @property
    def g1(self) -> tuple[float, float]:
        """Return g1, with its sign, at the two ends."""
        number, ends = self._number, self.ends
        # |g1| = G |sin v|^α in primed axes, and |g3| = Z |sin v|.
        power, size = (1.0, number("z")) if number("mirrored") else (number("alpha"), number("g"))
        least, most = sorted((abs(number("s_lower")), abs(number("s_upper"))))
        least, most = (0.0 if ends[0] == "pole" else least), (1.0 if ends[1] == "equator" else most)
        # The client's g1 keeps its sign, and so does the primed one; exchanged, it is the g3 of the loop.
        start = self.columns(np.zeros(1), ("g1",))[0, 0] if number("mirrored") else number("sign1")
        sign = math.copysign(1.0, start)
        return sign * size * least**power + 0.0, sign * size * most**power

    def _number(self, name: str) -> float:
        # By its column: numpy takes several times longer for the items of a record, and for attributes.
        found: float = self.loops[name].item()
        return found

    def energy(self, body: RigidBody) -> Estimate:
        """Return h = (A p² + C r²)/2 + V, from a place where nothing special happens."""
        time = np.array([0.1271 * self.period.hi])
        state = self.sample(time)[0]
        kinetic = 0.5 * (float(body.A) * state[0] ** 2 + float(body.C) * state[2] ** 2)
        value = float(self.potential.value(state[3:]))
        slope = float(np.abs(self.potential.gradient(state[3:])).sum())
        error = 2.0 * kinetic * self.bounds.rate + 8.0 * EPSILON * (kinetic + abs(value) + slope)
        return Estimate(kinetic + value, error, "estimate")

    def sample(self, times: FloatArray, rests: FloatArray | None = None) -> FloatArray:
        """Return p, q, r, g1, g2, g3 at ``times`` (n,), shape (n, 6); with ``rests``, at the sums of both."""
        return self._sample(times, np.zeros(len(times)) if rests is None else rests, ALL)

    def columns(self, times: FloatArray, names: Sequence[str]) -> FloatArray:
        """Return the variables of these names at ``times`` (n,), shape (n, len(names))."""
        return self._sample(
            times, np.zeros(len(times)), np.array([COLUMNS.index(name) for name in names], dtype=np.int64)
        )

    def resolved(self, pieces: int, atol: float) -> ResolvedMotion | None:
        """Return one period in pieces, from so many on; None if :func:`.resolve_motion` has to do it."""
        ends, series = np.empty(PIECES), np.empty((PIECES, NODES, 6))
        done, departure, states = resolve_one(
            self.loops,
            self.panels,
            self.period.hi,
            pieces,
            atol,
            MAX_RELATIVE_FINENESS,
            own_workspace(),
            ends,
            series,
        )
        if not done:
            return None
        # Where none was halved they are in order.
        order = slice(done) if done == pieces else np.argsort(ends[:done])
        breaks = np.empty(done + 1)
        breaks[0], breaks[1:] = 0.0, ends[order]
        return ResolvedMotion(breaks, series[order].copy(), departure, states)

    def error_at(self, times: FloatArray) -> float:
        """Return the bound of the absolute error of any variable at any of ``times``."""
        latest = max(float(times.max()), -float(times.min())) if len(times) else 0.0
        return float(self.bounds.error_at(latest, self.period.hi, self.period.error))

    def place_error(self, tier: Tier, *, ends: int) -> PlaceError:
        """Return the errors of γ within a period, as the kernel of a tier bounds them.

        Errors of panels add up to those of times and of the period alike, but in the tier ``high``: wherever
        a place is, it is late by a part of them.
        """
        late = float(self.bounds.time) + (self.period.error if tier == "high" else 0.0)
        late += EPSILON**2 * self.period.hi
        return PlaceError(late, ends, float(self.bounds.moved), FORMULA_ULPS * EPSILON)

    def _sample(self, times: FloatArray, rests: FloatArray, columns: NDArray[np.int64]) -> FloatArray:
        times = np.ascontiguousarray(times, dtype=np.float64)
        rests = np.ascontiguousarray(rests, dtype=np.float64)
        out = np.empty((len(times), len(columns)))
        sample_one(self.loops, self.panels, times, rests, columns, own_workspace(), out)
        return out
