"""Time along a closed curve: t = mean · θ + Σ b_k sin kθ, and θ as a function of t."""

from dataclasses import dataclass

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.classical.loop import BITS, ReducedLoop

FloatArray = NDArray[np.float64]

NEWTON_STEPS = 60
NEGLIGIBLE = 1e-19
"""Terms of the series, relative to the mean, that doubles do not see."""


@dataclass(frozen=True, slots=True)
class Clock:
    """Time and angle of a loop, in doubles and in balls."""

    mean: arb
    """Time per radian."""
    series: tuple[arb, ...]
    """b_1, b_2, …"""
    error: arb
    """Error of the mean, as far as its last refinement changed it."""
    doubles: FloatArray
    """The series in doubles, as far as they see it."""

    @classmethod
    def of(cls, loop: ReducedLoop, speed: arb) -> "Clock":
        """Return the clock of a loop whose time runs ``speed`` times as fast as the client's."""
        with ctx.workprec(BITS):
            rates, error = loop.times()
            count = len(rates)
            cosines = [(2 * arb(k) / count).cos_pi() for k in range(count)]
            mean = sum(rates, arb(0)) / count / speed
            # The rates are even: half of them, and the two at the ends, hold the sums.
            series = list[arb]()
            for k in range(1, count // 2):
                inner = sum((rates[j] * cosines[j * k % count] for j in range(1, count // 2)), arb(0))
                ends = rates[0] + rates[count // 2] * (-1) ** k
                series.append((2 * inner + ends) * 2 / count / k / speed)
                if len(series) > 2 and all(abs(b) < arb(2) ** -120 * mean for b in series[-3:]):
                    break
            sizes = np.array([abs(float(b)) for b in series])
            seen = np.flatnonzero(sizes > NEGLIGIBLE * float(mean))
            last = int(seen[-1]) + 1 if len(seen) else 0
            doubles = np.array([float(b) for b in series[:last]])
            return cls(mean, tuple(series), error / speed, doubles)

    def time(self, theta: arb) -> arb:
        """Return the time of an angle, zero at zero."""
        total = self.mean * theta
        for k, b in enumerate(self.series, start=1):
            total += b * (k * theta).sin()
        return total

    def angles(self, times: FloatArray) -> FloatArray:
        """Return the angles of times, shape (n,)."""
        mean, k = float(self.mean), np.arange(1, len(self.doubles) + 1)
        theta = times / mean
        low, high = theta - self._reach(mean), theta + self._reach(mean)
        for _ in range(NEWTON_STEPS):
            phases = np.outer(theta, k)
            misses = mean * theta + np.sin(phases) @ self.doubles - times
            low, high = np.where(misses < 0.0, theta, low), np.where(misses < 0.0, high, theta)
            following = theta - misses / (mean + np.cos(phases) @ (k * self.doubles))
            # A step that leaves the bracket is one of bisection.
            following = np.where((following >= low) & (following <= high), following, 0.5 * (low + high))
            change = np.abs(following - theta)
            theta = following
            # Rounding alone is left once every angle moves by a few ulp.
            if np.all(change <= 2e-15 * (1.0 + np.abs(theta))):
                break
        return theta

    def _reach(self, mean: float) -> float:
        return 1e-12 + float(np.abs(self.doubles).sum()) / mean
