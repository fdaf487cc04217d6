r"""Decides whether a periodic planar motion is stable, and for how long doubles can follow it.

Perturbations that leave the plane obey Hill's equation. To first order they are q and the rest M of the
second Euler-Poisson equation,

.. math::
    M = (A-C) p r - g_3 V_1 + g_1 V_3,\qquad B \dot q = -M,\qquad \dot M = c(t)\,q,

.. math::
    c = (A-C)\Bigl[\frac{(B-C) r^2}{A} + \frac{(A-B) p^2}{C}\Bigr]
        - \frac{(A-C) B g_2}{Q}\Bigl[\frac{(g_2V_3-g_3V_2) g_3}{A} + \frac{(g_1V_2-g_2V_1) g_1}{C}\Bigr]
        + \Bigl(1 + \frac{B g_2^2}{Q}\Bigr) D_\varphi ,

with Q = A g1² + C g3², D = g1 V_3 − g3 V_1, D_φ = g1 ∂D/∂g3 − g3 ∂D/∂g1 and the
third integral kept zero. Four of the six multipliers of a periodic motion are 1
(two Casimir functions, the energy, the shift of time); the other two, μ and 1/μ,
are those of this equation.

Doubles follow a motion as long as the roundings that the monodromy carries on, period by period, stay small.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.potentials.potential import Potential
from service.dynamics.reduction.start import StartingPoint
from service.dynamics.solution.dense_output import EPSILON, UNIT_ROUNDOFF, Period
from workers.solvers.errors import PrecisionLostError
from workers.solvers.orbits.orbit import Libration, Rotation, make_orbit
from workers.solvers.stability.monodromy import Monodromy, turn_monodromy

FloatArray = NDArray[np.float64]

MAX_PERIODS = 1_000_000
"""A motion that can be trusted for as many periods is not limited by its transverse perturbations."""
PERIODS_TOGETHER = 1024
"""Periods that are looked at together."""
MAX_LOG_GROWTH = 60.0
"""Natural logarithm beyond which no tolerance matters: 26 decimal digits."""
MAX_AXES_RATIO = 128.0
"""Ratio of the axes up to which harmonics are summed: for rounder ones a thousand and fewer do."""
MIN_HARMONICS = 16
TRUNCATION_LOG = 32.0
"""Natural logarithm of what is left out of the harmonics: 1e-14 of the first one."""
MAX_STEPS = 64
"""Steps, at most, by the mean growth to the period asked for; after more, all periods are gone through."""


def trusted_time(
    monodromy: Monodromy, speed: float, period: Period, tolerance: float, roundoff: float = UNIT_ROUNDOFF
) -> float | None:
    r"""Return how long roundings, carried on by the linear equation, stay below ``tolerance``.

    One rounding of the state is charged to every period. In units of ω₀ = 2π/T
    it has the size δ = roundoff · max(1, speed/ω₀), and after n periods

    .. math:: E_n = \delta\,\max(1, \omega_0)\,e \sum_{k=0}^{n} \|M^k\|

    is reached in the six variables, e the ``excursion`` within a period. The
    time is nT with E_n = tolerance, log E interpolated linearly in n. For an
    unstable motion that is about log(tolerance / δ) / exponent, for a stable
    one proportional to tolerance / δ, for a marginal one with a Jordan block to
    its square root. None if E stays below ``tolerance`` for MAX_PERIODS.
    """
    frequency = 2.0 * np.pi / period.hi
    size = roundoff * max(1.0, speed / frequency) * max(1.0, frequency) * monodromy.excursion
    found = _periods(monodromy.matrix, size, tolerance)
    if found is None:
        return None
    after, before, reached = found
    if after == 0:
        return 0.0
    low, high = np.log(np.array([before, reached]))
    return float(period.hi * (after - 1 + (math.log(tolerance) - low) / (high - low)))


def _periods(matrix: FloatArray, size: float, tolerance: float) -> tuple[int, float, float] | None:
    """Return the first n with E_n ≥ ``tolerance``, E before it, and E_n; None if it is above MAX_PERIODS."""
    rotating = rotating_norms(matrix)
    if rotating is not None and size * rotating.largest * PERIODS_TOGETHER < tolerance:
        found = _late(rotating, size, tolerance)
        if found is not None:
            return found if found[0] <= MAX_PERIODS else None
    first, total, before = 0, 0.0, 0.0
    while True:
        # Some at a time: the sum often gets there soon, and a million of them do not fit into a cache.
        norms = power_norms(matrix, MAX_PERIODS, first=first, most=PERIODS_TOGETHER)
        if not len(norms):
            return None
        sums = np.cumsum(np.append(total, norms))[1:] if first else np.cumsum(norms)
        reached = size * sums
        here = int(np.searchsorted(reached, tolerance))
        if here < len(reached):
            return first + here, before if here == 0 else float(reached[here - 1]), float(reached[here])
        if not first and rotating is not None:
            found = _late(rotating, size, tolerance)
            if found is not None:
                return found if found[0] <= MAX_PERIODS else None
        first, total, before = first + len(norms), float(sums[-1]), float(reached[-1])


def _late(rotating: "RotatingNorms", size: float, tolerance: float) -> tuple[int, float, float] | None:
    """Return what :func:`_periods` does if it is known not to be among the first; None if it is not found."""
    found = rotating.reach(tolerance / size, PERIODS_TOGETHER)
    return None if found is None else (found[0], size * found[1], size * found[2])


def power_norms(matrix: FloatArray, count: int, *, first: int = 0, most: int | None = None) -> FloatArray:
    r"""Return Frobenius' norms of M^0, M^1, ..., M^count for a 2x2 matrix with det M = 1.

    Of these only those from M^first on, and at most so many, if that is said.

    With N the traceless part of M and tr M = ± 2 cosh χ (or 2 cos φ),

    .. math:: \pm M^k = \cosh(k\chi)\,1 + \frac{\sinh k\chi}{\sinh\chi}\,N ,

    and 1 and N are orthogonal. Powers beyond the growth exp(MAX_LOG_GROWTH) are left out.
    """
    last = count if most is None else min(count, first + most - 1)
    half = 0.5 * float(np.trace(matrix))
    rest = float(np.linalg.norm(matrix - half * np.eye(2)))
    size = abs(half)
    if size > 1.0:
        chi = math.acosh(size)
        k = np.arange(first, min(last, int(MAX_LOG_GROWTH / chi) + 2) + 1)
        even, odd = np.cosh(k * chi), np.sinh(k * chi) / math.sinh(chi)
    elif size < 1.0:
        phi = math.acos(size)
        k = np.arange(first, last + 1)
        even, odd = np.cos(k * phi), np.sin(k * phi) / math.sin(phi)
    else:
        odd = np.arange(first, last + 1.0)
        even = np.ones(len(odd))
    norms: FloatArray = np.hypot(math.sqrt(2.0) * even, rest * odd)
    return norms


@dataclass(frozen=True, slots=True)
class RotatingNorms:
    r"""The norms of powers of a stable M, \|M^k\| = f(kφ), f(x) = Σ a_m cos 2mx, and their sums."""

    phi: float
    harmonics: FloatArray
    """a_m, from m = 0 on."""
    largest: float
    """Largest value of f."""

    def total(self, last: int) -> float:
        r"""Return \|M^0\| + ... + \|M^last\|.

        Each harmonic is a geometric sum: Σ cos 2kδ = sin((n+1)δ) cos(nδ) / sin δ, with δ = mφ modulo π.
        """
        angles = np.arange(1, len(self.harmonics)) * self.phi
        delta = angles - np.pi * np.round(angles / np.pi)
        sine = np.sin(delta)
        safe = np.where(sine == 0.0, 1.0, sine)
        sums = np.where(sine == 0.0, last + 1.0, np.sin((last + 1) * delta) / safe * np.cos(last * delta))
        return float(self.harmonics[0] * (last + 1) + self.harmonics[1:] @ sums)

    def reach(self, goal: float, least: int) -> tuple[int, float, float] | None:
        """Return the first n ≥ ``least`` with a total ≥ ``goal``, the total before it, and the one there.

        n is MAX_PERIODS + 1 if it is later than that. None if it is not found in a few steps. The total
        grows, by the mean of f but for oscillations.
        """
        last = self.total(MAX_PERIODS)
        if last < goal:
            return MAX_PERIODS + 1, last, math.inf
        mean, n = float(self.harmonics[0]), least
        for _ in range(MAX_STEPS):
            here = self.total(n)
            missing = goal - here
            step = math.floor(missing / mean)
            if missing > 0.0:
                n += max(1, step)
            else:
                before = self.total(n - 1)
                if before < goal:
                    return n, before, here
                n += min(-1, step + 1)
            n = min(max(n, least), MAX_PERIODS)
        return None


def rotating_norms(matrix: FloatArray) -> RotatingNorms | None:
    """Return the norms of all powers of M; None if M is not stable, or all but a shear."""
    half = abs(0.5 * float(np.trace(matrix)))
    if not half < 1.0:
        return None
    phi = math.acos(half)
    rest = float(np.linalg.norm(matrix - 0.5 * float(np.trace(matrix)) * np.eye(2))) / math.sin(phi)
    ratio = rest / math.sqrt(2.0)
    if not 1.0 / MAX_AXES_RATIO <= ratio <= MAX_AXES_RATIO:
        return None
    count = _harmonics_of(max(ratio, 1.0 / ratio))
    x = np.arange(2 * count) * (np.pi / (2 * count))
    values = np.fft.rfft(np.hypot(math.sqrt(2.0) * np.cos(x), rest * np.sin(x))).real / count
    values[0] *= 0.5
    return RotatingNorms(phi, values[:count], max(math.sqrt(2.0), rest))


def _harmonics_of(ratio: float) -> int:
    """Return how many are needed for axes of this ratio ≥ 1, a power of two.

    f² is 0 where exp(2ix) = ±(ratio + 1)/(ratio − 1): the a_m fall by that much each.
    """
    needed = TRUNCATION_LOG / math.log((ratio + 1.0) / (ratio - 1.0)) if ratio > 1.0 else 0.0
    return max(MIN_HARMONICS, 1 << math.ceil(math.log2(max(needed, 1.0))))


COEFFICIENT_BITS = 56
"""Bits to which c is known, in parts of the larger of itself and of B ω²."""


@dataclass(frozen=True, slots=True)
class HillSystem:
    """y = (q, M/(B ω)) with ω = 2π/T: two angular velocities."""

    A: arb
    B: arb
    C: arb
    potential: Potential
    orbit: Libration | Rotation
    frequency: arb
    """ω."""

    def matrix(self, theta: arb) -> FloatArray:
        """Return A(θ) of dy/dθ = A(θ) y; raises PrecisionLostError."""
        c = self.coefficient(self.orbit.state(theta))
        scale = self.B * self.frequency
        if not c.rad() * arb(2) ** COEFFICIENT_BITS <= abs(c.mid()) + scale * self.frequency:
            raise PrecisionLostError(f"Hill's coefficient is known to fewer than {COEFFICIENT_BITS} bits")
        rate = self.orbit.rate(theta)
        return np.array([[0.0, -float(rate * self.frequency)], [float(rate * c / scale), 0.0]])

    def coefficient(self, state: Sequence[arb]) -> arb:
        """Return c at a state (p, q, r, g1, g2, g3) of a planar motion, not at a pole."""
        p, _, r, g1, g2, g3 = state
        A, B, C = self.A, self.B, self.C
        _, (V_1, V_2, V_3), ((V_11, _, V_13), _, (_, _, V_33)) = self.potential.jet_ball(g1, g2, g3)
        Q = A * g1 * g1 + C * g3 * g3
        D_phi = g1 * g1 * V_33 - 2 * g1 * g3 * V_13 + g3 * g3 * V_11 - g1 * V_1 - g3 * V_3
        gyration = (B - C) * r * r / A + (A - B) * p * p / C
        torque = (g2 * V_3 - g3 * V_2) * g3 / A + (g1 * V_2 - g2 * V_1) * g1 / C
        return (A - C) * (gyration - B * g2 / Q * torque) + (1 + B * g2 * g2 / Q) * D_phi


def hill_monodromy(
    body: RigidBody, potential: Potential, orbit: Libration | Rotation, period: Period
) -> Monodromy:
    """Return the monodromy of (q, M/(B ω)), ω = 2π/T, over a period, from θ = 0.

    Raises
    ------
    MissingMomentError
        The body has no B.
    StabilityUndefinedError
        The motion passes a pole at which V is not smooth enough.
    QuadratureNotConvergedError, PrecisionLostError
        c is not resolved, or not known to a double's precision.
    """
    B = ball(body.require_B("stability"))
    frequency = 2 * arb.pi() / (arb(period.hi) + arb(period.lo))
    system = HillSystem(ball(body.A), B, ball(body.C), potential, orbit, frequency)
    return turn_monodromy(system, orbit)


Verdict = Literal["stable", "unstable", "marginal"]
Proof = Literal["theorem", "estimate"]
"""The kinds of :data:`service.dynamics.bounds.ErrorKind` that a trace may be known by."""

SPEED_PHASES = 16


@dataclass(frozen=True, slots=True)
class Stability:
    """The transverse multipliers μ and 1/μ of a periodic planar motion."""

    trace: float
    """μ + 1/μ over the period of the six variables."""
    error: float
    """Bound of the absolute error of the trace."""
    multipliers: tuple[complex, complex]
    """The larger |μ| first, or the one with Im μ > 0."""
    multipliers_error: float
    """Bound of the absolute error of either."""
    verdict: Verdict
    """Linearly stable if |trace| < 2, unstable if > 2; marginal if the error does not tell, as where
    the multipliers are exactly 1: for every B if the energy does not depend on λ."""
    proof: Proof
    """The way in which ``error`` is known, hence the verdict and what else follows from the trace."""
    exponent: float
    """Growth per unit time, log|μ| / T."""
    exponent_error: float
    trusted_time: float | None
    """How long an integration in doubles keeps the transverse error below the tolerance, see
    :func:`trusted_time`; None if for a million periods."""
    enclosed: arb | None = None
    """The trace, if it is proven."""


def assess_stability(
    body: RigidBody, potential: Potential, start: StartingPoint, period: Period, tolerance: float
) -> Stability:
    """Assess the periodic motion through ``start``, at the current precision (that of ``start``).

    ``tolerance`` is the absolute error of the six variables that ``trusted_time`` refers to.

    Raises
    ------
    MissingMomentError
        The body has no B.
    StabilityUndefinedError
        The motion passes a pole at which the potential is not smooth enough.
    QuadratureNotConvergedError, PrecisionLostError
        The equation is not resolved, or not known to a double's precision.
    """
    orbit = make_orbit(start)
    return assess(hill_monodromy(body, potential, orbit, period), largest_speed(orbit), period, tolerance)


def assess(monodromy: Monodromy, speed: float, period: Period, tolerance: float) -> Stability:
    """Assess the motion with this monodromy, ``speed`` being about its largest |(p, r)|."""
    horizon = trusted_time(monodromy, speed, period, tolerance)
    return of_trace(monodromy.trace, monodromy.error, period, horizon)


def of_trace(trace: float, error: float, period: Period, horizon: float | None) -> Stability:
    """Return what a trace with this error tells, beside the trusted time ``horizon``."""
    low, here, high = (_exponent(trace_size, period) for trace_size in _sizes(trace, error))
    return Stability(
        trace=trace,
        error=error,
        multipliers=_multipliers(trace),
        multipliers_error=_multipliers_error(trace, error),
        verdict=verdict_of(trace, error),
        proof="estimate",
        exponent=here,
        exponent_error=high - low + 4.0 * EPSILON * here + here * period.error / period.hi,
        trusted_time=horizon,
    )


def largest_speed(orbit: Libration | Rotation) -> float:
    """Return about the largest |(p, r)| on an orbit."""
    phases = (2 * arb.pi() * (k + arb(0.5)) / SPEED_PHASES for k in range(SPEED_PHASES))
    states = (orbit.state(theta) for theta in phases)
    return max(math.hypot(float(state[0]), float(state[2])) for state in states)


def verdict_of(trace: float, error: float) -> Verdict:
    """Return what a trace with this error tells."""
    if abs(trace) + error < 2.0:
        return "stable"
    return "unstable" if abs(trace) - error > 2.0 else "marginal"


def _multipliers(trace: float) -> tuple[complex, complex]:
    """Return the roots of μ² − trace μ + 1, without cancellation."""
    square = (trace - 2.0) * (trace + 2.0)
    if square < 0.0:
        root = complex(0.5 * trace, 0.5 * math.sqrt(-square))
        return root, root.conjugate()
    larger = 0.5 * (trace + math.copysign(math.sqrt(square), trace))
    return complex(larger), complex(1.0 / larger)


def _multipliers_error(trace: float, error: float) -> float:
    """Bound it by |√a − √b| ≤ min(√|a − b|, |a − b| / √|a|), a and b the two discriminants."""
    square = abs((trace - 2.0) * (trace + 2.0))
    change = error * (2.0 * abs(trace) + error)
    root = math.sqrt(change) if change >= square else change / math.sqrt(square)
    return 0.5 * (error + root) + 2.0 * EPSILON * max(1.0, abs(trace))


def _sizes(trace: float, error: float) -> tuple[float, float, float]:
    return abs(trace) - error, abs(trace), abs(trace) + error


def _exponent(size: float, period: Period) -> float:
    """Return log|μ| / T for |trace| = ``size``."""
    return math.acosh(max(1.0, 0.5 * size)) / period.hi
