r"""The Euler-Poisson equations of a rigid body in a potential field, and their three integrals.

.. math::
    A \dot p = (B - C) q r + g_2 V_3 - g_3 V_2, \qquad \dot g_1 = r g_2 - q g_3, \\
    B \dot q = (C - A) p r + g_3 V_1 - g_1 V_3, \qquad \dot g_2 = p g_3 - r g_1, \\
    C \dot r = (A - B) p q + g_1 V_2 - g_2 V_1, \qquad \dot g_3 = q g_1 - p g_2

omega = (p, q, r) is the angular velocity and gamma = (g1, g2, g3) the space-fixed
unit vector, both in the principal axes; all arrays have shape (..., 3). V is
known up to a constant, which the energy shares.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import Potential

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class StateRates:
    """Time derivatives of omega and gamma, shape (..., 3) each."""

    omega: FloatArray
    gamma: FloatArray


def euler_poisson_rhs(
    body: RigidBody, potential: Potential, omega: FloatArray, gamma: FloatArray
) -> StateRates:
    """Return the time derivatives of ``omega`` and ``gamma``.

    Raises
    ------
    MissingMomentError
        The body has no B.
    """
    inertia = np.array([float(body.A), float(body.require_B("the equations of motion")), float(body.C)])
    torque = np.cross(gamma, potential.gradient(gamma))
    return StateRates(
        omega=(np.cross(inertia * omega, omega) + torque) / inertia, gamma=np.cross(gamma, omega)
    )


def energy_integral(
    body: RigidBody, potential: Potential, omega: FloatArray, gamma: FloatArray
) -> FloatArray:
    """Return h = (A p² + B q² + C r²)/2 + V, shape (...).

    Raises
    ------
    MissingMomentError
        The body has no B, and q is not zero throughout.
    """
    h: FloatArray = kinetic_energy(body, omega) + potential.value(gamma)
    return h


def kinetic_energy(body: RigidBody, omega: FloatArray) -> FloatArray:
    """Return (A p² + B q² + C r²)/2, shape (...); raises as :func:`energy_integral`."""
    omega = np.asarray(omega, dtype=np.float64)
    T: FloatArray = np.sum(_inertia(body, omega) * omega**2, axis=-1) / 2.0
    return T


def geometric_integral(gamma: FloatArray) -> FloatArray:
    """Return γ·γ, which is 1, shape (...)."""
    square: FloatArray = np.sum(np.square(gamma), axis=-1)
    return square


def areas_integral(body: RigidBody, omega: FloatArray, gamma: FloatArray) -> FloatArray:
    """Return I3 = A p g1 + B q g2 + C r g3, shape (...); raises as :func:`energy_integral`."""
    omega = np.asarray(omega, dtype=np.float64)
    areas: FloatArray = np.sum(_inertia(body, omega) * omega * gamma, axis=-1)
    return areas


def _inertia(body: RigidBody, omega: FloatArray) -> FloatArray:
    """Return (A, B, C); a missing B is taken as 0 if q = 0, where it has no effect."""
    moment_B = 0.0
    if body.B is not None or np.any(omega[..., 1] != 0.0):
        moment_B = float(body.require_B("an integral with q ≠ 0"))
    return np.array([float(body.A), moment_B, float(body.C)])
