r"""The Euler-Poisson equations of a rigid body in a potential field, and their three integrals.

.. math::
    A \dot p = (B - C) q r + g_2 V_3 - g_3 V_2, \qquad \dot g_1 = r g_2 - q g_3, \\
    B \dot q = (C - A) p r + g_3 V_1 - g_1 V_3, \qquad \dot g_2 = p g_3 - r g_1, \\
    C \dot r = (A - B) p q + g_1 V_2 - g_2 V_1, \qquad \dot g_3 = q g_1 - p g_2

omega = (p, q, r) is the angular velocity and gamma = (g1, g2, g3) the space-fixed
unit vector, both in the principal axes; all arrays have shape (..., 3). V is
known up to a constant, which the energy shares.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from operator import add, mul, sub, truediv
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.potentials.potential import Potential

FloatArray = NDArray[np.float64]
T = TypeVar("T")


class FourOperations(NamedTuple, Generic[T]):
    """An arithmetic: of arrays, of an algebra's elements, or of what compiled code computes with."""

    plus: Callable[[T, T], T]
    minus: Callable[[T, T], T]
    times: Callable[[T, T], T]
    over: Callable[[T, T], T]


BY_OPERATORS: FourOperations[FloatArray] = FourOperations(add, sub, mul, truediv)


def rates_in(
    arithmetic: FourOperations[T],
) -> Callable[[Sequence[T], Sequence[T], Sequence[T]], tuple[T, ...]]:
    """Return the function of moments as in :func:`moments_of`, a state and V_1, V_2, V_3 to its six rates."""
    plus, minus, times, over = arithmetic

    def rates(moments: Sequence[T], state: Sequence[T], slopes: Sequence[T]) -> tuple[T, ...]:
        A, B, C, B_C, C_A, A_B = moments
        p, q, r, g1, g2, g3 = state
        V1, V2, V3 = slopes
        return (
            over(plus(times(B_C, times(q, r)), minus(times(g2, V3), times(g3, V2))), A),
            over(plus(times(C_A, times(r, p)), minus(times(g3, V1), times(g1, V3))), B),
            over(plus(times(A_B, times(p, q)), minus(times(g1, V2), times(g2, V1))), C),
            minus(times(g2, r), times(g3, q)),
            minus(times(g3, p), times(g1, r)),
            minus(times(g1, q), times(g2, p)),
        )

    return rates


def integrals_in(
    arithmetic: FourOperations[T],
) -> Callable[[Sequence[T], Sequence[T], T, T], tuple[T, T, T]]:
    """Return the function of moments, a state, V and ½ to its energy, its areas and γ·γ."""
    plus, _, times, _ = arithmetic

    def integrals(moments: Sequence[T], state: Sequence[T], V: T, half: T) -> tuple[T, T, T]:
        A, B, C, _, _, _ = moments
        p, q, r, g1, g2, g3 = state
        first, second, third = times(A, p), times(B, q), times(C, r)
        twice = plus(plus(times(first, p), times(second, q)), times(third, r))
        return (
            plus(times(half, twice), V),
            plus(plus(times(first, g1), times(second, g2)), times(third, g3)),
            plus(plus(times(g1, g1), times(g2, g2)), times(g3, g3)),
        )

    return integrals


def moments_of(body: RigidBody) -> tuple[Fraction, ...]:
    """Return A, B, C, B − C, C − A, A − B.

    A moment B that was left out matters for q' alone; it is taken as A + C, the largest there is.
    """
    A, B, C = body.A, body.A + body.C if body.B is None else body.B, body.C
    return A, B, C, B - C, C - A, A - B


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
    body.require_B("the equations of motion")
    moments = [np.asarray(float(each)) for each in moments_of(body)]
    state = [*np.moveaxis(omega, -1, 0), *np.moveaxis(gamma, -1, 0)]
    found = rates_in(BY_OPERATORS)(moments, state, [*np.moveaxis(potential.gradient(gamma), -1, 0)])
    return StateRates(np.stack(found[:3], axis=-1), np.stack(found[3:], axis=-1))


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
