"""Decides whether a periodic planar motion is stable, and for how long doubles can follow it."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import Potential
from service.dynamics.reduction.start import StartingPoint
from service.dynamics.solution.dense_output import EPSILON, Period
from workers.solvers.orbits.orbit import Libration, Rotation, make_orbit
from workers.solvers.stability.hill import hill_monodromy
from workers.solvers.stability.monodromy import Monodromy

FloatArray = NDArray[np.float64]

Verdict = Literal["stable", "unstable", "marginal"]

UNIT_ROUNDOFF = EPSILON / 2.0
MAX_PERIODS = 1_000_000
"""A motion that can be trusted for as many periods is not limited by its transverse perturbations."""
TOGETHER = 8192
"""Periods that are looked at together."""
LARGEST_GROWTH = 60.0
"""Natural logarithm beyond which no tolerance matters: 26 decimal digits."""
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
    exponent: float
    """Growth per unit time, log|μ| / T."""
    exponent_error: float
    trusted_time: float | None
    """How long an integration in doubles keeps the transverse error below the tolerance, see
    :func:`trusted_time`; None if for a million periods."""


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
    monodromy = hill_monodromy(body, potential, orbit, period)
    trace, error = monodromy.trace, monodromy.error
    low, here, high = (_exponent(trace_size, period) for trace_size in _sizes(trace, error))
    return Stability(
        trace=trace,
        error=error,
        multipliers=_multipliers(trace),
        multipliers_error=_multipliers_error(trace, error),
        verdict=_verdict(trace, error),
        exponent=here,
        exponent_error=high - low + 4.0 * EPSILON * here + here * period.error / period.hi,
        trusted_time=trusted_time(monodromy, largest_speed(orbit), period, tolerance),
    )


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
    first, total, before = 0, 0.0, 0.0
    while True:
        # Some at a time: the sum often gets there soon, and a million of them do not fit into a cache.
        norms = power_norms(monodromy.matrix, MAX_PERIODS, first=first, most=TOGETHER)
        if not len(norms):
            return None
        sums = np.cumsum(np.append(total, norms))[1:] if first else np.cumsum(norms)
        reached = size * sums
        here = int(np.searchsorted(reached, tolerance))
        if here < len(reached):
            break
        first, total, before = first + len(norms), float(sums[-1]), float(reached[-1])
    after = first + here
    if after == 0:
        return 0.0
    at = np.array([before if here == 0 else reached[here - 1], reached[here]])
    low, high = np.log(at)
    return float(period.hi * (after - 1 + (math.log(tolerance) - low) / (high - low)))


def power_norms(matrix: FloatArray, count: int, *, first: int = 0, most: int | None = None) -> FloatArray:
    r"""Return Frobenius' norms of M^0, M^1, ..., M^count for a 2x2 matrix with det M = 1.

    Of these only those from M^first on, and at most so many, if that is said.

    With N the traceless part of M and tr M = ± 2 cosh χ (or 2 cos φ),

    .. math:: \pm M^k = \cosh(k\chi)\,1 + \frac{\sinh k\chi}{\sinh\chi}\,N ,

    and 1 and N are orthogonal. Powers beyond the growth exp(LARGEST_GROWTH) are left out.
    """
    last = count if most is None else min(count, first + most - 1)
    half = 0.5 * float(np.trace(matrix))
    rest = float(np.linalg.norm(matrix - half * np.eye(2)))
    size = abs(half)
    if size > 1.0:
        chi = math.acosh(size)
        k = np.arange(first, min(last, int(LARGEST_GROWTH / chi) + 2) + 1)
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


def largest_speed(orbit: Libration | Rotation) -> float:
    """Return about the largest |(p, r)| on an orbit."""
    phases = (2 * arb.pi() * (k + arb(0.5)) / SPEED_PHASES for k in range(SPEED_PHASES))
    states = (orbit.state(theta) for theta in phases)
    return max(math.hypot(float(state[0]), float(state[2])) for state in states)


def _verdict(trace: float, error: float) -> Verdict:
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
