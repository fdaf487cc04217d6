"""Evaluates the curve and p² in doubles at many λ and many places at once: guesses and series, no proofs."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from service.dynamics.atlas.curves import LambdaStretch, PlainHalves
from service.dynamics.reduction.geometry.height import log_sine_real, numerator_real

FloatArray = NDArray[np.float64]

STEPS = 80
"""Largest number of steps: some ten are usual, where values are smooth."""
CLOSE = 2.0**-51


def equator_of(half: PlainHalves, stretches: Sequence[LambdaStretch]) -> tuple[FloatArray, FloatArray]:
    """Return Z and G for a λ inside each stretch, shape (stretches, 1)."""
    found: list[tuple[int, float, float]] = []
    for inverse in (False, True):
        places = [k for k, each in enumerate(stretches) if each.is_inverse == inverse]
        if places:
            loops = half.loops([stretches[k] for k in places])
            Z, G = (0.5 * (low + high) for low, high in (loops.Z, loops.G))
            found.extend(zip(places, Z.tolist(), G.tolist(), strict=True))
    ordered = np.array([each[1:] for each in sorted(found)])
    return ordered[:, :1], ordered[:, 1:]


def curve_at(
    half: PlainHalves, Z: FloatArray, G: FloatArray, sine: FloatArray, cosine: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return g1, g2, g3 in the client's axes, and c = g2 / cos v, at the places with these sin v and cos v.

    sin v < 0 is the curve on which the primed g3 has the other sign.
    """
    shape = half.shape
    alpha = float(shape.alpha)
    square = cosine * cosine
    with np.errstate(all="ignore"):
        log_sine = log_sine_real(sine, square)
        first = shape.first_sign * G * np.exp(alpha * log_sine)
        third = shape.third_sign * Z * sine
        ratio = np.where(
            square > 0.0, numerator_real(alpha, log_sine) / np.where(square > 0.0, square, 1.0), alpha
        )
        c = np.sqrt(Z * Z + G * G * ratio)
    g1, g3 = (third, first) if shape.is_mirrored else (first, third)
    return g1, cosine * c, g3, c


def d_on_curves(
    half: PlainHalves, Z: FloatArray, G: FloatArray, side: FloatArray, x: FloatArray
) -> FloatArray:
    """Return D at distances x from the pole g2 = ``side``, shape (λ, n)."""
    g1, g2, g3, _ = curve_at(half, Z, G, np.sin(x), side * np.cos(x))
    with np.errstate(all="ignore"):
        found: FloatArray = half.potential.D_real(g1, g2, g3)
    return found


def p_squared(
    half: PlainHalves, Z: FloatArray, G: FloatArray, sine: FloatArray, cosine: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the primed p² and c at places of curves."""
    g1, g2, g3, c = curve_at(half, Z, G, sine, cosine)
    A, C = (half.body.C, half.body.A) if half.shape.is_mirrored else (half.body.A, half.body.C)
    factor = float(C / ((A - C) * A))
    with np.errstate(all="ignore"):
        D = half.potential.D_real(g1, g2, g3)
        ratio = -g1 / g3 if half.shape.is_mirrored else g3 / g1
        return factor * ratio * D, c


def zero_between(
    value: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray, close: float = CLOSE
) -> FloatArray:
    """Return about where ``value`` changes its sign between ``low`` and ``high``, arrays of one shape.

    By the method of T. R. Chandrupatla (Advances in Engineering Software 28, 1997, 145-149): inverse
    quadratic interpolation where three points admit it, else bisection. It ends where the bracket is
    ``close``, relative.
    """
    place, far = low, high
    f_place, f_far = value(low), value(high)
    share = np.full(np.shape(low), 0.5)
    for _ in range(STEPS):
        x = place + share * (far - place)
        f = value(x)
        # Of the last two places one keeps the bracket; the other is the third point.
        is_same = (f > 0.0) == (f_place > 0.0)
        third, f_third = np.where(is_same, place, far), np.where(is_same, f_place, f_far)
        far, f_far = np.where(is_same, far, place), np.where(is_same, f_far, f_place)
        place, f_place = x, f
        with np.errstate(all="ignore"):
            best = np.where(np.abs(f_place) < np.abs(f_far), place, far)
            least = 0.5 * close * np.abs(best) / np.abs(far - place)
            # NaN is no reason to go on.
            if not ((least < 0.5) & (np.abs(f_place) > 0.0)).any():
                break
            xi, phi = (place - far) / (third - far), (f_place - f_far) / (f_third - f_far)
            is_quadratic = (phi * phi < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
            guess = f_place / (f_far - f_place) * f_third / (f_far - f_third) + (third - place) / (
                far - place
            ) * f_place / (f_third - f_place) * f_far / (f_third - f_far)
            share = np.where(is_quadratic & np.isfinite(guess), guess, 0.5)
            share = np.clip(share, np.minimum(least, 0.5), np.maximum(1.0 - least, 0.5))
            share = np.where(f_place == 0.0, 0.0, share)
    return best
