r"""The phase of an orbit through poles, graded: next to a pole it is a power of one in which all is smooth.

Where F is a sum of powers of w, V next to a pole is a sum of powers of \|sin v\| whose exponents have a
common denominator n. With u = u_p ± δ (n xⁿ − (n − 1) xⁿ⁺¹) on either side of the pole at u_p everything is
analytic in x ≥ 0, and du/dx goes on as it was at x = 1.
"""

from dataclasses import dataclass
from itertools import pairwise
from math import copysign, lcm
from typing import TypeVar

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.reduction.geometry.loop import Loop
from workers.solvers.orbits.orbit import Libration, Rotation

FloatArray = NDArray[np.float64]
Number = TypeVar("Number", float, arb, FloatArray)

MAX_POLE_DISTANCE = 0.25
"""Largest δ."""
MAX_HALVINGS = 60


@dataclass(frozen=True, slots=True)
class Graded:
    """See :class:`workers.solvers.orbits.orbit.Orbit`."""

    orbit: Libration | Rotation
    unit: int
    """n."""
    reach: float
    """δ, of u."""

    @property
    def start(self) -> float:
        """Return u at t = 0."""
        for pole in self.corners:
            off = self.orbit.start - pole
            if abs(off) < self.reach:
                low, high = 0.0, 1.0
                for _ in range(MAX_HALVINGS):
                    x = 0.5 * (low + high)
                    low, high = (x, high) if self._power(x) * self.reach < abs(off) else (low, x)
                return pole + copysign(self.reach * high, off)
        return self.orbit.start

    @property
    def is_even(self) -> bool:
        """See Orbit.is_even."""
        return self.orbit.is_even

    @property
    def corners(self) -> tuple[float, ...]:
        """See Orbit.corners."""
        return self.orbit.corners

    @property
    def junctions(self) -> tuple[float, ...]:
        """See Orbit.junctions."""
        return tuple(pole + off for pole in self.corners for off in (-self.reach, self.reach))

    def somewhere(self) -> arb:
        """See Orbit.somewhere."""
        return self.orbit.somewhere()

    def rate(self, theta: arb) -> arb:
        """See Orbit.rate; it is 0 at a pole."""
        own, slope = self._graded(theta)
        return slope if slope == 0 else slope * self.orbit.rate(own)

    def state(self, theta: arb) -> tuple[arb, ...]:
        """See Orbit.state."""
        return self.orbit.state(self._graded(theta)[0])

    def sines(self, u: FloatArray) -> FloatArray:
        """Return sin v in doubles as exactly as they have it, next to poles; NaN elsewhere."""
        found, orbit = np.full(u.shape, np.nan), self.orbit
        for pole in self.corners:
            x = np.abs(u - pole) / self.reach
            off = np.pi * np.copysign(self.reach * self._power(x), u - pole)
            if isinstance(orbit, Rotation):
                v, apart = orbit.origin + orbit.direction * arb.pi() * pole, orbit.direction * off
            else:
                width, half = orbit.upper - orbit.lower, arb.pi() * pole / 2
                v = orbit.lower + width * half.sin() ** 2
                apart = float(width) * np.sin(0.5 * off) * np.sin(2.0 * float(half) + 0.5 * off)
            found = np.where(x < 1.0, (-1.0) ** round(float(v / arb.pi())) * np.sin(apart), found)
        return found

    def _graded(self, theta: arb) -> tuple[arb, arb]:
        """Return the phase of the orbit, and how fast it grows with ``theta``."""
        u = theta / arb.pi()
        for pole in self.corners:
            x = abs(u - pole) / self.reach
            if x.contains(0):
                return arb.pi() * pole, arb(0)
            if x < 1:
                n, off = self.unit, self.reach * self._power(x)
                slope = x ** (n - 1) * (n * n - (n * n - 1) * x)
                return arb.pi() * (pole + off if u > pole else pole - off), slope
        return theta, arb(1)

    def _power(self, x: Number) -> Number:
        return x**self.unit * (self.unit - (self.unit - 1) * x)


def graded(orbit: Libration | Rotation) -> Graded | None:
    """Return the graded phase; None where no pole is passed, or is no matter, or powers are not known."""
    loop, marks = orbit.loop, sorted((0.0, *orbit.corners, 2.0))
    unit = _unit(loop, 1 if float(orbit.somewhere().sin()) > 0.0 else -1)
    reach = min(MAX_POLE_DISTANCE, *(0.5 * (right - left) for left, right in pairwise(marks)))
    return Graded(orbit, unit, reach) if orbit.corners and unit > 1 and reach > 0.0 else None


def _unit(loop: Loop, side: int) -> int:
    """Return n: of |sin v| there are the powers α(2 − 2m) for every w^m, and those of the curve."""
    alpha, signs = loop.alpha, (loop.g1_sign, side)
    client = 1 / alpha if loop.mirrored else alpha
    powers = loop.potential.powers_of_w(*(signs[::-1] if loop.mirrored else signs))
    # |g1|^(2 − 2m) next to g1 = 0, and |g3|^(2αm + 2) next to g3 = 0.
    own = [(2 * client * m + 2 if loop.mirrored else 2 - 2 * m) * alpha for m in powers]
    return lcm(alpha.denominator, *(exponent.denominator for exponent in own)) if powers else 1
