r"""The angular part as a field: value, gradient and second derivatives, in doubles and balls.

Along the turn D = g1 ∂_3 − g3 ∂_1 and the scaling S = g1 ∂_1 + g3 ∂_3, with θ = w d/dw,

.. math::
    S\,V_1[F] &= 2(\alpha-1)\,V_1[\theta F], \\
    D\,V_1[F] &= -2(A-C)\,g_1 g_3\,(V_1[F] + F(w))/Q, \qquad
    D F(w) = \frac{2Q}{C g_1 g_3}\,\theta F(w),

so no derivative is taken of an integral: V1 of F, θF and θ²F are all that is
needed. The second line says H[V1] = −F(w).
"""

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebra import Algebra
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.real import RealAlgebra
from service.dynamics.formula.arithmetic import Arithmetic
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.angular_part.balls import angular_balls, curve_ball
from service.dynamics.potentials.angular_part.curve_function import CurveFunction
from service.dynamics.potentials.angular_part.doubles import angular_values, curve_parameter

FloatArray = NDArray[np.float64]
T = TypeVar("T", bound=Arithmetic)

Matrix = tuple[tuple[T, T, T], tuple[T, T, T], tuple[T, T, T]]


@dataclass(frozen=True, slots=True)
class AngularField:
    """V1[F] for one body, on one quadrant or on all four."""

    body: RigidBody
    F: CurveFunction
    reference_angle: Tape
    """φ0, a tape without variables."""

    def real(self, g1: FloatArray, g3: FloatArray, order: int) -> "AngularJet[FloatArray]":
        """Return V1 with ``order`` ≤ 2 derivatives at two arrays of one shape."""
        w = curve_parameter(self.body, g1, g3)
        functions = tuple(np.broadcast_to(part, np.shape(g1)) for part in self.F.real(w, order))

        def integrands(w: FloatArray) -> FloatArray:
            return np.stack([np.broadcast_to(part, w.shape) for part in self.F.real(w, order)])

        angle = float(self.reference_angle.evaluate(RealAlgebra(), ()))
        values = tuple(angular_values(self.body, integrands, g1, g3, angle))
        return AngularJet(_Numbers.of(self, RealAlgebra()), g1, g3, functions, values)

    def ball(self, g1: arb, g3: arb, order: int) -> "AngularJet[arb]":
        """Return enclosures of V1 with ``order`` ≤ 2 derivatives."""
        functions = self.F.ball(curve_ball(self.body, g1, g3), order)
        values = angular_balls(self.body, self.F, order, g1, g3, self.angle())
        return self.jet(g1, g3, functions, values)

    def angle(self) -> arb:
        """Return φ0."""
        return self.reference_angle.evaluate(BallAlgebra(), ())

    def jet(self, g1: arb, g3: arb, functions: tuple[arb, ...], values: tuple[arb, ...]) -> "AngularJet[arb]":
        """Return the derivatives that follow from F, θF, ... and V1[F], V1[θF], ..."""
        return AngularJet(_Numbers.of(self, BallAlgebra()), g1, g3, functions, values)


@dataclass(frozen=True, slots=True)
class _Numbers(Generic[T]):
    """The constants of a field in one arithmetic."""

    A: T
    C: T
    zero: T
    two: T

    @staticmethod
    def of(field: AngularField, algebra: Algebra[T]) -> "_Numbers[T]":
        constant = algebra.constant
        return _Numbers(
            constant(field.body.A), constant(field.body.C), constant(Fraction(0)), constant(Fraction(2))
        )


@dataclass(frozen=True)
class AngularJet(Generic[T]):
    """V1 at points: ``functions`` are F, θF, ... there and ``values`` V1[F], V1[θF], ..."""

    numbers: _Numbers[T]
    g1: T
    g3: T
    functions: tuple[T, ...]
    values: tuple[T, ...]

    @property
    def value(self) -> T:
        """V1."""
        return self.values[0]

    @cached_property
    def D(self) -> T:
        """g1 V1_3 − g3 V1_1; needs no derivative of F."""
        return self._turned(0)

    @cached_property
    def gradient(self) -> tuple[T, T, T]:
        """(V1_1, 0, V1_3); needs order 1."""
        rho, S = self._rho, self._scaled
        first = (self.g1 * S - self.g3 * self.D) / rho
        third = (self.g3 * S + self.g1 * self.D) / rho
        return first, self.numbers.zero, third

    @cached_property
    def hessian(self) -> Matrix[T]:
        """The matrix of V1_ij; needs order 2."""
        g1, g3, rho, two = self.g1, self.g3, self._rho, self.numbers.two
        # The matrix along the radius and across it, times ρ: SS − S, SD − D, DD + S.
        S = self._scaled
        along = self._factor * self._factor * self.values[2] - S
        mixed = self._factor * self._turned(1) - self.D
        across = self._turned_twice + S
        a, b, c = g1 * g1, g1 * g3, g3 * g3
        square = rho * rho
        V_11 = (a * along - two * b * mixed + c * across) / square
        V_13 = (b * (along - across) + (a - c) * mixed) / square
        V_33 = (c * along + two * b * mixed + a * across) / square
        zero = self.numbers.zero
        return (V_11, zero, V_13), (zero, zero, zero), (V_13, zero, V_33)

    @property
    def _rho(self) -> T:
        return self.g1 * self.g1 + self.g3 * self.g3

    @property
    def _Q(self) -> T:
        return self.numbers.A * self.g1 * self.g1 + self.numbers.C * self.g3 * self.g3

    @property
    def _difference(self) -> T:
        """2 (A − C)."""
        return self.numbers.two * (self.numbers.A - self.numbers.C)

    @property
    def _factor(self) -> T:
        """2 (α − 1), the degree of homogeneity of w."""
        return self._difference / self.numbers.C

    @property
    def _scaled(self) -> T:
        """S V1."""
        return self._factor * self.values[1]

    def _turned(self, k: int) -> T:
        """Return D V1[θ^k F]."""
        total = self.values[k] + self.functions[k]
        return (self.numbers.zero - self._difference) * self.g1 * self.g3 * total / self._Q

    @property
    def _turned_twice(self) -> T:
        """DD V1, by the product rule from D V1 = −2(A − C) (g1 g3/Q) (V1 + F)."""
        g1, g3, Q = self.g1, self.g3, self._Q
        share = g1 * g3 / Q
        rate = (g1 * g1 - g3 * g3) / Q + self._difference * share * share
        total = self.values[0] + self.functions[0]
        bend = self.numbers.two / self.numbers.C * self.functions[1]
        return (self.numbers.zero - self._difference) * (rate * total + share * self.D + bend)
