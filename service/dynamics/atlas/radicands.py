"""Evaluates the curve and p² in doubles at many λ and many places at once: guesses and series, no proofs."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from service.dynamics.atlas.curves import HalfCurves, LambdaStretch
from service.dynamics.reduction.geometry.height import log_sine_real, numerator_real

FloatArray = NDArray[np.float64]

SECANTS, HALVINGS = 3, 60
"""So many steps by secants, then one that halves; in all at most so many."""
CLOSE = 2.0**-51


def equator_of(half: HalfCurves, stretches: Sequence[LambdaStretch]) -> tuple[FloatArray, FloatArray]:
    """Return Z and G for a λ inside each stretch, shape (stretches, 1)."""
    found: list[tuple[int, float, float]] = []
    for inverse in (False, True):
        places = [k for k, each in enumerate(stretches) if each.is_inverse == inverse]
        if places:
            loops = half.over([stretches[k] for k in places]).loops
            Z, G = (0.5 * (low + high) for low, high in (loops.Z, loops.G))
            found.extend(zip(places, Z.tolist(), G.tolist(), strict=True))
    ordered = np.array([each[1:] for each in sorted(found)])
    return ordered[:, :1], ordered[:, 1:]


def curve_at(
    half: HalfCurves, Z: FloatArray, G: FloatArray, sine: FloatArray, cosine: FloatArray
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
    half: HalfCurves, Z: FloatArray, G: FloatArray, side: FloatArray, x: FloatArray
) -> FloatArray:
    """Return D at distances x from the pole g2 = ``side``, shape (λ, n)."""
    g1, g2, g3, _ = curve_at(half, Z, G, np.sin(x), side * np.cos(x))
    with np.errstate(all="ignore"):
        found: FloatArray = half.potential.D_real(g1, g2, g3)
    return found


def p_squared(
    half: HalfCurves, Z: FloatArray, G: FloatArray, sine: FloatArray, cosine: FloatArray
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

    Secants by Illinois' rule, which halves the weight of an end that stays; and each fourth step a bisection.
    They end where the bracket or the last step is ``close``, relative.
    """
    f_low, f_high = value(low), value(high)
    place = 0.5 * (low + high)
    for step in range(HALVINGS):
        before = place
        with np.errstate(all="ignore"):
            secant = (low * f_high - high * f_low) / (f_high - f_low)
        is_inside = (secant >= low) & (secant <= high) if step % (SECANTS + 1) < SECANTS else False
        place = np.where(is_inside, secant, 0.5 * (low + high))
        here = value(place)
        is_before = (here > 0.0) == (f_low > 0.0)
        f_low, f_high = np.where(is_before, here, 0.5 * f_low), np.where(is_before, 0.5 * f_high, here)
        low, high = np.where(is_before, place, low), np.where(is_before, high, place)
        # NaN is no reason to go on.
        is_open = (high - low > close * high) & (np.abs(place - before) > close * high) & (here != 0.0)
        if not is_open.any():
            break
    return place
