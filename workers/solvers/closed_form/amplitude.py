r"""The Jacobi amplitude in doubles, with full relative accuracy of its tangent.

For :math:`\dot\chi = \sqrt{a^2\cos^2\chi + b^2\sin^2\chi}`, χ(0) = 0, and the
arithmetic-geometric mean M of a and b,

.. math:: \cot\chi = \frac{M}{a}\cot\theta \prod d_n, \qquad \theta = M t,

by Gauss's transformation in the form of Bulirsch (1965). Every d_n is a ratio
of sums of positive numbers: nothing cancels, for any a, b > 0.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

MAX_STEPS = 16
"""The mean of 1 and 1e-300 takes 14; equality of the last digit is not reached reliably."""


@dataclass(frozen=True, slots=True)
class Amplitude:
    """χ as a function of θ; ``means`` are the pairs (a_n, b_n) of the iteration, at least one."""

    means: tuple[tuple[float, float], ...]

    def sine_cosine(
        self, sine: FloatArray, cosine: FloatArray, scale: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return sin v and cos v from sin θ and cos θ, where tan v = ``scale`` · tan χ.

        v is in the quadrant of θ, and where one of the four is 0, so is its partner.
        """
        a, b = self.means[-1]
        last = 0.5 * (a + b)
        cosine = last * cosine
        square = sine * sine
        d: FloatArray | float = 1.0
        for a, b in reversed(self.means):
            ratio = cosine * cosine
            cosine = cosine * d
            d = (b * last * square + ratio) / (a * last * square + ratio)
            last = a
        sine = (scale * self.means[0][0]) * sine
        length = np.hypot(sine, cosine)
        return sine / length, cosine / length


def make_amplitude(a: float, b: float) -> Amplitude:
    """Return the amplitude with these a, b > 0."""
    means = [(a, b)]
    while abs(a - b) > 1e-8 * a and len(means) < MAX_STEPS:
        a, b = 0.5 * (a + b), sqrt(a * b)
        means.append((a, b))
    return Amplitude(tuple(means))
