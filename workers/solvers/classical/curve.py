"""Samples a classical motion on its closed curve, in doubles, and holds samples against balls."""

from dataclasses import dataclass

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.classical.loop import BITS, ReducedLoop
from service.dynamics.classical.placed import Placed
from service.dynamics.classical.reduced import Reduced, value
from workers.solvers.classical.clock import Clock

FloatArray = NDArray[np.float64]

CHECKS = 24
"""Places on the curve where doubles are held against balls."""
SAFETY = 4.0
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
        with ctx.workprec(BITS):
            since = float(clock.time(placed.first_angle()))
        speed, strength = float(placed.speed), float(placed.strength)
        return cls(placed, LoopInDoubles.of(placed.loop), clock, since, speed, strength)

    @property
    def period(self) -> arb:
        """The period of all six variables."""
        assert self.placed.loop is not None
        with ctx.workprec(BITS):
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
        with ctx.workprec(BITS):
            start, direction = self.placed.first_angle(), self.placed.motion.direction
            angles = [
                2 * arb.pi() * self.placed.loop.turns * (arb(k) + arb(1) / 3) / CHECKS for k in range(CHECKS)
            ]
            states = [
                self.placed.in_client_axes(self.placed.loop.state(start + direction * angle))
                for angle in angles
            ]
            began = self.clock.time(start)
            times = [direction * (self.clock.time(start + direction * angle) - began) for angle in angles]
            exact = np.array([[float(x) for x in state] for state in states])
        found = self.sample(np.array([float(t) for t in times]))
        return SAFETY * float(np.abs(found - exact).max())
