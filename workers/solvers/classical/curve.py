"""Samples a classical motion on its closed curve, in doubles, and compares samples with balls.

Time along the curve is t = mean · θ + Σ b_k sin kθ, which is inverted for θ as a function of t.
"""

from dataclasses import dataclass

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.classical.placement import Placed
from service.dynamics.classical.protocol import CASE_BITS, Reduced, ReducedLoop, value

FloatArray = NDArray[np.float64]

NEWTON_STEPS = 60
NEGLIGIBLE_RELATIVE_TERM = 1e-19
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
        with ctx.workprec(CASE_BITS):
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
            seen = np.flatnonzero(sizes > NEGLIGIBLE_RELATIVE_TERM * float(mean))
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


CHECKED_POINTS = 24
"""Places on the curve where doubles are held against balls."""
DIFFERENCE_FACTOR = 4.0
"""On the largest difference seen there."""


@dataclass(frozen=True, slots=True)
class LoopInDoubles:
    """A loop in doubles: the coordinate and both factors as functions of the angle."""

    reduced: Reduced
    middle: float
    half: float
    ends: tuple[str, str]
    U: tuple[float, ...]
    V: tuple[float, ...]
    forward: float

    @classmethod
    def of(cls, loop: ReducedLoop) -> "LoopInDoubles":
        """Convert a loop."""
        middle, half = (loop.upper + loop.lower) / 2, (loop.upper - loop.lower) / 2
        U, V = tuple(map(float, loop.U)), tuple(map(float, loop.V))
        forward = 1.0 if loop.reduced.rate > 0 else -1.0
        return cls(loop.reduced.converted(float), float(middle), float(half), loop.ends, U, V, forward)

    def x(self, theta: FloatArray) -> FloatArray:
        """Return the coordinate."""
        return self.middle - self.half * np.cos(theta)

    def factors(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return u and v, as :meth:`.ReducedLoop.factors` does."""
        x = self.x(theta)
        u, v = np.sqrt(value(self.U, x) + 0.0 * x), np.sqrt(value(self.V, x) + 0.0 * x)
        if self.ends == ("u", "u"):
            return self.forward * self.half * np.sin(theta) * u, v
        if self.ends == ("v", "v"):
            return u, self.forward * self.half * np.sin(theta) * v
        width = np.sqrt(2.0 * self.half)
        near, far = width * np.sin(theta / 2), width * np.cos(theta / 2)
        return (
            (self.forward * near * u, far * v) if self.ends[0] == "u" else (far * u, self.forward * near * v)
        )


@dataclass(frozen=True, slots=True)
class Curve:
    """A classical motion of the form ``loop`` as a function of time, in doubles."""

    placed: Placed
    loop: LoopInDoubles
    clock: Clock
    since: float
    """Time from θ = 0 to the start."""
    speed: float
    strength: float

    @classmethod
    def of(cls, placed: Placed) -> "Curve":
        """Prepare the samples of a motion."""
        assert placed.loop is not None
        clock = Clock.of(placed.loop, placed.speed)
        with ctx.workprec(CASE_BITS):
            since = float(clock.time(placed.first_angle()))
        speed, strength = float(placed.speed), float(placed.strength)
        return cls(placed, LoopInDoubles.of(placed.loop), clock, since, speed, strength)

    @property
    def period(self) -> arb:
        """The period of all six variables."""
        assert self.placed.loop is not None
        with ctx.workprec(CASE_BITS):
            return 2 * arb.pi() * self.placed.loop.turns * self.clock.mean

    def sample(self, times: FloatArray) -> FloatArray:
        """Return p, q, r, g1, g2, g3, shape (n, 6), at times within a period or two of 0."""
        theta = self.clock.angles(self.since + self.placed.motion.direction * times)
        u, v = self.loop.factors(theta)
        state = self.loop.reduced.state(self.loop.reduced.constants, self.loop.x(theta), u, v)
        columns = self.placed.in_client_axes(state, self.speed, self.strength)
        return np.stack([column + 0.0 * theta for column in columns], axis=1)

    def error(self) -> float:
        """Return the largest difference from balls at places all over the curve, with a factor of safety."""
        assert self.placed.loop is not None
        with ctx.workprec(CASE_BITS):
            start, direction = self.placed.first_angle(), self.placed.motion.direction
            angles = [
                2 * arb.pi() * self.placed.loop.turns * (arb(k) + arb(1) / 3) / CHECKED_POINTS
                for k in range(CHECKED_POINTS)
            ]
            states = [
                self.placed.in_client_axes(self.placed.loop.state(start + direction * angle))
                for angle in angles
            ]
            began = self.clock.time(start)
            times = [direction * (self.clock.time(start + direction * angle) - began) for angle in angles]
            exact = np.array([[float(x) for x in state] for state in states])
        found = self.sample(np.array([float(t) for t in times]))
        return DIFFERENCE_FACTOR * float(np.abs(found - exact).max())
