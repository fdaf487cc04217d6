"""The loop of a planar motion in doubles, which guides a proof and is not part of it."""

from fractions import Fraction
from typing import NamedTuple

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.formula.algebras.real import RealAlgebra
from service.dynamics.formula.tape import Tape
from service.dynamics.reduction.geometry.height import log_sine_real, numerator_real
from service.dynamics.reduction.geometry.loop import Loop
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


class Places(NamedTuple):
    """Places on the loop, sin v ≠ 0."""

    sine: FloatArray
    cosine: FloatArray
    square: FloatArray
    """cos²v, not 0: at the equator the smallest double."""
    log_sine: FloatArray


def make_places(sine: FloatArray, cosine: FloatArray) -> Places:
    """Return the places with these sin v and cos v."""
    square = np.maximum(cosine * cosine, np.finfo(np.float64).tiny)
    return Places(sine, cosine, square, log_sine_real(sine, square))


def room(loop: Loop, tape: Tape, h: arb, at: Places) -> tuple[FloatArray, FloatArray]:
    """Return N = h − V, and c²; numpy's warnings must be off."""
    alpha, Z, G = float(loop.alpha), float(loop.Z), float(loop.G)
    logs = alpha * at.log_sine
    c_squared = Z * Z + G * G * numerator_real(alpha, at.log_sine) / at.square
    gamma = loop.g1_sign * G * np.exp(logs), np.sqrt(c_squared) * at.cosine, Z * at.sine
    V = tape.evaluate(_REALS, gamma[::-1] if loop.mirrored else gamma)
    return np.broadcast_to(float(h) - V, at.sine.shape), c_squared


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
    at = make_places(np.sin(v), np.cos(v))
    with np.errstate(all="ignore"):
        # What is beyond doubles is infinite, and so are the rates that nobody takes for known then.
        ratio = float(loop.A / loop.C) * np.square(np.float64(loop.G) / np.float64(loop.Z))
        N, c_squared = room(loop, curve.tape, curve.h, at)
        steep = 1.0 + ratio * np.exp((2.0 * float(loop.alpha) - 2.0) * at.log_sine)
        return np.asarray(np.sqrt(steep * product / (c_squared * N)))
