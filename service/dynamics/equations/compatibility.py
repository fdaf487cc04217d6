"""The compatibility equation L(V) = 0: which potentials admit the planar motions.

With Q = A g1² + C g3², the planar motions q = 0, I3 = 0 exist for every curve
|g3| = λ |g1|^(C/A) if and only if on the unit sphere

    L(V) = g1 g2 g3 (A V_11 - C V_33) + Q (g1 V_23 - g3 V_12)
           - g2 (A g1² - C g3²) V_13 - (A - 2C) g2 g3 V_1
           + 2 (A - C) g1 g3 V_2 - (2A - C) g1 g2 V_3 = 0

(Yehia's equation, label e of the paper). It factorises through the derivative
X along the curves and the energy H of the motion on a curve:

    X = A g1 g2 ∂_1 - Q ∂_2 + C g3 g2 ∂_3,
    H[V] = V + Q (g1 V_3 - g3 V_1) / (2 (A - C) g1 g3),
    L(V) = -(2 (A - C) g1 g3 / Q) X(H[V]).

So L(V) = 0 says that H is constant on every curve. Both hold off the sphere
too, and L(R W) = R L(W) for R = |g|²: L depends only on V on the sphere.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeVar

from flint import arb

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebra import Arithmetic
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.jets import SecondOrderJets
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.potential import Potential

T = TypeVar("T", bound=Arithmetic)


def pde_residual(A: T, C: T, gamma: Sequence[T], first: Sequence[T], second: Sequence[Sequence[T]]) -> T:
    """Return L(V) at ``gamma`` from the gradient (3) and the hessian (3, 3) of V with respect to it."""
    g1, g2, g3 = gamma
    V1, V2, V3 = first
    (V11, V12, V13), (_, _, V23), (_, _, V33) = second
    a, c = A * g1 * g1, C * g3 * g3
    return (
        g1 * g2 * g3 * (A * V11 - C * V33)
        + (a + c) * (g1 * V23 - g3 * V12)
        - g2 * (a - c) * V13
        - (A - C - C) * g2 * g3 * V1
        + (A - C + A - C) * g1 * g3 * V2
        - (A + A - C) * g1 * g2 * V3
    )


def energy_on_curve(A: T, C: T, gamma: Sequence[T], V: T, first: Sequence[T]) -> T:
    """Return H[V], the energy of the motion along the curve through ``gamma``; g1 g3 != 0."""
    g1, _, g3 = gamma
    V1, _, V3 = first
    return V + (A * g1 * g1 + C * g3 * g3) * (g1 * V3 - g3 * V1) / ((A - C + A - C) * g1 * g3)


def along_curves(A: T, C: T, gamma: Sequence[T], first: Sequence[T]) -> T:
    """Return X(f), the derivative along the curves g3 = λ g1^(C/A), from the gradient (3) of f."""
    g1, g2, g3 = gamma
    f1, f2, f3 = first
    return A * g1 * g2 * f1 - (A * g1 * g1 + C * g3 * g3) * f2 + C * g3 * g2 * f3


@dataclass(frozen=True, slots=True)
class ResidualBall:
    """An enclosure of L(V) at a point, and of the size of the terms it is the sum of."""

    residual: arb
    size: arb

    @property
    def is_defined(self) -> bool:
        """Whether V has two finite derivatives there, as far as the precision shows."""
        return bool(self.residual.is_finite())


def residual_ball(body: RigidBody, tape: Tape, point: Sequence[Fraction]) -> ResidualBall:
    """Enclose L(V) at the exact ``point`` rigorously, at the precision of ``flint.ctx``."""
    balls = BallAlgebra()
    A, C = balls.constant(body.A), balls.constant(body.C)
    gamma = [balls.constant(coordinate) for coordinate in point]
    jets = SecondOrderJets(balls, 3)
    V = tape.evaluate(jets, jets.variables(gamma))
    return _residual(A, C, gamma, V.value, jets.gradient(V), jets.hessian(V))


def residual_of(body: RigidBody, potential: Potential, point: Sequence[Fraction]) -> ResidualBall:
    """Enclose L(V) as :func:`residual_ball` does, of any potential, a formula or not."""
    balls = BallAlgebra()
    A, C = balls.constant(body.A), balls.constant(body.C)
    g1, g2, g3 = (balls.constant(coordinate) for coordinate in point)
    return _residual(A, C, (g1, g2, g3), *potential.jet_ball(g1, g2, g3))


def _residual(
    A: arb,
    C: arb,
    gamma: Sequence[arb],
    value: arb,
    first: Sequence[arb],
    second: Sequence[Sequence[arb]],
) -> ResidualBall:
    size = (A + C) * sum((abs(part) for row in (first, *second) for part in row), start=arb(0))
    residual = pde_residual(A, C, gamma, first, second)
    # The value itself must exist too: where it does not, derivatives may still look harmless.
    return ResidualBall(residual if value.is_finite() else arb("nan"), size)
