r"""The phase of an orbit through poles, graded: next to a pole it is a power of one in which all is smooth.

Where F is a sum of powers of w, V next to a pole is a sum of powers of \|sin v\| whose exponents have a
common denominator n. With u = u_p ± δ (n xⁿ − (n − 1) xⁿ⁺¹) on either side of the pole at u_p everything is
analytic in x ≥ 0, and du/dx goes on as it was at x = 1. Logarithms, and what comes from other F, are as
smooth as n is large.
"""

from dataclasses import dataclass
from itertools import pairwise
from math import copysign, lcm
from typing import TypeVar

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.potentials.angular_part.along_curve import smooth_unit
from service.dynamics.reduction.geometry.loop import Loop
from workers.solvers.orbits.orbit import Libration, Rotation

FloatArray = NDArray[np.float64]
Number = TypeVar("Number", float, arb, FloatArray)

MAX_POLE_DISTANCE = 0.25
"""Largest δ."""
MAX_HALVINGS = 60
MAX_LOGARITHMIC_UNIT = 8
"""Largest n where there are logarithms: at the nodes next to a pole xⁿ is known to half of 160 bits."""


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
        """Return sin v in doubles as exactly as they have it, next to poles; NaN elsewhere.

        And NaN where it is not small: a power has as many roundings as its exponent is large.
        """
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
            is_small = (x < 1.0) & (self.unit * np.abs(apart) < 1.0)
            found = np.where(is_small, (-1.0) ** round(float(v / arb.pi())) * np.sin(apart), found)
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


def refine_near_poles(loop: Loop, states: FloatArray, sines: FloatArray) -> None:
    """Give g1, g3 and r next to a pole the digits that ``sines``, sin v, have: relative to their own size.

    ``states`` have the shape (n, 6) and are overwritten; where a sine, shape (n,), is NaN they stay. Series
    know small variables to the rounding of large ones, and next to a pole forces may depend on g1 without
    bound.
    """
    near = np.flatnonzero(np.isfinite(sines))
    Z, G, alpha = float(loop.Z), loop.g1_sign * float(loop.G), float(loop.alpha)
    # Primed axes: g1 = ±G |sin v|^α, g3 = Z sin v, r = −α g1 p / g3.
    p, r, g1, g3 = (2, 0, 5, 3) if loop.mirrored else (0, 2, 3, 5)
    sine, size = sines[near], np.abs(sines[near])
    states[near, g1], states[near, g3] = G * size**alpha, Z * sine
    states[near, r] = -alpha * G / Z * size ** (alpha - 1.0) * np.sign(sine) * states[near, p]


def graded(orbit: Libration | Rotation) -> Graded | None:
    """Return the graded phase; None where no pole is passed, or none is needed."""
    loop, marks = orbit.loop, sorted((0.0, *orbit.corners, 2.0))
    unit = _unit(loop, 1 if float(orbit.somewhere().sin()) > 0.0 else -1)
    reach = min(MAX_POLE_DISTANCE, *(0.5 * (right - left) for left, right in pairwise(marks)))
    return Graded(orbit, unit, reach) if orbit.corners and unit > 1 and reach > 0.0 else None


def _unit(loop: Loop, side: int) -> int:
    """Return n: of |sin v| there are the powers α(2 − 2m) for every w^m, and those of the curve.

    It is large where there are logarithms, too, or where F is no sum of powers; 1 where V has a formula, but
    for one with logarithms below A/C = 2, where they leave r, a power of time below the first, no digits.
    """
    if loop.potential.has_formula:
        logs = any(made.name == "log" for made in loop.potential.tape.instructions)
        return min(smooth_unit(loop.alpha), MAX_LOGARITHMIC_UNIT) if logs and loop.alpha < 2 else 1
    alpha, signs = loop.alpha, (loop.g1_sign, side)
    client = 1 / alpha if loop.mirrored else alpha
    powers = loop.potential.powers_of_w(*(signs[::-1] if loop.mirrored else signs))
    # |g1|^(2 − 2m) next to g1 = 0, and |g3|^(2αm + 2) next to g3 = 0; a logarithm for m, or −αm, = 1, 2, ...
    own = [(2 * client * m + 2 if loop.mirrored else 2 - 2 * m) * alpha for m in powers]
    resonant = [-client * m if loop.mirrored else m for m in powers]
    divisor = lcm(alpha.denominator, *(exponent.denominator for exponent in own))
    has_logarithms = not powers or any(m > 0 and m.denominator == 1 for m in resonant)
    return min(smooth_unit(alpha), MAX_LOGARITHMIC_UNIT) if has_logarithms else divisor
