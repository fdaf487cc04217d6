"""The loop of a planar motion in doubles, which guides a proof and is not part of it."""

from fractions import Fraction

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.formula.algebras.real import RealAlgebra
from service.dynamics.formula.tape import Tape
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.geometry.point import REALS, make_equator, place_of
from workers.solvers.certified.phase import LibrationPhase, RotationPhase

FloatArray = NDArray[np.float64]


class QuietReals(RealAlgebra):
    """The same numbers where warnings are off already, in less time."""

    def add(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """Return left + right."""
        return left + right

    def subtract(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """Return left - right."""
        return left - right

    def multiply(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """Return left · right."""
        return left * right

    def power(self, base: FloatArray, exponent: Fraction) -> FloatArray:
        """Return base^exponent."""
        if exponent.denominator == 1 and exponent.numerator in (2, 3):
            return base * base if exponent.numerator == 2 else base * base * base
        return super().power(base, exponent)


_REALS = QuietReals()


def room(
    loop: Loop, tape: Tape, h: arb, sine: FloatArray, cosine: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return N = h − V, |g1/g3| and c at places with sin v ≠ 0; numpy's warnings must be off."""
    Z, G, alpha = (np.asarray(float(each)) for each in (loop.Z, loop.G, loop.alpha))
    first, height, third, c = place_of(REALS, sine, cosine, make_equator(Z, G, alpha))
    gamma = loop.g1_sign * first, height, third
    V = tape.evaluate(_REALS, gamma[::-1] if loop.mirrored else gamma)
    return np.broadcast_to(float(h) - V, sine.shape), np.abs(first / third), c


def rates(phase: LibrationPhase | RotationPhase, count: int) -> FloatArray:
    """Return dt/dθ, but for a factor, at equidistant θ halfway between multiples of 2π/count."""
    theta = (np.arange(count) + 0.5) * (2.0 * np.pi / count)
    curve, loop = phase.curve, phase.curve.loop
    if isinstance(phase, RotationPhase):
        v, product = float(phase.origin) + phase.direction * theta, np.ones(count)
    else:
        lower, upper = float(phase.lower), float(phase.upper)
        v = lower + (upper - lower) * np.sin(theta / 2.0) ** 2
        product = (0.5 * (upper - lower) * np.sin(theta)) ** 2
    with np.errstate(all="ignore"):
        # What is beyond doubles is infinite, and so are the rates that nobody takes for known then.
        N, ratio, c = room(loop, curve.tape, curve.h, np.sin(v), np.cos(v))
        steep = 1.0 + float(loop.A / loop.C) * ratio * ratio
        return np.asarray(np.sqrt(steep * product / (c * c * N)))
