r"""The height g2 = c cos v on the loop, in balls and in doubles, without loss of digits at the equator.

With s = |sin v| and u = cos² v,

.. math:: c^2 = Z^2 + G^2 R,\qquad R = \frac{1 - s^{2\alpha}}{u},

and at the equator, u = 0, both the numerator and u vanish. The logarithm of s is therefore taken from u where
u is not near 1, and 1 − s^{2α} from that logarithm by expm1.
"""

import numpy as np
from flint import arb
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

FAR = 0.75
"""The largest u from which log s is taken: for larger ones 1 − u loses digits, and s has them."""


def log_sine_ball(sine: arb, square: arb) -> arb:
    """Return log |sin v| from sin v and u."""
    return (-square).log1p() / 2 if square < FAR else abs(sine).log()


def c_squared_ball(Z_squared: arb, G_squared: arb, twice_alpha: arb, log_sine: arb, square: arb) -> arb:
    """Return c² where u is not 0; not finite where its ball contains 0."""
    return Z_squared - G_squared * (twice_alpha * log_sine).expm1() / square


def c_squared_range(Z_squared: arb, G_squared: arb, alpha: arb, log_sine: arb, square: arb) -> arb:
    """Return c² on a ball of u that may contain 0: R falls from its limit α as u grows."""
    if not square.contains(0):
        return c_squared_ball(Z_squared, G_squared, 2 * alpha, log_sine, square)
    edge = square.upper()
    return Z_squared + G_squared * alpha.union(-(alpha * (-edge).log1p()).expm1() / edge)


def log_sine_real(sine: FloatArray, square: FloatArray) -> FloatArray:
    """Return log |sin v| in doubles; numpy's warnings must be off."""
    return np.where(square < FAR, 0.5 * np.log1p(-np.minimum(square, FAR)), np.log(np.abs(sine)))


def numerator_real(alpha: float | FloatArray, log_sine: FloatArray) -> FloatArray:
    """Return 1 − s^{2α} in doubles."""
    found: FloatArray = -np.expm1(2.0 * alpha * log_sine)
    return found
