r"""For how long doubles can follow a motion: roundings that the monodromy carries on, period by period."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.dynamics.solution.dense_output import EPSILON, Period
from workers.solvers.stability.monodromy import Monodromy

FloatArray = NDArray[np.float64]

UNIT_ROUNDOFF = EPSILON / 2.0
MAX_PERIODS = 1_000_000
"""A motion that can be trusted for as many periods is not limited by its transverse perturbations."""
TOGETHER = 1024
"""Periods that are looked at together."""
LARGEST_GROWTH = 60.0
"""Natural logarithm beyond which no tolerance matters: 26 decimal digits."""
HARMONICS = 512
ROUNDEST = 32.0
"""Ratio of the axes up to which so many harmonics leave out less than 1e-14: they fall by 31/33 each."""
MOST_STEPS = 64
"""From where the mean growth leads to the period asked for; after more, all periods are gone through."""


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
    first, total, before = 0, 0.0, 0.0
    while True:
        # Some at a time: the sum often gets there soon, and a million of them do not fit into a cache.
        norms = power_norms(matrix, MAX_PERIODS, first=first, most=TOGETHER)
        if not len(norms):
            return None
        sums = np.cumsum(np.append(total, norms))[1:] if first else np.cumsum(norms)
        reached = size * sums
        here = int(np.searchsorted(reached, tolerance))
        if here < len(reached):
            return first + here, before if here == 0 else float(reached[here - 1]), float(reached[here])
        if not first:
            rotating = rotating_norms(matrix)
            found = None if rotating is None else rotating.reach(tolerance / size, TOGETHER)
            if rotating is not None and found is not None:
                if found > MAX_PERIODS:
                    return None
                return found, size * rotating.total(found - 1), size * rotating.total(found)
        first, total, before = first + len(norms), float(sums[-1]), float(reached[-1])


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


@dataclass(frozen=True, slots=True)
class RotatingNorms:
    r"""The norms of powers of a stable M, \|M^k\| = f(kφ), f(x) = Σ a_m cos 2mx, and their sums."""

    phi: float
    harmonics: FloatArray
    """a_m, shape (HARMONICS,)."""

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

    def reach(self, goal: float, least: int) -> int | None:
        """Return the first n ≥ ``least`` with a total ≥ ``goal``, MAX_PERIODS + 1 if it is later than that.

        None if it is not found in a few steps. The total grows, by the mean of f but for oscillations.
        """
        if self.total(MAX_PERIODS) < goal:
            return MAX_PERIODS + 1
        mean, n = float(self.harmonics[0]), least
        for _ in range(MOST_STEPS):
            missing = goal - self.total(n)
            step = math.floor(missing / mean)
            if missing > 0.0:
                n += max(1, step)
            elif self.total(n - 1) < goal:
                return n
            else:
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
    if not 1.0 / ROUNDEST <= ratio <= ROUNDEST:
        return None
    x = np.arange(2 * HARMONICS) * (np.pi / (2 * HARMONICS))
    values = np.fft.rfft(np.hypot(math.sqrt(2.0) * np.cos(x), rest * np.sin(x))).real / HARMONICS
    values[0] *= 0.5
    return RotatingNorms(phi, values[:HARMONICS])
