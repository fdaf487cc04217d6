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
from service.dynamics.reduction.window import StartingPoint
from service.dynamics.solution.dense_output import EPSILON, UNIT_ROUNDOFF, Period
from workers.solvers.errors import PrecisionLostError
from workers.solvers.orbits.orbit import Libration, Rotation, make_orbit
from workers.solvers.stability.monodromy import Monodromy, turn_monodromy

FloatArray = NDArray[np.float64]

MAX_PERIODS = 2**20
"""A motion that can be trusted for as many periods is not limited by its perturbations."""


@np.errstate(all="ignore")
def trusted_time(
    monodromy: FloatArray,
    excursion: float,
    speed: float,
    period: float,
    tolerance: float,
    roundoff: float = UNIT_ROUNDOFF,
) -> float | None:
    r"""Return how long roundings, carried on by the linear equation, stay below ``tolerance``.

    One rounding of the state is charged to every period. In units of ω₀ = 2π/T
    it has the size δ = roundoff · max(1, speed/ω₀), and after n periods at most

    .. math:: E_n = \delta\,\max(1, \omega_0)\,e \sqrt{(n + 1) \sum_{k=0}^{n} \|M^k\|^2}
                  \ge \delta\,\max(1, \omega_0)\,e \sum_{k=0}^{n} \|M^k\|

    is reached in the variables of M, of any number, e the ``excursion`` within a period. The sum of so many
    squares M^kᵀ M^k = Rᵀ R follows from that of half as many; R loses half the digits that the sum itself
    would lose, and its trace is never negative. The
    time is nT with E_n = tolerance, log E interpolated linearly in n. For an
    unstable motion that is about log(tolerance / δ) / exponent, for a stable
    one proportional to tolerance / δ, for a marginal one with a Jordan block to
    its square root. None if E stays below ``tolerance`` for MAX_PERIODS.
    """
    frequency = 2.0 * math.pi / period
    size = roundoff * max(1.0, speed / frequency) * max(1.0, frequency) * excursion
    one = np.eye(len(monodromy))
    doubled = [(monodromy, one)]
    for _ in range(MAX_PERIODS.bit_length() - 1):
        power, root = doubled[-1]
        doubled.append((power @ power, np.linalg.qr(np.vstack([root, root @ power])).R))

    def later(count: int, power: FloatArray, total: float, by: int) -> tuple[float, float]:
        """Return the trace of the first ``count`` squares and 2^by more, and E there."""
        total = total + float(np.sum((doubled[by][1] @ power) ** 2))
        return total, size * math.sqrt((count + 2**by) * total)

    count, power, total, before = 0, one, 0.0, 0.0
    for by in reversed(range(len(doubled))):
        more, reached = later(count, power, total, by)
        if reached < tolerance:
            count, power, total, before = count + 2**by, doubled[by][0] @ power, more, reached
    if count >= MAX_PERIODS:
        return None
    if count == 0:
        return 0.0
    _, reached = later(count, power, total, 0)
    share = math.log(tolerance / before) / math.log(reached / before) if math.isfinite(reached) else 0.0
    return period * (count - 1 + share)


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
    return turn_monodromy(system.matrix, orbit)


Verdict = Literal["stable", "unstable", "marginal"]
Proof = Literal["theorem", "estimate"]
"""The kinds of :data:`service.dynamics.numerics.ErrorKind` that a trace may be known by."""

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
    trusted_time_proof: Proof = "estimate"
    """``theorem``: a rounding at the beginning of every period keeps it, by the equations of variation."""
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
    horizon = trusted_time(monodromy.matrix, monodromy.excursion, speed, period.hi, tolerance)
    return of_trace(monodromy.trace, monodromy.error, period, horizon)


def of_trace(trace: float, error: float, period: Period, horizon: float | None) -> Stability:
    """Return what a trace with this error tells, beside the trusted time ``horizon``."""
    low, here, high = (_exponent(abs(trace) + by, period) for by in (-error, 0.0, error))
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


def _exponent(size: float, period: Period) -> float:
    """Return log|μ| / T for |trace| = ``size``."""
    return math.acosh(max(1.0, 0.5 * size)) / period.hi
