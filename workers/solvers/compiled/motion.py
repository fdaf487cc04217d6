"""A periodic planar motion in doubles: samples at any time, with a bound of their error."""

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
from service.dynamics.solution.dense_output import EPSILON, Period, turns_lost
from workers.solvers.assembly.dense import MAX_RELATIVE_FINENESS, ResolvedMotion
from workers.solvers.compiled.records import Loop, Records
from workers.solvers.compiled.time_map.pieces import NODES, resolve_one
from workers.solvers.compiled.time_map.sampling import sample_one
from workers.solvers.compiled.workspace import own_workspace

FloatArray = NDArray[np.float64]

FloatLike = float | FloatArray
ALL = np.arange(6)
PIECES = 128
"""Number of pieces of a dense output; a motion that needs more is resolved without this much haste."""
FORMULA_ULPS = 6.0
"""Roundings of a variable once the phase is known, in 2^-52 of itself."""


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
