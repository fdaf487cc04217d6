r"""The time for which doubles follow a motion: roundings that the monodromy carries on, period by period."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.dynamics.solution.dense_output import UNIT_ROUNDOFF, Period
from workers.solvers.stability.monodromy import Monodromy

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
