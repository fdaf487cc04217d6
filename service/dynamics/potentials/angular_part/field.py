r"""The angular part as a field: value, gradient and second derivatives, in doubles and balls.

Along the turn D = g1 ∂_3 − g3 ∂_1 and the scaling S = g1 ∂_1 + g3 ∂_3, with θ = w d/dw,

.. math::
    S\,V_1[F] &= 2(\alpha-1)\,V_1[\theta F], \\
    D\,V_1[F] &= -2(A-C)\,g_1 g_3\,(V_1[F] + F(w))/Q, \qquad
    D F(w) = \frac{2Q}{C g_1 g_3}\,\theta F(w),

so no derivative is taken of an integral: V1 of F, θF and θ²F are all that is
needed. The second line says H[V1] = −F(w).

V1 itself, in doubles, comes first. H. M. Yehia's general solution is V = V1[F] + Q G(g2). On the curve
|g3| = λ |g1|^{C/A} the quantity

.. math:: w = |A-C|^{\alpha-1}\,|g_3|^{2\alpha}/g_1^2,\qquad \alpha = A/C,

is constant, and V1 is the potential with the energy −F(w) that vanishes in the
direction |g3/g1| = tan φ0. With ζ = (g3/g1)² and ρ = g1² + g3²

.. math:: V_1 = -(\alpha-1)\,\frac{Q}{C\rho}\int_{\tan^2\varphi_0}^{\zeta}
          F\bigl(w(\rho,z)\bigr)\frac{dz}{(\alpha+z)^2},\qquad
          w(\rho,z) = (|A-C|\rho)^{\alpha-1} z^\alpha(1+z)^{1-\alpha}.

Integrated over y = log z: what is not smooth in z is so at z = 0 and ∞, which
the weight e^{-|y|} makes negligible, and where F varies at all it does so on
the scale of log w.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, cached_property
from typing import Generic, TypeVar

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebra import Algebra, Arithmetic
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.real import RealAlgebra
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.angular_part.balls import CurveFunction, angular_balls, curve_ball

T = TypeVar("T", bound=Arithmetic)

FloatArray = NDArray[np.float64]
IntegrandFunction = Callable[[FloatArray], FloatArray]
"""Returns values of shape (functions, *shape of w), at w of any shape."""

PANEL_NODES = 20
TAIL_RELATIVE_SIZE = 1e-8
"""Largest tail of a panel's Legendre series against its size. The rule is exact up to the degree
2·20 − 1: what it leaves out is of the order of the tail squared, 1e-16."""
TAIL_SHARE_OF_WHOLE = 1e-17
"""Panels whose tail is below this share of the whole need not be resolved."""
MAX_HALVINGS = 60
"""Where the halving stops: what is unresolved then is returned as NaN."""
PANELS_TOGETHER = 4096
"""Panels evaluated at once: some MB per operation."""


def angular_values(
    body: RigidBody, functions: IntegrandFunction, g1: FloatArray, g3: FloatArray, reference_angle: float
) -> FloatArray:
    """Return V1 of several functions at points of one shape: shape (functions, *points)."""
    g1, g3 = np.broadcast_arrays(np.asarray(g1, dtype=np.float64), np.asarray(g3, dtype=np.float64))
    alpha = float(body.alpha)
    with np.errstate(all="ignore"):
        radius = np.hypot(g1, g3)  # its square may underflow
        y = 2.0 * (np.log(np.abs(g3)) - np.log(np.abs(g1)))
        log_scale = (alpha - 1.0) * (math.log(abs(float(body.A - body.C))) + 2.0 * np.log(radius))
        T = alpha * (g1 / radius) ** 2 + (g3 / radius) ** 2
    line = _Line(functions, alpha, log_scale.ravel())
    start = 2.0 * math.log(math.tan(reference_angle))
    integrals = _integrate(line, np.full(y.size, start), y.ravel())
    result: FloatArray = -(alpha - 1.0) * T * integrals.reshape(len(integrals), *y.shape)
    return result


def curve_parameter(body: RigidBody, g1: FloatArray, g3: FloatArray) -> FloatArray:
    """Return w at the points, same shape; NaN or 0 or inf where g1 g3 = 0."""
    alpha = float(body.alpha)
    with np.errstate(all="ignore"):
        # The quotient is moderate where its parts squared overflow or underflow.
        root = np.abs(g3) ** alpha / np.abs(g1)
        result: FloatArray = np.float64(abs(body.A - body.C)) ** (alpha - 1.0) * root * root
    return result


@dataclass(frozen=True, slots=True)
class _Line:
    """The integrands over y, one set for every point."""

    functions: IntegrandFunction
    alpha: float
    log_scale: FloatArray
    """(α − 1) log(|A − C| ρ), shape (points,)."""

    def __call__(self, point: NDArray[np.intp], y: FloatArray) -> FloatArray:
        """Return F(w) z/(α + z)² at ``y`` of shape (panels, nodes), shape (functions, panels, nodes)."""
        alpha = self.alpha
        with np.errstate(all="ignore"):
            # α y + (1 − α) log(1 + e^y), without cancellation for large y.
            shape = np.where(y > 0.0, y, alpha * y) + (1.0 - alpha) * np.log1p(np.exp(-np.abs(y)))
            w = np.exp(self.log_scale[point, None] + shape)
            z = np.exp(y)
            weight = 1.0 / ((alpha + z) * (alpha / z + 1.0))
            values: FloatArray = self.functions(w) * weight
        return values


def _integrate(line: _Line, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the integrals from ``start`` to ``end``, both (points,), shape (functions, points).

    Panels are halved until their Legendre series has converged.
    """
    rule = _rule()
    pending = [(np.arange(len(start)), start, end)]
    total: FloatArray | None = None
    size: FloatArray = np.zeros(len(start))
    for _ in range(MAX_HALVINGS + 1):
        unresolved = []
        for point, left, right in _chunks(pending):
            with np.errstate(all="ignore"):
                half = 0.5 * (right - left)
                y = 0.5 * (left + right)[:, None] + half[:, None] * rule.points
            values = line(point, y)
            lengths = half * (values @ rule.weights)
            if total is None:
                total = np.zeros((len(lengths), len(start)))
            with np.errstate(all="ignore"):
                series = np.abs(values @ rule.tail)
                tail = series.max(axis=-1)
                largest = np.abs(values).max(axis=-1)
                np.maximum.at(size, point, (np.abs(half) * largest).max(axis=0))
                # NaN fails the comparison and is not halved either: it stays.
                rough = (tail > TAIL_RELATIVE_SIZE * largest) & (
                    np.abs(half) * tail > TAIL_SHARE_OF_WHOLE * size[point]
                )
            again = rough.any(axis=0)
            keep = ~again
            for function, length in zip(total, lengths, strict=True):
                np.add.at(function, point[keep], length[keep])
            if again.any():
                middle = 0.5 * (left + right)[again]
                unresolved += [(point[again], left[again], middle), (point[again], middle, right[again])]
        pending = unresolved
        if not pending:
            break
    if total is None:  # no points: the functions give the shape
        return np.zeros((len(line(np.zeros(0, dtype=np.intp), np.zeros((0, PANEL_NODES)))), 0))
    for point, _, _ in pending:
        total[:, point] = np.nan
    return total


def _chunks(
    pending: list[tuple[NDArray[np.intp], FloatArray, FloatArray]],
) -> list[tuple[NDArray[np.intp], FloatArray, FloatArray]]:
    if not pending:
        return []
    point, left, right = (np.concatenate(parts) for parts in zip(*pending, strict=True))
    return [
        (point[k : k + PANELS_TOGETHER], left[k : k + PANELS_TOGETHER], right[k : k + PANELS_TOGETHER])
        for k in range(0, len(point), PANELS_TOGETHER)
    ]


@dataclass(frozen=True, slots=True)
class _Rule:
    """Gauss and Legendre's rule on [−1, 1]."""

    points: FloatArray
    weights: FloatArray
    tail: FloatArray
    """Matrix from values at the points to the last two Legendre coefficients, shape (PANEL_NODES, 2)."""


@cache
def _rule() -> _Rule:
    points, weights = np.polynomial.legendre.leggauss(PANEL_NODES)
    vandermonde = np.polynomial.legendre.legvander(points, PANEL_NODES - 1)[:, -2:]
    degrees = np.arange(PANEL_NODES - 2, PANEL_NODES)
    return _Rule(points, weights, weights[:, None] * vandermonde * (degrees + 0.5))


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
