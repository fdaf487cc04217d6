r"""Computes the time of a turn by the trapezoidal rule, with a proven error.

dt/dθ has the period 2π and Fourier coefficients r_k with Σ \|r_k\| e^{a\|k\|} ≤ M. Its
mean over n equidistant phases is the true one but for r_{±n}, r_{±2n}, …, hence

.. math:: |T_n - T| \le 2\pi M e^{-an} .

The phases lie halfway between multiples of 2π/n, and n is a multiple of 4: no phase is
at a turn, nor, where the motion is symmetric, at a pole or the equator.
"""

from math import ceil, inf, log
from typing import NamedTuple

import numpy as np
from flint import arb

from workers.solvers.certified.doubles import rates
from workers.solvers.certified.phase import LibrationPhase, RotationPhase
from workers.solvers.certified.strips.bound import bound_on_strip

SAMPLES = (64, 256, 1024)
"""Numbers of samples of dt/dθ in doubles that show the height of the strip; more where they do not resolve
it."""
MAX_RELATIVE_NOISE = 1e-11
"""A coefficient of this size, of the mean, is not yet noise."""
HIGHEST, LOWEST = 2.5, 0.06
"""Heights of strips that are tried: series on lower ones are longer than pieces of time are many."""
ATTEMPTS = ((0.62, 68.0), (0.6, 120.0), (0.4, 60.0))
"""Heights of the strip as shares of what the samples show, and degrees of the series times the latter."""


class ProvenStrip(NamedTuple):
    """|Im θ| ≤ height, where dt/dθ is holomorphic, and the bound M of its norm."""

    height: float
    largest: float


def proven_strip(phase: LibrationPhase | RotationPhase) -> ProvenStrip | None:
    """Return a strip about the real axis, about as high as there is; None if none is proven."""
    shown = _shown_height(phase)
    if shown is None or shown < LOWEST:
        return None
    for share, steepness in ATTEMPTS:
        height = share * shown
        largest = bound_on_strip(phase, height, ceil(steepness / shown))
        if largest < inf:
            return ProvenStrip(height, largest)
    return None


def time_of_turn(phase: LibrationPhase | RotationPhase, strip: ProvenStrip, bits: int) -> arb:
    """Return the period, to so many bits of it if the precision allows that."""
    size = float(next(phase.rates(4)))
    count = 4 * ceil((bits * log(2.0) + max(0.0, log(strip.largest / size))) / strip.height / 4.0)
    total = sum(phase.rates(count), arb(0))
    mean = total * (2 if phase.is_even else 1) / count
    error = arb(strip.largest) * (-arb(strip.height) * count).exp()
    return 2 * arb.pi() * (mean + arb(0, error.abs_upper()))


def _shown_height(phase: LibrationPhase | RotationPhase) -> float | None:
    """Return how fast the coefficients of dt/dθ decay, which is proven by nobody; None if they do not."""
    for count in SAMPLES:
        seen = rates(phase, count)
        if not np.all(np.isfinite(seen)):
            return None
        sizes = np.abs(np.fft.rfft(seen))
        # Even and odd ones may differ.
        sizes = np.maximum(sizes[1:-2], sizes[2:-1])
        heard = np.flatnonzero(sizes > MAX_RELATIVE_NOISE * sizes[0])
        last = int(heard[-1]) if len(heard) else 0
        if last + 2 < len(sizes):
            break
    first = last // 3
    if last - first < 2:
        return HIGHEST
    return min(HIGHEST, float(np.log(sizes[first] / sizes[last])) / (last - first))
