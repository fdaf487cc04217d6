"""The six variables of a motion in a potential of three terms, from sin v and cos v."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MirrorImage:
    """One of the mirror images of a motion, by the signs of g1, of g2 and of g3.

    Where g2 changes sign (``hi`` the equator) it is that of cos v, and ``g2``
    is 1; where g3 does (``lo`` the pole) it is that of ``g3`` · sin v.
    """

    g1: int
    g2: int
    g3: int
    is_mirrored: bool = False
    """The first and third axes are exchanged (C = 2A)."""


@dataclass(frozen=True, slots=True)
class Variables:
    """The data of the six variables, in doubles: x = lo cos²v + hi sin²v, L1 and L2 linear in x."""

    C: float
    nu: float
    a1: float
    b1: float
    c1: float
    lo: float
    hi: float
    width: float
    """hi − lo."""
    first: tuple[float, float]
    second: tuple[float, float]
    """L1 and L2 at lo and hi."""
    above: float
    """x1 − hi: 0 at the equator."""
    reaches_pole: bool
    reaches_equator: bool

    def state(self, sine: FloatArray, cosine: FloatArray, branch: MirrorImage) -> FloatArray:
        """Return p, q, r, g1, g2, g3 (not mirrored) where sin v and cos v are these, shape (n, 6)."""
        up, down = sine * sine, cosine * cosine
        x = self.lo * down + self.hi * up
        second = self.second[0] * down + self.second[1] * up
        if self.reaches_equator:
            g2 = cosine * np.sqrt(self.width * second)
            amplitude = np.sqrt(self.first[0] * down + self.first[1] * up)
        else:
            g2 = branch.g2 * np.sqrt((self.above + self.width * down) * second)
            # L1 at lo is 2 c1 (x1 − lo).
            steepness = self.first[0] / (self.above + self.width)
            amplitude = branch.g2 * np.sqrt(steepness * self.width) * cosine
        r = np.sqrt(2.0 * self.width / self.C) * amplitude * sine
        p = -branch.g3 * np.sqrt(self.nu / (2.0 * self.C)) * amplitude
        if self.reaches_pole:
            g3 = branch.g3 * np.sqrt(self.nu * self.hi) * sine
        else:
            g3 = branch.g3 * np.sqrt(self.nu * x)
            p = p * np.sqrt(self.width / x) * sine
        return np.stack([p, np.zeros_like(p), branch.g1 * r, branch.g1 * x, g2, g3], axis=1)

    def slope(self, state: FloatArray, branch: MirrorImage) -> FloatArray:
        """Return the time derivative of ``state``, by the Euler-Poisson equations with q = 0."""
        p, _, r, g1, g2, g3 = state.T
        V_1 = branch.g1 * self.a1 + 4.0 * self.c1 * g1
        V_3 = 2.0 * self.c1 * g3
        if self.b1:
            V_3 = V_3 - 2.0 * self.b1 / g3**3
        columns = [
            g2 * V_3 / (2.0 * self.C),
            np.zeros_like(p),
            -g2 * V_1 / self.C,
            r * g2,
            p * g3 - r * g1,
            -p * g2,
        ]
        return np.stack(columns, axis=1)

    def phase_speed(self, sine: FloatArray, cosine: FloatArray) -> FloatArray:
        """Return dv/dt."""
        up, down = sine * sine, cosine * cosine
        first = self.first[0] * down + self.first[1] * up
        second = self.second[0] * down + self.second[1] * up
        speed: FloatArray = np.sqrt(first * second / (2.0 * self.C))
        return speed
