"""The equations of motion written out once more, and integrated step by step with events of no kind."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

FloatArray = NDArray[np.float64]
Gradient = Callable[[float, float, float], tuple[float, float, float]]


def integrate(
    moments: tuple[float, float, float], gradient: Gradient, start: FloatArray, stop: float
) -> FloatArray:
    """Return the states (p, q, r, g1, g2, g3) at all steps from 0 to ``stop``, shape (6, steps).

    Steps are short, and at a kink of the potential cut until its error is one of some 1e-10.
    """
    found = solve_ivp(
        rates_of(moments, gradient),
        (0.0, stop),
        start,
        method="DOP853",
        rtol=1e-11,
        atol=1e-12,
        max_step=0.01,
    )
    assert found.success
    states: FloatArray = found.y
    return states


def rates_of(
    moments: tuple[float, float, float], gradient: Gradient
) -> Callable[[float, FloatArray], list[float]]:
    """Return the right-hand sides of the equations for (p, q, r, g1, g2, g3)."""
    A, B, C = moments

    def rates(_: float, y: FloatArray) -> list[float]:
        p, q, r, g1, g2, g3 = y
        V_1, V_2, V_3 = gradient(g1, g2, g3)
        return [
            ((B - C) * q * r + g2 * V_3 - g3 * V_2) / A,
            ((C - A) * p * r + g3 * V_1 - g1 * V_3) / B,
            ((A - B) * p * q + g1 * V_2 - g2 * V_1) / C,
            r * g2 - q * g3,
            p * g3 - r * g1,
            q * g1 - p * g2,
        ]

    return rates


def planar_start(A: float, C: float, V: float, h: float, g: FloatArray) -> FloatArray:
    """Return the state with q = 0, zero areas integral and energy h at a place g."""
    Q = A * g[0] ** 2 + C * g[2] ** 2
    s = np.sqrt(2.0 * (h - V) / (A * C * Q))
    return np.array([-C * g[2] * s, 0.0, A * g[0] * s, *g])
