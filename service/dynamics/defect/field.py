"""The Euler-Poisson equations and their three integrals in any algebra: doubles, discs."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Generic, TypeVar

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebra import Algebra
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.tape import Tape

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Integrals(Generic[T]):
    """The values of the three integrals at one state."""

    energy: T
    areas: T
    geometric: T
    """γ·γ."""


def value_and_gradient(algebra: Algebra[T], tape: Tape, gamma: Sequence[T]) -> tuple[T, tuple[T, ...]]:
    """Return V and (V_1, V_2, V_3)."""
    jets = FirstOrderJets(algebra, 3)
    V = tape.evaluate(jets, jets.variables(gamma))
    return V.value, jets.gradient(V)


def rates_at(
    algebra: Algebra[T], body: RigidBody, state: Sequence[T], gradient: Sequence[T]
) -> tuple[T, ...]:
    """Return the right-hand sides of :mod:`service.dynamics.equations.euler_poisson` for p, q, r, g1, g2, g3.

    A moment B that was left out matters for q' alone; it is taken as A + C, the largest there is.
    """
    p, q, r, g1, g2, g3 = state
    V1, V2, V3 = gradient
    A, B, C = _moments(body)

    def cross(a: T, b: T, c: T, d: T) -> T:
        return algebra.subtract(algebra.multiply(a, b), algebra.multiply(c, d))

    def accelerated(difference: Fraction, x: T, y: T, torque: T, moment: Fraction) -> T:
        if difference != 0:
            gyroscopic = algebra.multiply(algebra.constant(difference), algebra.multiply(x, y))
            torque = algebra.add(gyroscopic, torque)
        return algebra.divide(torque, algebra.constant(moment))

    return (
        accelerated(B - C, q, r, cross(g2, V3, g3, V2), A),
        accelerated(C - A, p, r, cross(g3, V1, g1, V3), B),
        accelerated(A - B, p, q, cross(g1, V2, g2, V1), C),
        cross(r, g2, q, g3),
        cross(p, g3, r, g1),
        cross(q, g1, p, g2),
    )


def integrals_at(algebra: Algebra[T], body: RigidBody, state: Sequence[T], value: T) -> Integrals[T]:
    """Return h = (A p² + B q² + C r²)/2 + V, A p g1 + B q g2 + C r g3, and γ·γ; V is ``value``."""
    omega, gamma = state[:3], state[3:]
    momenta = tuple(
        algebra.multiply(algebra.constant(moment), x) for moment, x in zip(_moments(body), omega, strict=True)
    )
    kinetic = algebra.divide(_product(algebra, momenta, omega), algebra.constant(Fraction(2)))
    return Integrals(
        algebra.add(kinetic, value), _product(algebra, momenta, gamma), _product(algebra, gamma, gamma)
    )


def _moments(body: RigidBody) -> tuple[Fraction, Fraction, Fraction]:
    return body.A, body.A + body.C if body.B is None else body.B, body.C


def _product(algebra: Algebra[T], x: Sequence[T], y: Sequence[T]) -> T:
    first, second, third = (algebra.multiply(a, b) for a, b in zip(x, y, strict=True))
    return algebra.add(algebra.add(first, second), third)
